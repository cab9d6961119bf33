"""The lists of job orders and of the newest responses, as structures. Each is made once for each state of a job."""

from __future__ import annotations

from typing import Any

from skiros2_gateway.core.events import Event
from skiros2_gateway.core.job import FINAL, Job, Order, State, Substate
from skiros2_gateway.core.service import Service
from skiros2_gateway.core.store import JobFilter
from skiros2_gateway.opcua.orders import job_order_and_state, job_response

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
