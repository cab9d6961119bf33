"""The methods of Job Control and the queue: the only place that changes jobs."""

from __future__ import annotations

import asyncio
import logging
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, replace
from typing import Any

from skiros2_common.core.errors import Conflict, Refused, SkirosError, UnknownName
from skiros2_common.core.names import nearest
from skiros2_gateway.core.cell import LOST, REACHED, UNKNOWN, Cell, Collected, Ending, Goal, Progress
from skiros2_gateway.core.deadline import check_deadline
from skiros2_gateway.core.events import EventStream
from skiros2_gateway.core.job import FINAL, Job, Method, Order, State, Substate
from skiros2_gateway.core.open_jobs import OpenJobs
from skiros2_gateway.core.outbox import Outbox
from skiros2_gateway.core.problems import Problem, Rejected, StoreFailed
from skiros2_gateway.core.store import JobStore
from skiros2_gateway.core.work_masters import WorkMasters

log = logging.getLogger(__name__)

#: The author of changes that the gateway makes itself.
GATEWAY = "gateway"

#: How often jobs with an earliest start are compared with the clock, which may be set (s).
_CLOCK_CHECK_PERIOD = 1.0

#: How long a store that refuses changes, and a cell that is not ready, are left alone (s).
_RETRY = 1.0


class JobControl:
    """Stores jobs, starts their goals in the cell, and keeps their responses. A `GoalListener`.

    To be used in the thread of the gateway's loop. What a method has changed is on the disk once `store.synced` has
    returned. A goal is sent when its job is on the disk: after a crash it is looked for in the cell, not sent again.

    :param clock: s since the epoch.
    """

    def __init__(
        self, store: JobStore, masters: WorkMasters, events: EventStream, clock: Callable[[], float] = time.time
    ) -> None:
        self.store = store
        self.masters = masters
        self.events = events
        self.clock = clock
        self._cell: Cell | None = None
        #: To be read only.
        self.jobs = OpenJobs(store, events)
        self._sequence = store.next_sequence()
        self._timer: asyncio.TimerHandle | None = None
        self._tasks: set[asyncio.Task[None]] = set()
        self._outbox = Outbox(store)

    @property
    def cell(self) -> Cell:
        """
        :raises Refused: the gateway has not started yet.
        """
        if self._cell is None:
            raise Refused("the gateway is starting")
        return self._cell

    def start(self, cell: Cell) -> None:
        """Continues with the jobs of the store."""
        self._cell = cell
        for job in self.jobs:
            if job.state in FINAL:
                self._collect(job)
            elif job.is_in_cell:
                log.info("job %s was %s when the gateway ended; looking for its goal", job.id, job.state)
                cell.follow(_goal_of(job))
                if job.state is State.INTERRUPTED and job.substate is Substate.HELD:
                    cell.pause(job.id)
        self._dispatch()

    def close(self) -> None:
        """Ends the background tasks. The jobs stay as they are."""
        if self._timer is not None:
            self._timer.cancel()
        self.jobs.close()
        self._outbox.clear()
        for task in self._tasks:
            task.cancel()
        self._cell = None

    # -- reading -----------------------------------------------------------------------------------------------

    @property
    def open_jobs(self) -> list[Job]:
        """The jobs that have not ended, in the order in which they would start; those that run come first."""
        return self.jobs.ordered()

    def get(self, job_id: str) -> Job:
        """Returns a job, also a cleared one.

        :raises UnknownName: there is no such job.
        """
        job = self.jobs.find(job_id)
        if job is None:
            near = ", ".join(nearest(job_id, self.jobs.ids())) or "none"
            raise UnknownName(f"there is no job {job_id!r}; near: {near}")
        return job

    # -- the methods -------------------------------------------------------------------------------------------

    async def put(
        self, order: Order, author: str, comment: str = "", *, start: bool, approved: dict[str, Any] | None = None
    ) -> tuple[Job, bool]:
        """Stores an order, and allows it to start if wanted: the methods Store and StoreAndStart.

        An order with the id and the content of a known job is that job, in the state that it has.

        :param approved: see `Job`.
        :returns: the job, and whether it is new.
        :raises Rejected: with all problems of the order.
        :raises Conflict: another order has the same id.
        :raises Refused: it is not what was approved: its work master has changed.
        :raises StoreFailed: the order is not stored.
        """
        known = self.find(order)
        goal = await self.check(order) if known is None else ""
        known = known or self.find(order)  # the same order may have come while this one was checked
        if known is not None:
            return known, False
        check_deadline()
        now, robots = self.clock(), self.masters.robots_of(order)
        _check_approved(approved, goal, robots)
        state = State.ALLOWED_TO_START if start else State.NOT_ALLOWED_TO_START
        job = Job(order, goal, self._sequence, now, now, state, author=author, robots=robots, approved=approved)
        job.substate = job.substate_before_start(now)
        self.jobs.save(job, author, Method.STORE_AND_START if start else Method.STORE, comment)
        self._sequence += 1
        self._dispatch()
        return self.jobs.open(job.id) or job, True

    async def check(self, order: Order) -> str:
        """Returns the goal of an order.

        :raises Rejected: with all problems of the order.
        """
        goal = self.masters.goal_of(order)
        elements = self.masters.get(order.work_master).elements(order.parameters) if order.work_master else {}
        problems = await self.cell.problems(goal, elements, self.masters.robots_of(order))
        if order.due and order.earliest_start and order.due < order.earliest_start:
            problems.append(Problem("wrong_value", "due", "the due time is before the earliest start"))
        if problems:
            raise Rejected(problems)
        return goal

    async def update(self, order: Order, author: str, comment: str = "") -> Job:
        """Replaces the order of a job that has not started.

        :raises Rejected: with all problems of the order.
        :raises Refused: it has started.
        :raises UnknownName: there is no such job.
        """
        self.get(order.id).check(Method.UPDATE)
        goal = await self.check(order)
        check_deadline()
        job, now = self.get(order.id), self.clock()  # it may have started meanwhile
        job.check(Method.UPDATE)
        job.place = None
        job.approved = None  # it is the order of whoever has changed it
        job.order, job.goal, job.robots, job.changed = order, goal, self.masters.robots_of(order), now
        job.substate = job.substate_before_start(now)
        self.jobs.save(job, author, Method.UPDATE, comment)
        self._dispatch()
        return self.jobs.open(job.id) or job

    def apply(self, method: Method, job_id: str, author: str, comment: str = "") -> Job:
        """Applies a method to a job. Pause, Resume, Stop and Abort of a running job take effect later.

        :raises Refused: the method is not allowed in its state.
        :raises UnknownName: there is no such job.
        """
        if method in (Method.STORE, Method.STORE_AND_START, Method.UPDATE):
            raise Refused(f"{method} needs an order")
        job = self.get(job_id)
        job.check(method)
        if job.id in self._outbox:  # only Abort is allowed
            job.substate = Substate.READY
        actions = {Method.PAUSE: self.cell.pause, Method.RESUME: self.cell.resume}
        in_cell = actions.get(method, self.cell.stop) if job.is_in_cell else None
        job.apply(method, author, self.clock())
        stops = in_cell is not None and method is not Method.RESUME
        if stops and in_cell is not None:
            in_cell(job.id)  # robots stop, whatever the disk does
        try:
            self.jobs.save(job, author, method, comment)
        except StoreFailed:
            if not stops:
                raise
            self._note(job, author, method, comment)
        self._outbox.discard(job.id)
        if in_cell is not None and not stops:
            in_cell(job.id)
        self._dispatch()
        return self.jobs.open(job.id) or job

    # -- a listener of the cell --------------------------------------------------------------------------------

    def cell_changed(self) -> None:
        self.events.publish("cell", self.cell.state())
        self._dispatch()

    def goal_accepted(self, goal_id: str) -> None:
        job = self.jobs.open(goal_id)
        if job is not None and job.substate is Substate.LOADED:
            job.response.started = now = self.clock()
            job.change(State.RUNNING, Substate.NONE, now)
            self._note(job, GATEWAY, "accepted")

    def goal_progress(self, goal_id: str, progress: Progress) -> None:
        self.goal_accepted(goal_id)
        job = self.jobs.open(goal_id)
        if job is None or not job.is_in_cell:
            return
        response = job.response
        response.phase, response.message = progress.phase, progress.message
        response.plan, response.steps = progress.plan, progress.steps
        response.robots = sorted({*response.robots, *(step["robot"] for step in progress.steps)})
        job.changed = self.clock()
        self.jobs.update(job)
        others = set(response.robots) - set(job.robots)
        if job.robots and others and not job.wanted:
            job.wanted = Method.ABORT
            text = f"the plan uses {', '.join(sorted(others))}, allowed are {', '.join(job.robots)}"
            response.notes = [*response.notes, text]
            self.cell.stop(job.id)
            self._note(job, GATEWAY, Method.ABORT, text)

    def goal_suspended(self, goal_id: str, reason: str) -> None:
        job = self.jobs.open(goal_id)
        if job is None or job.wanted:
            return
        if reason and job.state is State.RUNNING:
            job.change(State.INTERRUPTED, Substate.SUSPENDED, self.clock())
            self._note(job, GATEWAY, "suspended", reason)
        elif not reason and job.state is State.INTERRUPTED and job.substate is Substate.SUSPENDED:
            job.change(State.RUNNING, Substate.NONE, self.clock())
            self._note(job, GATEWAY, "resumed")

    def goal_ended(self, goal_id: str, ending: Ending) -> None:
        if ending.outcome not in (LOST, UNKNOWN):
            self.goal_accepted(goal_id)
        job = self.jobs.open(goal_id)
        if job is None or not job.is_in_cell:
            return
        if ending.outcome == UNKNOWN:
            if job.substate is Substate.LOADED and not job.wanted:
                self.cell.start(_goal_of(job))
                return
            ending = replace(ending, outcome=LOST)
        job.response.end(ending, now := self.clock(), self.cell.revision)
        is_ended = ending.outcome != LOST and (ending.outcome in REACHED or job.wanted == Method.STOP)
        job.wanted = ""
        job.change(*((State.ENDED, Substate.COMPLETED) if is_ended else (State.ABORTED, Substate.NONE)), now)
        self._note(job, GATEWAY, "ended", f"{ending.outcome}: {ending.message}")
        log.info("job %s: %s: %s", job.id, ending.outcome, ending.message)
        self._collect(job)
        self._dispatch()

    # -- internals ---------------------------------------------------------------------------------------------

    def _dispatch(self) -> None:
        """Starts the jobs that may start now, and sets a timer for the next earliest start."""
        if self._timer is not None:
            self._timer.cancel()
        if self._cell is None:
            return
        try:
            self.jobs.write_unwritten()
        except StoreFailed as error:
            log.error("no job starts: %s", error)
            self._retry()
            return
        now = self.clock()
        if (later := self.jobs.next_start(now)) is not None:
            self._retry(min(_CLOCK_CHECK_PERIOD, max(0.01, later - now)))
        if not self._cell.is_ready:
            if self.jobs.has_queue:  # the cell reports changes between its looks only, and may be ready at the next one
                self._retry()
            return
        for job in self.jobs.queue:
            urgent = job.order.priority >= self._cell.interrupt_priority
            if self.jobs.in_cell >= self._cell.capacity and not urgent:
                return  # nor does one of those that follow
            if job.earliest <= now:
                loaded = job.copy()
                loaded.change(State.ALLOWED_TO_START, Substate.LOADED, now)
                loaded.response.first_change = self._cell.revision
                try:
                    self.jobs.save(loaded, GATEWAY, "loaded")
                except StoreFailed as error:
                    log.error("job %s does not start: %s", job.id, error)
                    self._retry()
                    return
                self._outbox.send(_goal_of(loaded), self._cell.start)

    def _note(self, job: Job, author: str, method: str, comment: str = "") -> None:
        if not self.jobs.note(job, author, method, comment):
            self._retry()

    def _retry(self, delay: float = _RETRY) -> None:
        """Starts jobs later (s). They wait meanwhile: a goal is never sent before that is written."""
        if self._timer is not None:
            self._timer.cancel()
        self._timer = asyncio.get_running_loop().call_later(delay, self._dispatch)

    def find(self, order: Order) -> Job | None:
        """Returns the job of an order, or None; raises `Conflict` if another order has its id."""
        known = self.jobs.find(order.id)
        if known is not None and known.order.digest != order.digest:
            raise Conflict(f"job {order.id} exists with different content; Update it, or use another id")
        return known

    def _collect(self, job: Job) -> None:
        self._tasks.add(task := asyncio.get_running_loop().create_task(self._collected(job)))
        task.add_done_callback(self._tasks.discard)

    async def _collected(self, job: Job) -> None:
        found = await _collect(self.cell, self.masters, job, self.clock())
        job = self.jobs.open(job.id) or job  # it may have been cleared meanwhile
        response = job.response
        response.changes, response.quality, response.collected = found.changes, found.quality, True
        response.notes = [*response.notes, *found.notes]
        if job.state is State.ENDED:
            job.change(State.ENDED, Substate.CLOSED, self.clock())
        self._note(job, GATEWAY, "collected")
        self.events.publish("response", {"job": job.id, **asdict(response)})


async def _collect(cell: Cell, masters: WorkMasters, job: Job, now: float) -> Collected:
    """Reads what a job has changed, by the numbers of the changes: the clock may have been set."""
    response, order = job.response, job.order
    master = masters.all.get(order.work_master)
    sources = master.quality_sources(order.parameters) if master is not None else {}
    start: float = response.first_change
    end: float = response.last_change or cell.revision
    if not start:  # the job has never run, or was started by an earlier version
        start, end = response.started or response.ended or job.changed, response.ended or now
    try:
        return await cell.collect(response.robots, start, end, sources)
    except Exception as error:  # the job has ended, whatever the cell does
        log.log(logging.INFO if isinstance(error, SkirosError) else logging.ERROR, "job %s", job.id, exc_info=error)
        return Collected(notes=[f"the changes are unknown: {error}"])


def _check_approved(approved: Mapping[str, Any] | None, goal: str, robots: Sequence[str]) -> None:
    """
    :param approved: None: it needs no approval.
    :raises Refused: another goal or other robots were approved.
    """
    if approved is None:
        return
    if goal != approved["goal"]:
        raise Refused(f"it would not run as approved: the goal is {goal}, approved is {approved['goal']}")
    for step in approved["plan"]:
        if robots and step["robot"] not in robots:
            raise Refused(f"it would not run as approved: {step['robot']} is not allowed any more")


def _goal_of(job: Job) -> Goal:
    plan = tuple(job.approved["plan"]) if job.approved is not None else None
    return Goal(job.id, job.goal, job.order.priority, job.order.quality, job.robots, plan, job.order.on_restart)
