"""OPC UA: asyncua's client and its command-line programs against the server, with a stand-in for the cell."""

from __future__ import annotations

import asyncio
import math
import sys
import time
from collections.abc import AsyncIterator, Callable, Coroutine
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import pytest
from asyncua import Node, ua

from skiros2_gateway.core.job import Method
from skiros2_gateway.core.users import User
from skiros2_gateway.http.models import JobData
from support.opcua import cell_index, opcua_server
from unit.skiros2_gateway.conftest import TOKENS
from unit.skiros2_gateway.opcua_client import NO_COMMENT, PROVIDER, Mes, order

Run = Callable[[Callable[[Any], Coroutine[Any, Any, None]]], None]
PROGRAMS = Path(sys.executable).parent
_MANY = 5000
SUCCESS, UNKNOWN_JOB, INVALID_STATE, NOT_ACCEPTED = 1, 2, 8, 16


async def program(name: str, address: str, *arguments: str, user: str = "operate", password: str = "") -> str:
    """Runs a program of asyncua to its end; returns its output."""
    login = ("--user", user, "--password", password or TOKENS.get(user, ""))
    process = await asyncio.create_subprocess_exec(
        str(PROGRAMS / name), "-u", address, *login, *arguments,
        stdout=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.STDOUT,
    )  # fmt: skip
    return (await process.communicate())[0].decode()


@asynccontextmanager
async def turns() -> AsyncIterator[list[float]]:
    """Yields the CPU times that the loop's thread takes between two turns of a task (s)."""
    times: list[float] = []

    async def watch() -> None:
        while True:
            begin = time.thread_time()
            await asyncio.sleep(0.001)
            times.append(time.thread_time() - begin)

    watching = asyncio.create_task(watch())
    yield times
    await asyncio.sleep(0)  # what has begun last
    watching.cancel()


def test_loop_serves_others_while_the_server_starts(in_gateway: Callable[..., None], tmp_path: Path) -> None:
    async def test(gateway: Any) -> None:
        server = opcua_server(gateway.service, tmp_path)
        async with turns() as times:
            await server.start()
        await server.stop()
        assert max(times) < 0.1

    in_gateway(test)


def test_loop_serves_others_while_a_long_list_is_read(in_gateway: Callable[..., None], tmp_path: Path) -> None:
    async def test(gateway: Any) -> None:
        server = opcua_server(gateway.service, tmp_path)
        await server.start()
        for number in range(_MANY):
            await gateway.put(f"many-{number}", start=False, work_master="place", parameters={"Tray": "Tray-1"})

        async def read() -> int:
            """In a thread: a client's time is not the server's."""
            async with Mes(server.address) as mes:
                await mes.load()
                receiver = await mes.object("JobOrderReceiver")
                return len(await (await receiver.get_child(f"{mes.index}:JobOrderList")).read_value())

        async with turns() as times:
            assert await asyncio.to_thread(asyncio.run, read()) == _MANY
        await server.stop()
        assert max(times) < 0.1

    in_gateway(test)


def test_job_is_stored_started_and_its_response_requested(in_server: Run) -> None:
    async def test(gateway: Any) -> None:
        async with Mes(gateway.address) as mes:
            await mes.load()
            assert await mes.call("Store", order("j1", master="place", Tray="Tray-1"), NO_COMMENT) == SUCCESS
            assert gateway.state("j1") == "NotAllowedToStart/Ready"
            assert gateway.job("j1").robots == ("/robot",)
            assert await mes.call("Start", "j1", [ua.LocalizedText("go")]) == SUCCESS
            gateway.cell.run("j1")
            assert await mes.call("Pause", "j1", NO_COMMENT) == SUCCESS
            assert await mes.call("Resume", "j1", NO_COMMENT) == SUCCESS
            gateway.cell.end("j1")
            await gateway.collected("j1")
            response, status = await mes.call("RequestJobResponseByJobOrderID", "j1", of=PROVIDER)
            values = {each.ID: each.Value.Value for each in response.JobResponseData}
            assert (status, response.JobOrderID, values["Outcome"]) == (SUCCESS, "j1", "succeeded")
            assert [state.StateText.Text for state in response.JobState] == ["Ended", "Closed"]
            assert [actual.ID for actual in response.EquipmentActuals] == ["/robot"]
            ended = ua.ISA95StateDataType(StateNumber=5)
            found, status = await mes.call("RequestJobResponseByJobOrderState", [ended], of=PROVIDER)
            assert (status, "j1" in [each.JobOrderID for each in found]) == (SUCCESS, True)
            assert [e["comment"] for e in gateway.store.history("j1") if e["method"] == "Start"] == ["go"]

    in_server(test)


def test_command_with_a_key_is_carried_out_once(in_server: Run) -> None:
    async def test(gateway: Any) -> None:
        def key(text: str) -> list[ua.LocalizedText]:
            return [ua.LocalizedText("again"), ua.LocalizedText(text, "x-key")]

        async with Mes(gateway.address) as mes:
            await mes.load()
            for _ in range(2):
                assert await mes.call("StoreAndStart", order("keyed"), key("store")) == SUCCESS
            gateway.cell.run("keyed")
            assert await mes.call("Pause", "keyed", key("pause")) == SUCCESS
            assert await mes.call("Resume", "keyed", key("resume")) == SUCCESS
            assert await mes.call("Pause", "keyed", NO_COMMENT) == SUCCESS
            assert await mes.call("Resume", "keyed", key("resume")) == SUCCESS  # a call that was lost
            assert gateway.state("keyed") == "Interrupted/Held"
            assert await mes.call("Abort", "keyed", key("resume")) == NOT_ACCEPTED  # the key of another command
            history = gateway.store.history("keyed")
            assert [e["comment"] for e in history if e["method"] == "Resume"] == ["again"]

    in_server(test)


def test_refused_call_returns_its_status_and_changes_nothing(in_server: Run) -> None:
    async def test(gateway: Any) -> None:
        async with Mes(gateway.address) as mes:
            await mes.load()
            assert await mes.call("Start", "unknown", NO_COMMENT) == UNKNOWN_JOB
            assert await mes.call("Store", order("j2", master="plaice"), NO_COMMENT) == NOT_ACCEPTED
            assert await mes.call("Store", order("j2"), NO_COMMENT) == SUCCESS
            assert await mes.call("Pause", "j2", NO_COMMENT) == INVALID_STATE
            assert gateway.state("j2") == "NotAllowedToStart/Ready"

    in_server(test)


def test_wrong_call_gets_its_status_and_a_text_with_all_problems(in_server: Run) -> None:
    no_list = ua.Variant(["x"], ua.VariantType.String, is_array=True)
    too_few, too_many, wrong = (
        getattr(ua.StatusCodes, f"Bad{name}") for name in ("ArgumentsMissing", "TooManyArguments", "InvalidArgument")
    )
    calls: list[tuple[str, list[ua.Variant], int, list[str]]] = [
        ("Store", [], too_few, ["missing: JobOrder"]),
        ("Start", [ua.Variant("j"), NO_COMMENT, NO_COMMENT], too_many, ["3 arguments, expected JobOrderID, Comment"]),
        ("Start", [ua.Variant(5), no_list], wrong, ["JobOrderID: Int64, expected String", "Comment: String[]"]),
        ("Store", [ua.Variant("j")], wrong, ["JobOrder: str, expected ISA95JobOrderDataType"]),
        (f"{PROVIDER}.RequestJobResponseByJobOrderState", [no_list], wrong, ["JobOrderState: str[], expected ISA95"]),
    ]

    async def test(gateway: Any) -> None:
        async with Mes(gateway.address) as mes:
            await mes.load()

            async def raw(name: str, arguments: list[ua.Variant]) -> Any:
                request = ua.CallMethodRequest()
                of, _, method = name.rpartition(".")
                request.ObjectId = ua.NodeId(of or "JobOrderReceiver", mes.cell)
                request.MethodId = (await mes.get_node(request.ObjectId).get_child(f"{mes.index}:{method}")).nodeid
                request.InputArguments = arguments
                return (await mes.uaclient.call([request]))[0]

            for name, arguments, status, texts in calls:
                result = await raw(name, arguments)
                infos = [info.AdditionalInfo for info in result.InputArgumentDiagnosticInfos]
                assert result.StatusCode.value == status, (name, result)
                assert all(info.startswith(text) for info, text in zip(infos, texts, strict=True)), infos
            bad = order("not an id", Speed=5.0)
            bad.JobOrderParameters *= 2
            bad.WorkMasterID = [ua.ISA95WorkMasterDataType(ID=master) for master in ("place", "park")]
            result = await raw("Store", [ua.Variant(bad), NO_COMMENT])
            assert [output.Value for output in result.OutputArguments] == [NOT_ACCEPTED]
            text = result.InputArgumentDiagnosticInfos[0].AdditionalInfo
            for problem in ("parameters.Speed: 2 values", "work_master: 2 work masters", "id: String should match"):
                assert problem in text
        assert not {"j", "not an id"} & {job.id for job in gateway.store.jobs()}

    in_server(test)


def test_list_of_job_orders_is_published(in_server: Run) -> None:
    class Changes:
        def __init__(self) -> None:
            self.values: asyncio.Queue[Any] = asyncio.Queue()

        def datachange_notification(self, node: Node, value: Any, data: Any) -> None:
            self.values.put_nowait([(each.JobOrder.JobOrderID, each.State[0].StateText.Text) for each in value])

    async def test(gateway: Any) -> None:
        async with Mes(gateway.address, "view") as mes:
            await mes.load()
            changes = Changes()
            subscription = await mes.create_subscription(20, changes)
            receiver = await mes.object("JobOrderReceiver")
            await subscription.subscribe_data_change(await receiver.get_child(f"{mes.index}:JobOrderList"))
            await gateway.put("j3")
            gateway.cell.accept("j3")
            while ("j3", "Running") not in await changes.values.get():
                pass

    in_server(test)


def test_list_of_responses_has_ended_jobs_until_they_are_cleared(in_server: Run) -> None:
    async def test(gateway: Any) -> None:
        async with Mes(gateway.address, "view") as mes:
            await mes.load()
            responses = await (await mes.object(PROVIDER)).get_child(f"{mes.index}:JobOrderResponseList")

            async def ids() -> list[str]:
                return [each.JobOrderID for each in await responses.read_value()]

            for job_id in ("j6", "j7"):
                await gateway.put(job_id)
                gateway.cell.end(job_id)
                await gateway.collected(job_id)
            while (await ids())[:2] != ["j7", "j6"]:
                await asyncio.sleep(0.01)
            gateway.control.apply(Method.CLEAR, "j6", "test")
            while "j6" in await ids():
                await asyncio.sleep(0.01)
            assert (await ids())[0] == "j7"

    in_server(test)


def test_only_known_users_with_the_role_may_call(in_server: Run) -> None:
    async def test(gateway: Any) -> None:
        address = gateway.address
        for user, password in (("operate", "wrong"), ("view", TOKENS["operate"])):
            with pytest.raises(ua.UaStatusCodeError) as refused:
                await Mes(address, user, password).connect()
            assert refused.value.code == ua.StatusCodes.BadUserAccessDenied
        async with Mes(address, "view") as viewer:
            await viewer.load()
            try:
                await viewer.call("Store", order("j4"), NO_COMMENT)
                raise AssertionError("a viewer has stored a job")
            except ua.UaStatusCodeError as error:
                assert error.code == ua.StatusCodes.BadUserAccessDenied
            try:
                await viewer.nodes.objects.add_folder(2, "mine")
                raise AssertionError("a client has added a node")
            except ua.UaStatusCodeError as error:
                assert error.code == ua.StatusCodes.BadUserAccessDenied
        assert "j4" not in [job.id for job in gateway.store.jobs()]

    in_server(test)


def test_silent_connections_leave_room_after_the_time_for_a_login(
    in_gateway: Callable[..., None], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("skiros2_gateway.opcua.server._MAX_CONNECTIONS", 3)
    monkeypatch.setattr("skiros2_gateway.opcua.server._LOGIN_TIMEOUT", 1.0)

    async def test(gateway: Any) -> None:
        folder = gateway.path.parent
        server = opcua_server(gateway.service, folder)
        await server.start()
        try:
            url = urlsplit(server.address)
            connections = [await asyncio.open_connection(url.hostname, url.port) for _ in range(4)]
            closed = [asyncio.create_task(reader.read()) for reader, _ in connections]
            first, _ = await asyncio.wait(closed, return_when=asyncio.FIRST_COMPLETED)
            assert first == {closed[3]}  # one too many
            assert await asyncio.gather(*closed) == [b""] * 4
            async with Mes(server.address, "view"):
                pass
            assert (folder / "opcua_key.pem").stat().st_mode & 0o077 == 0
        finally:
            await server.stop()

    in_gateway(test)


def test_command_line_programs_browse_call_and_read(in_server: Run) -> None:
    async def test(gateway: Any) -> None:
        address = gateway.address
        await gateway.put("j5", start=False)
        called, read = await asyncio.gather(
            program("uacall", address, "-n", "ns=3;s=JobOrderReceiver", "-m", "2:Start", "-t", "string", "j5"),
            program("uaread", address, "-n", "ns=3;s=Cell/Robots/robot/State"),
        )
        assert gateway.state("j5") == "AllowedToStart/Loaded", called
        assert "idle" in read

    in_server(test)


def test_scene_is_a_twin_that_follows_changes(in_server: Run) -> None:
    async def test(gateway: Any) -> None:
        async with Mes(gateway.address, "view") as mes:
            index = await cell_index(mes)
            kind = mes.get_node(ua.NodeId("World/Tray-1/Type", index))
            while True:
                try:
                    assert await kind.read_value() == "demo:Tray"
                    break
                except ua.UaStatusCodeError:
                    await asyncio.sleep(0.01)
            tray = {"id": "Tray-1", "type": "demo:Tray", "label": "", "properties": {"Is": ["Full"]}}
            tray["relations"] = [("contain", "Product-3")]
            gateway.cell.change(**{"Product-2": None, "Tray-1": tray})
            relations = mes.get_node(ua.NodeId("World/Tray-1/Relations", index))
            while await relations.read_value() != ["contain Product-3"]:
                await asyncio.sleep(0.01)
            assert await mes.get_node(ua.NodeId("World/Tray-1/Is", index)).read_value() == "Full"
            names = [name.Name for name in [await n.read_browse_name() for n in await mes.get_node(
                ua.NodeId("World", index)).get_children()]]  # fmt: skip
            assert "Tray-1" in names and "Product-2" not in names

    in_server(test)


def test_stored_number_of_any_size_is_shown(in_server: Run) -> None:
    """Earlier versions have stored any number."""

    async def test(gateway: Any) -> None:
        async with Mes(gateway.address) as mes:
            await mes.load()
            job = await gateway.put("huge", start=False)
            job.order = job.order.model_copy(update={"parameters": {"P": 10**40, "R": math.nan}})
            gateway.control.jobs.save(job, "test", "test")
            await gateway.put("after", start=False)
            orders = await (await mes.object("JobOrderReceiver")).get_child(f"{mes.index}:JobOrderList")
            while not {"huge", "after"} <= {each.JobOrder.JobOrderID for each in await orders.read_value() or []}:
                await asyncio.sleep(0.02)
            shown = next(each for each in await orders.read_value() if each.JobOrder.JobOrderID == "huge")
            values = {each.ID: each.Value.Value for each in shown.JobOrder.JobOrderParameters}
            assert values["P"] == str(10**40)

    in_server(test)


def test_element_with_a_number_of_any_size_costs_no_other(in_server: Run) -> None:
    async def test(gateway: Any) -> None:
        content = {"type": "skiros:Product", "label": "", "relations": []}
        changed = [
            {"id": "Huge-1", "properties": {"a": [10**400], "b": [1, 10**400]}, **content},
            {"id": "Huge-2", "properties": {"a": [1]}, **content},
        ]
        gateway.cell.change(Bad={"id": 7})
        gateway.cell.change(**{each["id"]: each for each in changed})
        async with Mes(gateway.address) as mes:
            index = await cell_index(mes)
            for eid, value in (("Huge-2", 1.0), ("Huge-1", str(10**400))):
                while True:
                    try:
                        assert await mes.get_node(ua.NodeId(f"World/{eid}/a", index)).read_value() == value
                        break
                    except ua.UaStatusCodeError:  # not shown yet
                        await asyncio.sleep(0.02)

    in_server(test)


def test_response_of_another_system_is_kept_with_its_job(in_server: Run) -> None:
    async def test(gateway: Any) -> None:
        async with Mes(gateway.address) as mes, Mes(gateway.address, "view") as viewer:
            for client in (mes, viewer):
                await client.load()

            async def send(response_id: str, job: str = "r1", client: Mes = mes, **values: Any) -> int:
                made = ua.ISA95JobResponseDataType(JobResponseID=response_id, JobOrderID=job)
                made.JobState = [ua.ISA95StateDataType(StateText=ua.LocalizedText("Ended"), StateNumber=5)]
                made.JobResponseData = [ua.ISA95ParameterDataType(ID=k, Value=ua.Variant(v)) for k, v in values.items()]
                made.MaterialActuals = [ua.ISA95MaterialDataType(MaterialDefinitionID="steel", Quantity="2")]
                return int(await client.call("ReceiveJobResponse", made, of="JobResponseReceiver"))

            assert await mes.call("Store", order("r1"), NO_COMMENT) == SUCCESS
            assert await send("m1", Weight=1.0) == SUCCESS
            assert await send("m2", Passed=True) == SUCCESS
            assert await send("m1", Weight=1.5) == SUCCESS  # replaces the first one
            assert await send("m1", job="nobody") == UNKNOWN_JOB
            assert (
                await send("")
                == await send("m3", Weight=math.nan)
                == await send("m3", Text="x" * 70000)
                == NOT_ACCEPTED
            )
            with pytest.raises(ua.UaStatusCodeError, match="BadUserAccessDenied"):
                await send("m4", client=viewer)
        second, first = gateway.store.get("r1").received
        assert (first["id"], first["values"], first["states"], first["author"]) == (
            "m1", {"Weight": 1.5}, ["Ended"], "operate",
        )  # fmt: skip
        assert first["resources"][0]["material_definition"] == "steel" and first["resources"][0]["quantity"] == "2"
        assert (second["id"], second["values"]) == ("m2", {"Passed": True})
        assert gateway.state("r1") == "NotAllowedToStart/Ready"
        entries = [entry for entry in gateway.store.history("r1") if entry["method"] == "ReceiveJobResponse"]
        assert [(entry["author"], entry["comment"]) for entry in entries] == [
            ("operate", each) for each in ("m1", "m2", "m1")
        ]
        assert JobData.model_validate(gateway.job("r1").to_dict()).received[1].values == {"Weight": 1.5}

    in_server(test)


def test_agent_does_not_log_in_and_a_revoked_user_may_do_nothing_more(in_server: Run) -> None:
    async def test(gateway: Any) -> None:
        with pytest.raises(ua.UaStatusCodeError):
            await Mes(gateway.address, "agent").connect()
        users = [User(name=name, role=name, token=token) for name, token in TOKENS.items()]
        mes = Mes(gateway.address)
        await mes.connect()
        try:
            await mes.load()
            assert await mes.call("Store", order("admitted"), NO_COMMENT) == SUCCESS
            gateway.access.set_users([user for user in users if user.name != "operate"])
            with pytest.raises(ua.UaStatusCodeError):
                await mes.call("Store", order("revoked"), NO_COMMENT)
            assert [job.id for job in gateway.store.jobs() if job.id in ("admitted", "revoked")] == ["admitted"]
        finally:
            gateway.access.set_users(users)
            await mes.disconnect()

    in_server(test)
