"""The lists of job orders and of the newest responses, as encoded structures, each made once for each state of a job.

A list is made when a client reads it, or where one has subscribed to it, after changes: with thousands of jobs in the
queue a new one costs nothing else. What is missing is made in pieces before, between which the loop serves others.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Awaitable, Callable
from datetime import UTC, datetime
from typing import Any

from asyncua import Node, Server, ua
from asyncua.common.callback import CallbackType, ServerItemCallback
from asyncua.ua.ua_binary import struct_to_binary

from skiros2_common.core.errors import SkirosError
from skiros2_gateway.core.events import Event
from skiros2_gateway.core.job import FINAL, Job, Order, State, Substate
from skiros2_gateway.core.service import Service
from skiros2_gateway.core.store import JobFilter
from skiros2_gateway.opcua.orders import job_order_and_state, job_response

log = logging.getLogger(__name__)

#: How many of the newest responses are in the list.
RESPONSES = 100
#: How many job orders are looked at, or made, between two turns of the loop: some 3 ms.
_PIECE = 50


class JobLists:
    """Follows the jobs. To be used in the gateway's loop.

    :param types: index of the namespace of the types.
    """

    def __init__(self, service: Service, types: int) -> None:
        self._service = service
        self._types = types
        self._orders: dict[str, tuple[Order, State, Substate, Any]] = {}
        self._responses: dict[str, Any] | None = None  # None: to be read from the store

    def on_event(self, event: Event) -> None:
        """Follows the gateway's events."""
        if event.kind == "reset":
            self._responses = None
        elif event.kind == "job" and self._responses is not None and event.data["state"] in FINAL:
            self._responses.pop(event.data["id"], None)
            if event.data["cleared"]:
                self._responses = None
            else:
                self._responses[event.data["id"]] = _encoded(job_response(Job.from_dict(event.data), self._types))
                while len(self._responses) > RESPONSES:
                    del self._responses[next(iter(self._responses))]

    async def prepare(self) -> None:
        """Makes what `orders` lacks, in pieces."""
        for number, job in enumerate(self._service.control.open_jobs):
            self._order(job)
            if number % _PIECE == _PIECE - 1:
                await asyncio.sleep(0)

    def orders(self) -> list[Any]:
        """Returns the job orders that have not ended, with their states, in the order of the queue."""
        made = {job.id: self._order(job) for job in self._service.control.open_jobs}
        self._orders = {job_id: self._orders[job_id] for job_id in made}
        return list(made.values())

    def _order(self, job: Job) -> Any:
        entry = self._orders.get(job.id)
        if entry is None or entry[0] is not job.order or entry[1:3] != (job.state, job.substate):
            made = _encoded(job_order_and_state(job, self._types))
            self._orders[job.id] = entry = job.order, job.state, job.substate, made
        return entry[3]

    def responses(self) -> list[Any]:
        """Returns the newest responses, the newest first.

        :raises StoreFailed: they cannot be read.
        """
        if self._responses is None:
            ended = list(self._service.store.jobs(JobFilter(state=FINAL), limit=RESPONSES))
            self._responses = {job.id: _encoded(job_response(job, self._types)) for job in reversed(ended)}
        return list(reversed(self._responses.values()))


def _encoded(structure: Any) -> ua.ExtensionObject:
    """Returns a structure as it is sent: a list of encoded ones is encoded in a tenth of the time."""
    return ua.ExtensionObject(ua.typeid_by_extension_objects[type(structure)], struct_to_binary(structure))


class ListVariable:
    """A variable whose value is a list of structures that is made when it is read. To be used in the gateway's loop.

    :param make: returns the structures; raises `SkirosError` if they are not available.
    """

    def __init__(self, server: Server, node: Node, make: Callable[[], list[Any]]) -> None:
        self._space, self._node, self._make = server.iserver.aspace, node, make
        self._make_when_read()

    @property
    def is_subscribed(self) -> bool:
        return bool(self._space[self._node.nodeid].attributes[ua.AttributeIds.Value].datachange_callbacks)

    async def send(self) -> None:
        """Sends the list to the clients that have subscribed to it."""
        await self._node.write_value(self._value())
        self._make_when_read()

    def _make_when_read(self) -> None:
        self._space.set_attribute_value_callback(self._node.nodeid, ua.AttributeIds.Value, lambda _, __: self._value())

    def _value(self) -> ua.DataValue:
        now = datetime.now(UTC)
        try:
            value = ua.Variant(self._make(), ua.VariantType.ExtensionObject, is_array=True)
        except SkirosError as error:
            log.error("OPC UA: %s is not available: %s", self._node, error)
            return ua.DataValue(StatusCode=ua.StatusCode(ua.StatusCodes.BadResourceUnavailable), ServerTimestamp=now)
        return ua.DataValue(value, SourceTimestamp=now, ServerTimestamp=now)


def prepare_before(server: Server, node: Node, prepare: Callable[[], Awaitable[None]]) -> None:
    """Has something done before clients read a node, or subscribe to it."""

    async def on_read(event: ServerItemCallback, _: Any) -> None:
        if any(each.NodeId == node.nodeid for each in event.request_params.NodesToRead):
            await prepare()

    async def create(params: ua.CreateMonitoredItemsParameters) -> Any:
        if any(each.ItemToMonitor.NodeId == node.nodeid for each in params.ItemsToCreate):
            await prepare()
        return await create_items(params)

    server.iserver.callback_service.addListener(CallbackType.PreRead, on_read)
    subscriptions = server.iserver.subscription_service
    create_items, subscriptions.create_monitored_items = subscriptions.create_monitored_items, create
