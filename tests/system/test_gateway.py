"""The gateway's node on a cell of real nodes: jobs by REST become goals, agents execute, certificates encrypt."""

from __future__ import annotations

import asyncio
import os
import shutil
import signal
import ssl
import urllib.error
import urllib.request
from collections.abc import Iterator
from typing import Any

import pytest
import rospy
from asyncua import Client, ua
from rospy.impl.registration import get_topic_manager
from std_msgs.msg import Float64

from skiros2_gateway.core.events import EventStream
from skiros2_gateway.core.job_control import JobControl
from skiros2_gateway.core.store import JobStore
from skiros2_gateway.core.work_masters import WorkMasters
from skiros2_gateway.opcua.model import NAMESPACE
from skiros2_gateway.opcua.return_status import ReturnStatus
from skiros2_gateway.ros.ros_cell import RosCell
from support.agent import connected_agent
from support.certificates import make_certificate
from support.job_cell import ROBOT, TOKENS, JobCell, job_cell
from support.opcua import cell_index
from support.programs import PATIENCE, ProcessId
from support.ros import RosMaster, wait_until

pytestmark = pytest.mark.timeout(180)


@pytest.fixture(scope="module")
def cell(ros_master: RosMaster, tmp_path_factory: pytest.TempPathFactory) -> Iterator[JobCell]:
    with job_cell(ros_master, tmp_path_factory.mktemp("gateway"), products=8, agents="approved") as made:
        yield made


def test_job_becomes_a_goal_and_its_response_says_what_changed(cell: JobCell) -> None:
    assert cell.parameter("/wm/journal_sync") is True  # a job that is done loses no change
    status, job = cell.rest.post("/api/jobs", cell.order("first", 0))
    assert (status, job["goal"]) == (201, f'(skiros:contain "{cell.stores[0]}" "{cell.products[0]}")')
    job = cell.wait_for(["first"])["first"]
    response = job["response"]
    assert (job["state"], job["substate"], response["outcome"]) == ("Ended", "Closed", "succeeded")
    assert [(step["robot"], step["state"]) for step in response["steps"]] == [(ROBOT, "succeeded")]
    assert any({cell.stores[0], cell.products[0]} <= set(change["elements"]) for change in response["changes"])
    lines = [line for change in response["changes"] for line in change["lines"]]
    assert f"{cell.stores[0]} contains {cell.products[0]}" in lines
    methods = [entry["method"] for entry in cell.rest.get("/api/jobs/first/history")["history"]]
    assert methods == ["StoreAndStart", "loaded", "accepted", "ended", "collected"]


def test_order_with_unknown_names_is_rejected_with_all_of_them(cell: JobCell) -> None:
    order = cell.order("wrong", 0)
    order["parameters"] = {"Product": cell.stores[0], "Place": "skiros:Location-999"}
    status, answer = cell.rest.post("/api/jobs", {**order, "robots": ["/porte"]})
    assert (status, answer["code"]) == (422, "rejected")
    problems = {problem["where"]: problem for problem in answer["problems"]}
    assert set(problems) == {"robots.0", "parameters.Product", "parameters.Place"}
    assert problems["robots.0"]["nearest"] == [ROBOT]
    assert "wrong" not in cell.jobs()


def test_viewer_reads_and_does_not_command(cell: JobCell) -> None:
    assert cell.rest.get("/api/state", "view")["role"] == "view"
    for path, body in (("/api/jobs", cell.order("viewed", 0)), ("/api/robots/stop", {"robots": []})):
        assert cell.rest.post(path, body, "view")[0] == 403
    assert "viewed" not in cell.jobs()


def test_live_view_follows_the_scene_and_the_values_of_its_signals(cell: JobCell) -> None:
    def table(name: str) -> Any:
        return cell.rest.get("/api/live", "view")["document"][name]

    wm = cell.world.wm
    arm = cell.world.thing("cora:Robot", "arm", SkillMgr="mgr")
    load = cell.world.thing("skiros:Signal", "load", SignalTopic="~load", MessageField="data", Unit="N")
    wm.set_relation(arm, "skiros:hasA", load)
    wait_until(lambda: ("skiros:hasA", load) in map(tuple, table("elements").get(arm, {}).get("relations", ())))
    wait_until(lambda: table("signals").get(load, {}).get("robot") == "/mgr", what="the robot of the signal")
    publisher = rospy.Publisher("/mgr/load", Float64, queue_size=1, latch=True)
    publisher.publish(Float64(7.5))
    wait_until(lambda: table("signals")[load].get("value") == 7.5, what="the value of the signal")
    publisher.unregister()
    for eid in (load, arm):
        wm.remove_element(wm.get_element(eid))
    wait_until(lambda: load not in table("elements") and load not in table("signals"), what="the signal's removal")


def test_plans_leave_no_subscriptions_behind(cell: JobCell) -> None:
    """The gateway's cell in the test's process, whose subscriptions can be counted."""

    def callbacks() -> int:
        return sum(len(topic.callbacks) for topic in get_topic_manager().subs.values())

    async def plan() -> None:
        events, masters = EventStream(), WorkMasters()
        planning = RosCell(JobControl(JobStore(":memory:"), masters, events), events, masters)
        try:
            goal = f'(skiros:contain "{cell.stores[0]}" "{cell.products[7]}")'
            assert (await planning.plan(goal))["state"] == "planned"
            before = callbacks()
            for _ in range(4):
                await planning.plan(goal)
            assert callbacks() <= before
        finally:
            planning.close()

    asyncio.run(plan())


def test_stop_port_comes_back_when_its_process_is_killed(cell: JobCell) -> None:
    assert (_stop(cell), _stop(cell, "view")) == (200, 401)
    os.kill(cell.stop_process(), signal.SIGKILL)
    wait_until(lambda: _stop(cell) == 200, what="the stop port after a kill")
    audit = wait_until(lambda: _stops(cell), what="entries of the audit log")
    assert {entry["user"] for entry in audit} == {"operate"}


def test_robots_can_be_stopped_as_soon_as_the_gateway_serves(cell: JobCell) -> None:
    folder = cell.folder / "early"
    folder.mkdir()
    early = cell.start_gateway("early", folder=str(folder), users=str(cell.users))
    cell.parameter("/early/address")
    assert _stop(cell, gateway="early") == 200
    early.stop()


def _stop(cell: JobCell, role: str = "operate", gateway: str = "gateway") -> int:
    """Returns the status of a request to stop all robots; 0 if there is no answer."""
    headers = {"Authorization": f"Bearer {TOKENS[role]}", "Content-Type": "application/json"}
    address = f"{cell.parameter(f'/{gateway}/stop_address')}/api/robots/stop"
    try:
        request = urllib.request.Request(address, b'{"robots": []}', headers, method="POST")
        with urllib.request.urlopen(request, timeout=5.0) as answer:
            return int(answer.status)
    except urllib.error.HTTPError as error:
        return error.code
    except OSError:  # it is being started again
        return 0


def _stops(cell: JobCell) -> list[dict[str, Any]]:
    entries = cell.rest.get("/api/audit")["audit"]
    return [entry for entry in entries if (entry["action"], entry["outcome"]) == ("stop robots", "done")]


def test_agent_checks_plans_and_executes(cell: JobCell) -> None:
    async def agent() -> list[Any]:
        async with connected_agent(cell) as call:
            values = {"Object": cell.products[1], "To": cell.stores[0]}
            start = {"robot": ROBOT, "skill": "carry_at_once", "parameters": values}
            order = cell.order("of-agent", 1)
            calls: list[tuple[str, dict[str, Any]]] = [
                ("list_skills", {}), ("check_start", start),
                ("check_start", {**start, "parameters": {**values, "Object": "skiros:Product-999"}}),
                ("preview", {key: order[key] for key in ("work_master", "parameters")}), ("execute", order),
            ]  # fmt: skip
            return [await call(name, **arguments) for name, arguments in calls]

    skills, check, wrong, preview, job = asyncio.run(agent())
    required = {skill["label"]: skill["parameters"]["required"] for skill in skills["skills"]}
    assert required["carry_at_once"] == ["To", "Object"]
    assert (check["ok"], check["implementation"], check["elements"]["From"]) == (True, "carry_at_once", cell.shelf)
    assert check["values"] == {
        "Object": cell.products[1], "To": cell.stores[0], "From": cell.shelf, "Robot": check["elements"]["Robot"],
        "Options": {"gentle": True},
    }  # fmt: skip
    for begin in (f"{cell.shelf} no longer contains", f"{cell.stores[0]} contains"):
        assert any(change.startswith(begin) for change in check["changes"]), check["changes"]
    assert "skiros:Product-999" in wrong["detail"]
    assert preview["state"] == "planned" and cell.products[1] in str(preview["preview"])
    assert job["job"] == "of-agent"
    assert cell.wait_for(["of-agent"])["of-agent"]["response"]["outcome"] == "succeeded"


def test_agent_runs_a_skill_and_proposes_what_a_failed_job_lacks(cell: JobCell) -> None:
    values = {"Object": cell.products[2], "To": cell.stores[0]}
    skill = {"robot": ROBOT, "skill": "carry_at_once", "parameters": values}
    # this product is at no place, so no robot can carry it
    order = {**cell.order("lacking", 0), "parameters": {"Product": cell.lost_product, "Place": cell.stores[0]}}
    assert cell.rest.post("/api/jobs", order)[0] == 201
    assert cell.wait_for(["lacking"])["lacking"]["response"]["outcome"] == "impossible"
    fact = {"subject": cell.shelf, "relation": "skiros:contain", "object": cell.lost_product}

    def approve() -> dict[str, Any]:
        (approval,) = wait_until(lambda: cell.rest.get("/api/approvals")["approvals"], what="a request for an approval")
        assert cell.rest.post(f"/api/approvals/{approval['id']}/approve", {}, "approve")[0] == 200
        return dict(approval["what"])

    async def agent() -> tuple[Any, Any, Any, Any]:
        async with connected_agent(cell) as call:
            started = await call("execute", **skill)
            while (run := await call("explain", robot=ROBOT, task=started["task"]))["state"] == "running":
                await asyncio.sleep(0.05)
            refused = await call("execute", **{**skill, "parameters": {**values, "From": cell.shelf}})
            proposal = {"job": "lacking", "reason": "it was seen on the shelf", "relations": [fact], "retry": True}
            proposing = asyncio.create_task(call("propose", **proposal))
            what = await asyncio.to_thread(approve)
            return run, refused, what, await proposing

    run, refused, what, proposed = asyncio.run(agent())
    assert run["state"] == "succeeded"
    assert refused["code"] == "refused" and "IsThere" in refused["detail"]
    assert what["changes"] == [f"{cell.shelf} contains {cell.lost_product}"]
    assert (proposed["changes"], proposed["why"], proposed["retried"]["job"]) == (what["changes"], "", "lacking.2")
    assert cell.wait_for(["lacking.2"])["lacking.2"]["response"]["outcome"] == "succeeded"


def test_second_gateway_does_not_start_the_jobs_of_the_first(cell: JobCell) -> None:
    second = cell.start_gateway("second")
    assert second.wait() == 78
    assert f"{cell.folder}/jobs.sqlite: another process is using it" in second.output


def test_certificate_encrypts_rest_and_opcua(cell: JobCell) -> None:
    folder = cell.folder / "secured"
    folder.mkdir()
    certificate, key = make_certificate(folder, "gateway", "urn:skiros2:gateway")
    mine = make_certificate(folder, "mes", "urn:mes")
    (folder / "opcua/trusted/certs").mkdir(parents=True)
    shutil.copy(mine[0], folder / "opcua/trusted/certs")
    settings = {"certificate": str(certificate), "key": str(key), "opcua_port": 0, "users": str(cell.users)}
    secured = cell.start_gateway("secured", folder=str(folder), **settings)
    address = cell.parameter("/secured/address")
    assert address.startswith("https://127.0.0.1:")
    trusting = ssl.create_default_context(cafile=str(certificate))
    with urllib.request.urlopen(f"{address}/api/health", context=trusting, timeout=30.0) as answer:
        assert answer.status == 200
    for context in (ssl.create_default_context(), None):  # a client that does not know the certificate; one without TLS
        with pytest.raises(OSError):
            url = address if context else address.replace("https", "http")
            urllib.request.urlopen(f"{url}/api/health", context=context, timeout=30.0)

    async def call(policy: str) -> int:
        client = Client(cell.parameter("/secured/opcua_address"), timeout=60.0, watchdog_intervall=60.0)
        client.application_uri = "urn:mes"
        client.set_user("operate")
        client.set_password(TOKENS["operate"])
        if policy:
            await client.set_security_string(f"{policy},SignAndEncrypt,{mine[0]},{mine[1]},{certificate}")
        async with client:
            index = await client.get_namespace_index(NAMESPACE)
            receiver = client.get_node(ua.NodeId("JobOrderReceiver", await cell_index(client)))
            no_comment = ua.Variant([], ua.VariantType.LocalizedText, is_array=True)
            return int(await receiver.call_method(f"{index}:Start", "unknown", no_comment))

    assert asyncio.run(call("Basic256Sha256")) == ReturnStatus.UNKNOWN_JOB
    secured.stop()


@pytest.mark.long
def test_gateway_that_comes_back_learns_the_steps_it_has_missed(cell: JobCell) -> None:
    order = cell.order("missed", 6, store=1)
    key = order["parameters"]["Product"], order["parameters"]["Place"]
    before = cell.carried()[key]
    assert cell.rest.post("/api/jobs", order)[0] == 201
    gateway = ProcessId(cell.ros.master.node_pid("/gateway"))
    os.kill(gateway.pid, signal.SIGSTOP)
    wait_until(lambda: cell.carried()[key] > before, what="the carried product")
    cell.replace("/gateway", processes=[gateway])
    response = cell.wait_for(["missed"])["missed"]["response"]
    assert (response["outcome"], [step["state"] for step in response["steps"]]) == ("succeeded", ["succeeded"])
    assert response["changes"]


@pytest.mark.long
def test_job_that_asks_after_a_restart_continues_when_it_is_resumed(cell: JobCell) -> None:
    def state() -> str:
        return str(cell.rest.get("/api/jobs/asks")["state"])

    robot = cell.ros.master.node_pid(ROBOT)
    os.kill(robot, signal.SIGSTOP)
    try:
        assert cell.rest.post("/api/jobs", {**cell.order("asks", 7), "on_restart": "ask"})[0] == 201
        wait_until(lambda: state() == "Running", what="a running job")
        cell.kill("/tm")
    finally:
        os.kill(robot, signal.SIGCONT)
    wait_until(lambda: state() == "Interrupted", what="the question")
    assert cell.rest.post("/api/jobs/asks/resume", {})[0] == 200
    assert cell.wait_for(["asks"])["asks"]["response"]["outcome"] in ("succeeded", "nothing_to_do")


@pytest.mark.long
@pytest.mark.parametrize("node", ["/gateway", "/tm", "/wm"])
def test_job_is_done_once_or_reported_although_a_node_is_killed(cell: JobCell, node: str) -> None:
    def succeeded() -> int:
        return int(cell.rest.get("/api/state")["robots"][0]["counters"]["succeeded"])

    before, number, count = cell.carried(), ("/gateway", "/tm", "/wm").index(node) + 3, succeeded()
    job_id = f"killed-{node[1:]}"
    assert cell.rest.post("/api/jobs", cell.order(job_id, number, store=1))[0] == 201
    cell.kill(node)
    assert not cell.wrong(cell.wait_for([job_id], 2 * PATIENCE), before)
    cell.wait_until_ready()
    after = cell.order(f"after-{node[1:]}", number)  # the cell works again
    assert cell.rest.post("/api/jobs", after)[0] == 201
    assert cell.wait_for([after["id"]], 2 * PATIENCE)[after["id"]]["response"]["outcome"] == "succeeded"
    wait_until(lambda: succeeded() > count, what="one more success, also after a restart of the gateway")
