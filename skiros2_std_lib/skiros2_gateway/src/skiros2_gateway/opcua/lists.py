"""The lists of job orders and of the newest responses, as structures. Each is made once for each state of a job.

A list is made when a client reads it, or where one has subscribed to it, after changes: with thousands of jobs in the
queue a new one costs nothing else.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from datetime import UTC, datetime
from typing import Any

from asyncua import Node, Server, ua

from skiros2_common.core.errors import SkirosError
from skiros2_gateway.core.events import Event
from skiros2_gateway.core.job import FINAL, Job, Order, State, Substate
from skiros2_gateway.core.service import Service
from skiros2_gateway.core.store import JobFilter
from skiros2_gateway.opcua.orders import job_order_and_state, job_response

log = logging.getLogger(__name__)

#: How many of the newest responses are in the list.
RESPONSES = 100


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
                self._responses[event.data["id"]] = job_response(Job.from_dict(event.data), self._types)
                while len(self._responses) > RESPONSES:
                    del self._responses[next(iter(self._responses))]

    def orders(self) -> list[Any]:
        """Returns the job orders that have not ended, with their states, in the order of the queue."""
        known, self._orders = self._orders, {}
        for job in self._service.control.open_jobs:
            entry = known.get(job.id)
            if entry is None or entry[0] is not job.order or entry[1:3] != (job.state, job.substate):
                entry = job.order, job.state, job.substate, job_order_and_state(job, self._types)
            self._orders[job.id] = entry
        return [entry[3] for entry in self._orders.values()]

    def responses(self) -> list[Any]:
        """Returns the newest responses, the newest first.

        :raises StoreFailed: they cannot be read.
        """
        if self._responses is None:
            ended = list(self._service.store.jobs(JobFilter(state=FINAL), limit=RESPONSES))
            self._responses = {job.id: job_response(job, self._types) for job in reversed(ended)}
        return list(reversed(self._responses.values()))


class ListVariable:
    """A variable whose value is a list of structures that is made when it is read. To be used in the gateway's loop.

    :param make: returns the structures; raises `SkirosError` if they are not available.
    """

    def __init__(self, server: Server, node: Node, make: Callable[[], list[Any]]) -> None:
        self._space, self._node, self._make = server.iserver.aspace, node, make
        self._make_when_read()

    async def on_change(self) -> None:
        """Sends the list to the clients that have subscribed to it."""
        if self._space[self._node.nodeid].attributes[ua.AttributeIds.Value].datachange_callbacks:
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
