"""The state machine of the receiver of job orders, its events, and all fields of orders, with asyncua's client."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Any

import pytest

pytest.importorskip("asyncua")

from asyncua import Node, ua

from skiros2_gateway.core.job import Method
from support.opcua import opcua_server
from unit.skiros2_gateway.opcua_client import NO_COMMENT, PROVIDER, Mes, order

Run = Callable[..., None]
SUCCESS, UNKNOWN_JOB, INVALID_STATE, NOT_ACCEPTED = 1, 2, 8, 16


class Events:
    """Keeps the events of a subscription: job order, states and the response's id."""

    def __init__(self) -> None:
        self.values: asyncio.Queue[tuple[str, list[str], str]] = asyncio.Queue()

    def event_notification(self, event: Any) -> None:
        states = [state.StateText.Text for state in event.JobState]
        self.values.put_nowait((event.JobOrder.JobOrderID, states, event.JobResponse.JobOrderID))


async def event_type(mes: Mes) -> Node:
    """Returns the type of the events of changed states."""
    path = [f"{mes.index}:ISA95JobOrderStatusEventType", f"{mes.cell}:JobOrderStatusEventType"]
    return await mes.nodes.base_event_type.get_child(path)


async def text_of(mes: Mes, *path: str) -> tuple[str, str]:
    """Returns a state variable of the receiver: its text, and the browse name of the node that it names."""
    receiver = await mes.object("JobOrderReceiver")
    variable = await receiver.get_child([f"{mes.index if name.endswith('Substates') else 0}:{name}" for name in path])
    data = await variable.read_data_value(raise_on_bad_status=False)
    if data.StatusCode.value == ua.StatusCodes.BadStateNotActive:
        return "", ""
    named = mes.get_node(await (await variable.get_child("0:Id")).read_value())
    assert named.nodeid.NamespaceIndex == mes.index
    return data.Value.Value.Text, (await named.read_browse_name()).Name


def test_receiver_shows_states_and_transitions_and_each_change_is_an_event(in_server: Run) -> None:
    async def test(gateway: Any) -> None:
        async with Mes(gateway.address) as mes:
            await mes.load()
            kind = await event_type(mes)
            seen, subscriptions = (Events(), Events()), []
            for source, events in zip((mes.nodes.server, await mes.object(PROVIDER)), seen, strict=True):
                subscriptions.append(await mes.create_subscription(20, events))
                await subscriptions[-1].subscribe_events(source, kind)

            async def changed(*states: str) -> None:
                for events in seen:
                    assert await events.values.get() == ("life", list(states), "life")

            assert await mes.call("Store", order("life"), NO_COMMENT) == SUCCESS
            await changed("NotAllowedToStart", "Ready")
            assert await text_of(mes, "CurrentState") == ("NotAllowedToStart", "NotAllowedToStart")
            assert await text_of(mes, "NotAllowedToStartSubstates", "CurrentState") == ("Ready", "Ready")
            assert await mes.call("Start", "life", NO_COMMENT) == SUCCESS
            await changed("AllowedToStart", "Ready")
            await changed("AllowedToStart", "Loaded")
            assert await text_of(mes, "AllowedToStartSubstates", "CurrentState") == ("Loaded", "Loaded")
            assert await text_of(mes, "NotAllowedToStartSubstates", "CurrentState") == ("", "")
            gateway.cell.run("life")
            await changed("Running")
            transition = "FromAllowedToStartToRunning"
            assert await text_of(mes, "LastTransition") == (transition, transition)
            assert await mes.call("Pause", "life", NO_COMMENT) == SUCCESS
            await changed("Interrupted", "Held")
            assert await mes.call("Resume", "life", NO_COMMENT) == SUCCESS
            await changed("Running")
            gateway.cell.end("life")
            await changed("Ended", "Completed")
            await gateway.collected("life")
            await changed("Ended", "Closed")
            assert await text_of(mes, "EndedSubstates", "CurrentState") == ("Closed", "Closed")
            assert all(events.values.empty() for events in seen)
            for each in subscriptions:
                await each.delete()

    in_server(test)


def test_only_changes_of_a_state_are_events_also_after_a_restart(in_gateway: Run) -> None:
    async def test(gateway: Any) -> None:
        await gateway.put("earlier")
        gateway.cell.run("earlier")
        server = opcua_server(gateway.service, gateway.path.parent)
        await server.start()
        try:
            async with Mes(server.address, "view") as mes:
                await mes.load()
                seen = Events()
                subscription = await mes.create_subscription(20, seen)
                await subscription.subscribe_events(mes.nodes.server, await event_type(mes))
                gateway.cell.run("earlier", "/other")  # progress
                gateway.cell.end("earlier")
                assert (await seen.values.get())[1] == ["Ended", "Completed"]
                await gateway.collected("earlier")
                assert (await seen.values.get())[1] == ["Ended", "Closed"]
                gateway.control.apply(Method.CLEAR, "earlier", "test")
                await gateway.put("later", start=False)
                assert (await seen.values.get())[0] == "later"
        finally:
            await server.stop()

    in_gateway(test)


def test_path_of_a_substate_leads_to_its_state_machine(in_server: Run) -> None:
    async def test(gateway: Any) -> None:
        async with Mes(gateway.address) as mes:
            await mes.load()
            assert await mes.call("Store", order("path"), NO_COMMENT) == SUCCESS
            response, _ = await mes.call("RequestJobResponseByJobOrderID", "path", of=PROVIDER)
            state, substate = response.JobState
            assert (state.StateText.Text, state.StateNumber, state.BrowsePath.Elements) == ("NotAllowedToStart", 1, [])
            receiver = await mes.object("JobOrderReceiver")
            path = ua.BrowsePath(receiver.nodeid, substate.BrowsePath)
            [result] = await mes.uaclient.translate_browsepaths_to_nodeids([path])
            machine = mes.get_node(result.Targets[0].TargetId)
            assert (await machine.read_browse_name()).Name == "NotAllowedToStartSubstates"
            assert substate.StateText.Text == "Ready"

    in_server(test)


def test_each_method_answers_with_its_return_status(in_server: Run) -> None:
    async def test(gateway: Any) -> None:
        async with Mes(gateway.address) as mes:
            await mes.load()

            async def status(method: str, *arguments: Any) -> int:
                return int(await mes.call(method, *arguments, NO_COMMENT))

            assert await status("StoreAndStart", order("s1")) == SUCCESS
            gateway.cell.run("s1")
            assert await status("Store", order("s1", master="place", Tray="Tray-1")) not in (SUCCESS, UNKNOWN_JOB)
            assert await status("RevokeStart", "s1") == INVALID_STATE
            assert await status("Stop", "s1") == SUCCESS
            assert await status("Store", order("s2")) == SUCCESS
            assert await status("Update", order("s2", master="place", Tray="Tray-1")) == SUCCESS
            assert await status("Update", order("s2", master="plaice")) == NOT_ACCEPTED
            assert await status("Cancel", "s2") == SUCCESS
            assert await status("Cancel", "s2") == INVALID_STATE
            assert await status("StoreAndStart", order("s3")) == SUCCESS
            gateway.cell.run("s3")
            assert await status("Abort", "s3") == SUCCESS
            for method in ("Start", "RevokeStart", "Pause", "Resume", "Stop", "Abort", "Cancel", "Clear"):
                assert await status(method, "nobody") == UNKNOWN_JOB, method
            assert await status("Update", order("nobody")) == UNKNOWN_JOB

    in_server(test)


def test_personnel_assets_and_material_of_an_order_are_kept_and_reported(in_server: Run) -> None:
    async def test(gateway: Any) -> None:
        async with Mes(gateway.address) as mes:
            await mes.load()
            unit = ua.EUInformation("http://www.opcfoundation.org/UA/units/un/cefact", 4408652, ua.LocalizedText("kg"))
            weight = ua.ISA95PropertyDataType(ID="Weight", Value=ua.Variant(1.5))
            made = order("resources")
            made.PersonnelRequirements = [ua.ISA95PersonnelDataType(ID="welder", PersonnelUse="observe", Quantity="2")]
            made.PhysicalAssetRequirements = [ua.ISA95PhysicalAssetDataType(ID="gripper-7", Properties=[weight])]
            made.MaterialRequirements = [
                ua.ISA95MaterialDataType(
                    MaterialDefinitionID="screw M4", MaterialLotID="lot 9", Quantity="0.25", EngineeringUnits=unit
                )
            ]
            assert await mes.call("Store", made, NO_COMMENT) == SUCCESS
            assert await mes.call("Store", made, NO_COMMENT) == SUCCESS  # the same order is the same job
            stored = gateway.store.get("resources").order.resources
            assert [each.kind for each in stored] == ["personnel", "physical_asset", "material"]
            listed = await (await mes.object("JobOrderReceiver")).get_child(f"{mes.index}:JobOrderList")
            [found] = [e.JobOrder for e in await listed.read_value() if e.JobOrder.JobOrderID == "resources"]
            [person], [asset], [material] = (
                found.PersonnelRequirements, found.PhysicalAssetRequirements, found.MaterialRequirements
            )  # fmt: skip
            assert (person.ID, person.PersonnelUse, person.Quantity) == ("welder", "observe", "2")
            assert (asset.ID, asset.Properties[0].ID, asset.Properties[0].Value.Value) == ("gripper-7", "Weight", 1.5)
            assert (material.MaterialLotID, material.MaterialDefinitionID) == ("lot 9", "screw M4")
            assert (material.EngineeringUnits.UnitId, material.EngineeringUnits.DisplayName.Text) == (4408652, "kg")
            made.MaterialRequirements[0].MaterialLotID = "lot 10"
            assert await mes.call("Store", made, NO_COMMENT) == NOT_ACCEPTED  # another order with this id
            assert await mes.call("Cancel", "resources", NO_COMMENT) == SUCCESS

    in_server(test)


def test_order_with_what_cannot_be_kept_is_not_accepted(in_server: Run) -> None:
    async def test(gateway: Any) -> None:
        async with Mes(gateway.address) as mes:
            await mes.load()
            below = ua.ISA95PropertyDataType(ID="s", Value=ua.Variant(1))
            group = ua.ISA95PropertyDataType(ID="group", Value=ua.Variant(1), Subproperties=[below])
            for name, need in (
                ("PersonnelRequirements", ua.ISA95PersonnelDataType(ID="p", Properties=[group])),
                ("PhysicalAssetRequirements", ua.ISA95PhysicalAssetDataType(ID="a", Properties=[below, below])),
                ("MaterialRequirements", ua.ISA95MaterialDataType(MaterialLotID="m", Quantity="some")),
            ):
                made = order("needs")
                setattr(made, name, [need])
                assert await mes.call("Store", made, NO_COMMENT) == NOT_ACCEPTED, name
            made = order("needs")
            made.JobOrderParameters[0].Subparameters = [ua.ISA95ParameterDataType(ID="s", Value=ua.Variant(1))]
            assert await mes.call("Store", made, NO_COMMENT) == NOT_ACCEPTED
        assert "needs" not in [job.id for job in gateway.store.jobs()]

    in_server(test)


def test_method_of_an_object_may_be_called_by_the_id_of_its_type(in_server: Run) -> None:
    async def test(gateway: Any) -> None:
        async with Mes(gateway.address) as mes:
            await mes.load()
            start = ua.NodeId(7005, mes.index)  # ISA95JobOrderReceiverObjectType.Start

            async def call(owner: ua.NodeId) -> Any:
                arguments = [ua.Variant("nobody"), NO_COMMENT]
                request = ua.CallMethodRequest(ObjectId=owner, MethodId=start, InputArguments=arguments)
                return (await mes.uaclient.call([request]))[0]

            result = await call(ua.NodeId("JobOrderReceiver", mes.cell))
            assert [output.Value for output in result.OutputArguments] == [UNKNOWN_JOB]
            for wrong in (ua.NodeId(1002, mes.index), ua.NodeId(PROVIDER, mes.cell), ua.NodeId("World", mes.cell)):
                assert (await call(wrong)).StatusCode.value == ua.StatusCodes.BadMethodInvalid

    in_server(test)
