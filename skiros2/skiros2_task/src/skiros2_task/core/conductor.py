"""Carries out goals, several at once: plans them, has robots do the steps, and watches the world meanwhile."""

from __future__ import annotations

import heapq
import logging
import queue
import threading
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from itertools import count
from typing import Protocol

from skiros2_common.core.errors import SkirosError, WrongValue
from skiros2_common.core.explanation import Explanation
from skiros2_task.core.claims import Claims
from skiros2_task.core.commands import Claim, Command, End, Look, Phase, Plan, Record, Start, Stop, Wake
from skiros2_task.core.execution import Executive
from skiros2_task.core.jobs import Job, make_jobs, with_jobs_done, without_skills
from skiros2_task.core.planner import Limits, Planner
from skiros2_task.core.task import PlanningTask
from skiros2_task.core.task_planner import PlanningResult, TaskPlanner, Verdict

log = logging.getLogger(__name__)

#: Between two looks at a world that changes (s), and how much of the time looks may take at most.
_LOOK_PERIOD, _LOOK_SHARE = 0.05, 0.2

#: When a look is tried again after the world model did not answer (s).
_LOOK_AGAIN = 1.0

#: Told how a step has ended: well or not, the message, why it failed. Any thread.
Ended = Callable[[bool, str, Sequence[Explanation]], None]


class Robots(Protocol):
    """Those who do the steps."""

    def start(self, job: Job, ended: Ended) -> Callable[[], None]:
        """Has a step done, and returns what stops it. Does not block. `ended` is called once, also after a stop."""


@dataclass(frozen=True)
class Goal:
    """What is to be achieved.

    :param text: as `GoalReader` reads it.
    :param priority: the goal with the higher one gets the robots first.
    :param limits, planner: of each planning; None: as for all requests.
    :param max_replans: how often it is planned anew at most.
    """

    text: str
    priority: int = 0
    limits: Limits | None = None
    planner: Planner | None = None
    max_replans: int = 5


@dataclass
class Achievement:
    """A goal that is being carried out. `executive` belongs to the conductor's thread, which calls the callbacks.

    :param on_change: called whenever a step or the phase has changed.
    :param on_end: called once, last.
    """

    name: str
    goal: Goal
    on_change: Callable[[Achievement], None]
    on_end: Callable[[Achievement, End], None]
    executive: Executive
    cancelled: threading.Event = field(default_factory=threading.Event)
    stops: dict[int, Callable[[], None]] = field(default_factory=dict)  # of the steps that run
    work: queue.SimpleQueue[Callable[[], None] | None] = field(default_factory=queue.SimpleQueue)
    stale: bool = False  # the world has changed since it was looked at
    looking: bool = False
    next_look: float = 0.0

    @property
    def done(self) -> list[Record]:
        """The steps that were started, in the order of their starts."""
        begun = [r for r in self.executive.records.values() if r.began is not None]
        return sorted(begun, key=lambda record: (record.began, record.job.number))


class Conductor:
    """One thread has all that goes on; each goal has another, which plans and looks at the world.

    :param planner: makes the plans.
    :param robots: do the steps.
    """

    def __init__(self, planner: TaskPlanner, robots: Robots) -> None:
        self._planner = planner
        self._robots = robots
        self._claims = Claims()
        self._all: dict[str, Achievement] = {}
        self._gone: set[str] = set()
        self._events: queue.SimpleQueue[Callable[[], None] | None] = queue.SimpleQueue()
        self._later: list[tuple[float, int, Callable[[], None]]] = []  # a heap
        self._ids = count(1)
        self._thread = threading.Thread(target=self._run, name="conductor", daemon=True)
        self._thread.start()

    # -- any thread --------------------------------------------------------------------------------------------

    def achieve(
        self,
        goal: Goal,
        on_change: Callable[[Achievement], None],
        on_end: Callable[[Achievement, End], None],
    ) -> Achievement:
        """Begins to carry out a goal. Does not wait."""
        executive = Executive(time.monotonic, goal.max_replans)
        achievement = Achievement(f"goal {next(self._ids)}", goal, on_change, on_end, executive)
        threading.Thread(target=self._work, args=(achievement,), name=achievement.name, daemon=True).start()
        self._events.put(lambda: self._begin(achievement))
        return achievement

    def cancel(self, achievement: Achievement) -> None:
        """Ends a goal before its time; its steps are stopped."""
        achievement.cancelled.set()
        self._events.put(lambda: self._do(achievement, achievement.executive.cancel()))

    def world_changed(self) -> None:
        """Says that the world is not as it was."""
        self._events.put(self._look_everywhere)

    def robot_gone(self, manager: str) -> None:
        """Says that a robot's manager is not there any more, and what it ran has ended."""
        self._events.put(lambda: self._robot(manager, False))

    def robot_back(self, manager: str) -> None:
        """Says that a robot's manager is there."""
        self._events.put(lambda: self._robot(manager, True))

    def close(self, timeout: float = 10.0) -> None:
        """Cancels all goals and waits until they have ended.

        :param timeout: s to wait at most.
        """
        self._events.put(self._cancel_all)
        self._events.put(None)
        if threading.current_thread() is not self._thread:
            self._thread.join(timeout)

    # -- the conductor's thread --------------------------------------------------------------------------------

    def _run(self) -> None:
        closing = False
        while not (closing and not self._all):
            event = self._next_event()
            if event is None:
                closing = True
                continue
            try:
                event()
            except Exception:
                log.exception("carrying out goals")

    def _next_event(self) -> Callable[[], None] | None:
        """Waits for what happens next, or for the time of what is to be done later."""
        left = self._later[0][0] - time.monotonic() if self._later else None
        try:
            if left is None or left > 0:
                return self._events.get(timeout=left)
        except queue.Empty:
            log.debug("it is time")
        return heapq.heappop(self._later)[2]

    def _after(self, seconds: float, event: Callable[[], None]) -> None:
        heapq.heappush(self._later, (time.monotonic() + seconds, next(self._ids), event))

    def _begin(self, achievement: Achievement) -> None:
        self._all[achievement.name] = achievement
        for manager in self._gone:
            achievement.executive.robot_gone(manager)
        self._do(achievement, achievement.executive.begin())

    def _cancel_all(self) -> None:
        for achievement in list(self._all.values()):
            achievement.cancelled.set()
            self._do(achievement, achievement.executive.cancel())

    def _robot(self, manager: str, there: bool) -> None:
        (self._gone.discard if there else self._gone.add)(manager)
        for achievement in list(self._all.values()):
            executive = achievement.executive
            self._do(achievement, executive.robot_back(manager) if there else executive.robot_gone(manager))

    def _do(self, achievement: Achievement, commands: Sequence[Command]) -> None:
        """Does what an executive asks for. A mistake of our own ends the goal, and not in silence."""
        try:
            self._carry_out(achievement, commands)
        except Exception as error:
            log.exception("%s", achievement.name)
            message = f"internal error: {type(error).__name__}: {error}"
            achievement.cancelled.set()
            for stop in achievement.stops.values():
                stop()
            if achievement.name in self._all:
                self._end(achievement, End(Verdict.FAILED, message))

    def _carry_out(self, achievement: Achievement, commands: Sequence[Command]) -> None:
        for command in commands:
            if isinstance(command, Plan):
                self._plan(achievement, command)
            elif isinstance(command, Claim):
                self._serve(
                    self._claims.want(achievement.name, achievement.goal.priority, command.wanted, command.in_use)
                )
            elif isinstance(command, Start):
                self._start(achievement, command.job)
            elif isinstance(command, Stop):
                achievement.stops[command.number]()
            elif isinstance(command, Look):
                achievement.stale = True
                self._after(command.after, lambda: self._look(achievement))
            elif isinstance(command, Wake):
                self._after(command.after, lambda: self._do(achievement, achievement.executive.wake()))
            else:
                self._end(achievement, command)
                return
        if commands:
            achievement.on_change(achievement)

    def _plan(self, achievement: Achievement, command: Plan) -> None:
        busy = self._claims.held_by_others(achievement.name)
        first = achievement.executive.first_number
        achievement.work.put(lambda: self._make_plan(achievement, command, busy, first))

    def _no_plan(self, achievement: Achievement, result: PlanningResult) -> None:
        # Goals that wait for others to end do not wait for each other.
        others = (other.executive.phase for other in self._all.values() if other is not achievement)
        busy = any(phase is not Phase.BLOCKED for phase in others)
        self._do(achievement, achievement.executive.no_plan(result.verdict, result.message, busy))

    def _serve(self, owners: Iterable[str]) -> None:
        """Tells goals that they have what they wanted; after this event, for one may undo what another is told."""
        for owner in owners:
            achievement = self._all[owner]
            self._events.put(lambda achievement=achievement: self._granted(achievement))  # type: ignore[misc]

    def _granted(self, achievement: Achievement) -> None:
        self._do(achievement, achievement.executive.granted())

    def _start(self, achievement: Achievement, job: Job) -> None:
        def ended(succeeded: bool, message: str, explanations: Sequence[Explanation]) -> None:
            self._events.put(lambda: self._ended(achievement, job, succeeded, message, explanations))

        log.info("%s: %s", achievement.name, job)
        achievement.stops[job.number] = self._robots.start(job, ended)

    def _ended(
        self, achievement: Achievement, job: Job, succeeded: bool, message: str, explanations: Sequence[Explanation]
    ) -> None:
        achievement.stops.pop(job.number, None)
        self._do(achievement, achievement.executive.ended(job.number, succeeded, message, explanations))

    def _end(self, achievement: Achievement, end: End) -> None:
        log.log(logging.INFO if end.verdict in _GOOD else logging.WARNING, "%s: %s", achievement.name, end.message)
        del self._all[achievement.name]
        achievement.cancelled.set()
        achievement.work.put(None)
        served = self._claims.drop(achievement.name)
        achievement.on_end(achievement, end)
        self._serve(served)
        for other in list(self._all.values()):
            self._do(other, other.executive.freed())

    # -- looking at the world ----------------------------------------------------------------------------------

    def _look_everywhere(self) -> None:
        for achievement in self._all.values():
            achievement.stale = True
            self._look(achievement)

    def _look(self, achievement: Achievement) -> None:
        """Has the world looked at, soon."""
        if achievement.looking or not achievement.stale:
            return
        achievement.looking = True
        wait = achievement.next_look - time.monotonic()
        if wait > 0:
            self._after(wait, lambda: self._look_now(achievement))
        else:
            self._look_now(achievement)

    def _look_now(self, achievement: Achievement) -> None:
        achievement.stale = False
        achievement.work.put(lambda: self._make_look(achievement))

    def _looked(self, achievement: Achievement, task: PlanningTask | SkirosError, seconds: float) -> None:
        achievement.looking = False
        achievement.next_look = time.monotonic() + max(_LOOK_PERIOD, seconds / _LOOK_SHARE)
        if isinstance(task, PlanningTask):
            self._do(achievement, achievement.executive.world(task))
            self._look(achievement)
        elif isinstance(task, WrongValue):
            self._do(achievement, achievement.executive.unreadable(str(task)))
        else:
            log.warning("%s: the world model is tried again in %g s: %s", achievement.name, _LOOK_AGAIN, task)
            achievement.stale = True
            self._after(_LOOK_AGAIN, lambda: self._look(achievement))

    # -- the thread of a goal ----------------------------------------------------------------------------------

    def _work(self, achievement: Achievement) -> None:
        while (task := achievement.work.get()) is not None:
            task()

    def _make_look(self, achievement: Achievement) -> None:
        start = time.monotonic()
        seen: PlanningTask | SkirosError
        try:
            seen = self._planner.look(achievement.goal.text)
        except SkirosError as error:
            seen = error
        except Exception as error:
            log.exception("looking at the world for %s", achievement.goal.text)
            seen = WrongValue(f"internal error: {type(error).__name__}: {error}")
        seconds = time.monotonic() - start
        self._events.put(lambda: self._looked(achievement, seen, seconds))

    def _make_plan(self, achievement: Achievement, command: Plan, busy: frozenset[str], first: int) -> None:
        """Plans, first with what is free and trusted alone, then with all that is there."""
        gone = {(manager, "") for manager in command.gone}
        preferred = gone | {(manager, "") for manager in busy} | command.avoided
        for avoided in (preferred, gone) if preferred != gone else (gone,):
            seen, result = self._result(achievement, command.running, frozenset(avoided))
            if result.verdict in _GOOD or result.verdict is Verdict.CANCELLED:
                break
        if seen is None or result.task is None or result.verdict not in _GOOD:  # the goal may not even be readable
            self._events.put(lambda: self._no_plan(achievement, result))
            return
        jobs = make_jobs(result.task, result.schedule, result.calls, first) if result.schedule is not None else ()
        world = seen
        self._events.put(lambda: self._do(achievement, achievement.executive.planned(world, jobs)))

    def _result(
        self, achievement: Achievement, running: Iterable[Job], avoided: frozenset[tuple[str, str]]
    ) -> tuple[PlanningTask | None, PlanningResult]:
        """What planning gives, and the world that it was made for."""
        seen: list[PlanningTask] = []

        def adapt(task: PlanningTask) -> PlanningTask:
            seen.append(task)
            return without_skills(with_jobs_done(task, running), avoided)

        goal = achievement.goal
        try:
            result = self._planner.plan(
                goal.text, achievement.cancelled, limits=goal.limits, planner=goal.planner, adapt=adapt
            )
        except SkirosError as error:
            result = PlanningResult(Verdict.FAILED, message=str(error))
        except Exception as error:
            log.exception("planning %s", goal.text)
            result = PlanningResult(Verdict.FAILED, message=f"internal error: {type(error).__name__}: {error}")
        return (seen[0] if seen else None), result


_GOOD = (Verdict.PLANNED, Verdict.NOTHING_TO_DO)
