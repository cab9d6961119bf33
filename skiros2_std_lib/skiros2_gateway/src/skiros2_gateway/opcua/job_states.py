"""The state machine of the receiver of job orders, and the events of changed states."""

from __future__ import annotations

from collections.abc import Iterable
from datetime import UTC, datetime
from typing import Any

from asyncua import Node, Server, ua

from skiros2_gateway.core.job import FINAL, Job, State, Substate
from skiros2_gateway.opcua.model import RECEIVER_TYPE, JobModel, find_type
from skiros2_gateway.opcua.orders import SUBSTATES, job_order, job_response, job_states

#: The type of the events of changed states, in the cell's namespace. That of the node set is abstract.
EVENT_TYPE = "JobOrderStatusEventType"
_ABSTRACT_EVENT_TYPE = "ISA95JobOrderStatusEventType"
#: Severity of an event: of most, and of an aborted job order.
_NORMAL, _ABORTED = 100, 500

_NOT_ACTIVE = ua.StatusCode(ua.StatusCodes.BadStateNotActive)


class JobStates:
    """Shows the state of the job order whose state changed last, and sends an event for each change.

    To be used in the gateway's loop, apart from `start`.
    """

    def __init__(self, server: Server, model: JobModel) -> None:
        self._server = server
        self._model = model
        self._known: dict[str, tuple[str, str]] = {}  # state and sub-state of the job orders that have not ended
        self._ids: dict[str, dict[str, ua.NodeId]] = {}  # of states and transitions, by name, of each state machine
        self._variables: dict[str, Node] = {}
        self._written: dict[str, Any] = {}  # values, by the path of the variable
        self._event: Any = None

    def know(self, jobs: Iterable[Job]) -> None:
        """Sets the jobs that have not ended, whose states are no changes. To be called before the first event."""
        self._known = {job.id: (job.state.value, job.substate.value) for job in jobs}

    async def start(self) -> None:
        """Reads states and transitions from the types; no state is active yet."""
        server, model = self._server, self._model
        machines = {"": (model.receiver, await find_type(server, model.types, RECEIVER_TYPE))}
        for name in SUBSTATES.values():
            node = model.children[name]
            machines[name] = node, server.get_node(await node.read_type_definition())
        for machine, (node, type_node) in machines.items():
            self._ids[machine] = {
                (await each.read_browse_name()).Name: each.nodeid
                for each in await type_node.get_children(nodeclassmask=ua.NodeClass.Object)
            }
            for variable in await node.get_children(nodeclassmask=ua.NodeClass.Variable):
                await self._add_variable(machine, variable)
            await self._write_state(machine, None)
            await self._write_transition(machine, "")
        states = [self._ids[""][state] for state in State]
        await self._write("/AvailableStates", states, ua.VariantType.NodeId)
        transitions = [node for name, node in self._ids[""].items() if name.startswith("From")]
        await self._write("/AvailableTransitions", transitions, ua.VariantType.NodeId)
        await self._add_events()

    async def on_job(self, data: dict[str, Any]) -> None:
        """Follows an event of a job (`Job.to_dict`)."""
        before, now = self._known.get(data["id"]), (data["state"], data["substate"])
        is_final = data["state"] in FINAL
        if is_final and (data["response"]["collected"] or data["cleared"]):
            self._known.pop(data["id"], None)  # its state does not change any more
        else:
            self._known[data["id"]] = now
        if before == now or (before is None and is_final):
            return
        job = Job.from_dict(data)
        await self._write_state("", job.state)
        await self._write_transition("", f"From{before[0]}To{now[0]}" if before else "")
        for state, machine in SUBSTATES.items():
            is_active = state is job.state and job.substate is not Substate.NONE
            await self._write_state(machine, job.substate if is_active else None)
        await self._send(job)

    async def _add_variable(self, machine: str, variable: Node) -> None:
        name = (await variable.read_browse_name()).Name
        self._variables[f"{machine}/{name}"] = variable
        for part in await variable.get_children():
            self._variables[f"{machine}/{name}/{(await part.read_browse_name()).Name}"] = part

    async def _write_state(self, machine: str, state: State | Substate | None) -> None:
        if state is None:
            await self._write(f"{machine}/CurrentState", None)
            await self._write(f"{machine}/CurrentState/Id", None)
            await self._write(f"{machine}/CurrentState/Number", None)
            return
        text, number = ua.LocalizedText(state.value, "en"), state.number
        await self._write(f"{machine}/CurrentState", text, ua.VariantType.LocalizedText)
        await self._write(f"{machine}/CurrentState/Id", self._ids[machine][state], ua.VariantType.NodeId)
        await self._write(f"{machine}/CurrentState/Number", number, ua.VariantType.UInt32)

    async def _write_transition(self, machine: str, name: str) -> None:
        node = self._ids[machine].get(name)  # none for a new job order, and where two changes are learned at once
        text = ua.LocalizedText(name, "en") if node else None
        await self._write(f"{machine}/LastTransition", text, ua.VariantType.LocalizedText)
        await self._write(f"{machine}/LastTransition/Id", node, ua.VariantType.NodeId)

    async def _write(self, path: str, value: Any, kind: ua.VariantType | None = None) -> None:
        """Writes a variable, which optional parts of a type may lack; without a value, no state is active."""
        if path not in self._variables or (path in self._written and self._written[path] == value):
            return
        self._written[path] = value
        data = ua.DataValue(StatusCode=_NOT_ACTIVE) if value is None else ua.DataValue(ua.Variant(value, kind))
        data.SourceTimestamp = data.ServerTimestamp = datetime.now(UTC)
        await self._server.write_attribute_value(self._variables[path].nodeid, data)  # a quarter of write_value's time

    async def _add_events(self) -> None:
        server, model = self._server, self._model
        abstract = await server.nodes.base_event_type.get_child(f"{model.types}:{_ABSTRACT_EVENT_TYPE}")
        place = ua.NodeId(EVENT_TYPE, model.cell), f"{model.cell}:{EVENT_TYPE}"
        event_type = await abstract.add_object_type(*place)
        self._event = await server.get_event_generator(event_type, model.provider)
        for name in ("JobOrder", "JobState", "JobResponse"):  # asyncua knows no structures in events
            self._event.event.data_types[name] = ua.VariantType.ExtensionObject
        await server.nodes.server.add_reference(model.provider, ua.ObjectIds.HasNotifier)

    async def _send(self, job: Job) -> None:
        service = self._event.isession.subscription_service
        if not service.subscriptions:
            return  # nobody listens: the structures would cost for nothing
        event = self._event.event
        event.JobOrder, event.JobState = job_order(job), job_states(job, self._model.types)
        event.JobResponse = job_response(job, self._model.types)
        event.Severity = _ABORTED if job.state is State.ABORTED else _NORMAL
        event.emitting_node = self._model.provider.nodeid
        await self._event.trigger(message=f"job {job.id}: {job.state} {job.substate}".rstrip())
        event.emitting_node = self._server.nodes.server.nodeid  # the Server object reports the events of all
        await service.trigger_event(event)
