"""Executes goals, any number at once: plans, runs the steps on robots and monitors the world model."""

from __future__ import annotations

import logging
import queue
import threading
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import count
from typing import Protocol

from skiros2_common.core.errors import SkirosError, WrongValue
from skiros2_common.core.explanation import Explanation
from skiros2_task.core.commands import Claim, Command, End, MakePlan, ReadWorld, Start, Stop, Wake
from skiros2_task.core.engines import Limits
from skiros2_task.core.event_queue import EventQueue
from skiros2_task.core.execution import ExecutionStateMachine, Phase, StepRecord
from skiros2_task.core.given_plan import GivenPlan
from skiros2_task.core.plan import Step
from skiros2_task.core.planners import Planner
from skiros2_task.core.planning import PlanningResult, TaskPlanner, Verdict
from skiros2_task.core.resources import Resources
from skiros2_task.core.task import PlanningTask
from skiros2_task.core.undeclared import AuthoredChange, UndeclaredChanges

log = logging.getLogger(__name__)

#: The shortest time between two reads of a changing world (s), and the largest share of the time spent on reading.
_READ_PERIOD, _READ_SHARE = 0.05, 0.2

#: The delay before a failed read of the world model is repeated (s).
_RETRY_DELAY = 1.0

#: Reports the end of a step: whether it succeeded, a message and why it failed. Called by any thread.
Ended = Callable[[bool, str, Sequence[Explanation]], None]


class StepRunner(Protocol):
    """Runs steps on robots."""

    def start(self, step: Step, ended: Ended) -> Callable[[], None]:
        """Starts a step without blocking. Returns a function that stops it.

        :param ended: called once, also after a stop.
        """


@dataclass(frozen=True)
class Goal:
    """A goal to achieve.

    :param text: see `goal_text`.
    :param priority: of goals that need the same robot, the one with the highest priority gets it first.
    :param interrupts: whether it stops the steps of goals with a lower priority that use the robots of its plan.
    :param limits, planner: for each planning; None: those of the `TaskPlanner`.
    :param max_replans: how often a broken plan is replaced at most; 0 for a given plan.
    """

    text: str
    priority: int = 0
    limits: Limits | None = None
    planner: Planner | GivenPlan | None = None
    max_replans: int = 5
    interrupts: bool = False


@dataclass
class GoalExecution:
    """A goal in execution. `machine` belongs to the executor's thread, which calls the callbacks.

    :param on_change: called after each change of a step or of the phase.
    :param on_end: called once, last.
    """

    name: str
    goal: Goal
    on_change: Callable[[GoalExecution], None]
    on_end: Callable[[GoalExecution, End], None]
    machine: ExecutionStateMachine
    undeclared: UndeclaredChanges
    cancelled: threading.Event = field(default_factory=threading.Event)
    stops: dict[int, Callable[[], None]] = field(default_factory=dict)  # stop functions of running steps, by number
    work: queue.SimpleQueue[Callable[[], None] | None] = field(default_factory=queue.SimpleQueue)
    world_changed: bool = False  # since the last read
    reading: bool = False
    next_read: float = 0.0

    @property
    def started(self) -> list[StepRecord]:
        """The started steps, in the order of their starts."""
        records = [r for r in self.machine.records.values() if r.started is not None]
        return sorted(records, key=lambda record: (record.started, record.step.number))


class GoalExecutor:
    """Executes goals. One thread owns all state; each goal has another thread that plans and reads the world model."""

    def __init__(self, planner: TaskPlanner, runner: StepRunner) -> None:
        self._planner = planner
        self._runner = runner
        self._resources = Resources()
        self._executions: dict[str, GoalExecution] = {}
        self._lost: set[str] = set()
        self._events = EventQueue()
        self._ids = count(1)
        self._thread = threading.Thread(target=self._run, name="goal executor", daemon=True)
        self._thread.start()

    # -- any thread --------------------------------------------------------------------------------------------

    def achieve(
        self,
        goal: Goal,
        on_change: Callable[[GoalExecution], None],
        on_end: Callable[[GoalExecution, End], None],
    ) -> GoalExecution:
        """Starts to execute a goal. Does not block."""
        machine = ExecutionStateMachine(time.monotonic, goal.max_replans)
        undeclared = UndeclaredChanges(time.monotonic)
        execution = GoalExecution(f"goal {next(self._ids)}", goal, on_change, on_end, machine, undeclared)
        threading.Thread(target=self._work, args=(execution,), name=execution.name, daemon=True).start()
        self._events.put(lambda: self._begin(execution))
        return execution

    def cancel(self, execution: GoalExecution) -> None:
        """Cancels a goal. Its running steps are stopped at once, whatever the executor's thread does."""
        execution.cancelled.set()
        self._events.put(lambda: self._execute(execution, execution.machine.cancel()))
        for stop in list(execution.stops.values()):
            stop()

    def world_changed(self, change: AuthoredChange | None = None) -> None:
        """Reports that the world model has changed.

        :param change: with its author, to find undeclared changes of steps; None: unknown.
        """
        self._events.put(lambda: self._read_for_all(change))

    def robot_lost(self, manager: str) -> None:
        """Reports that a robot's manager has disappeared and its steps have ended."""
        self._events.put(lambda: self._on_robot(manager, False))

    def robot_found(self, manager: str) -> None:
        """Reports that a robot's manager has appeared."""
        self._events.put(lambda: self._on_robot(manager, True))

    def close(self, timeout: float = 10.0) -> None:
        """Cancels all goals and waits until they have ended.

        :param timeout: the longest wait (s).
        """
        self._events.put(self._cancel_all)
        self._events.put(None)
        if threading.current_thread() is not self._thread:
            self._thread.join(timeout)

    # -- the executor's thread ---------------------------------------------------------------------------------

    def _run(self) -> None:
        closing = False
        while not (closing and not self._executions):
            event = self._events.get()
            if event is None:
                closing = True
                continue
            try:
                event()
            except Exception:
                log.exception("executing goals")

    def _after(self, seconds: float, event: Callable[[], None]) -> None:
        self._events.put_later(seconds, event)

    def _begin(self, execution: GoalExecution) -> None:
        self._executions[execution.name] = execution
        for manager in self._lost:
            execution.machine.robot_lost(manager)
        self._execute(execution, execution.machine.begin())

    def _cancel_all(self) -> None:
        for execution in list(self._executions.values()):
            execution.cancelled.set()
            self._execute(execution, execution.machine.cancel())

    def _on_robot(self, manager: str, found: bool) -> None:
        (self._lost.discard if found else self._lost.add)(manager)
        for execution in list(self._executions.values()):
            machine = execution.machine
            self._execute(execution, machine.robot_found(manager) if found else machine.robot_lost(manager))

    def _execute(self, execution: GoalExecution, commands: Sequence[Command]) -> None:
        """Executes commands of a goal's state machine. An unexpected exception ends the goal as failed."""
        try:
            self._execute_each(execution, commands)
        except Exception as error:
            self._fail(execution, error)

    def _fail(self, execution: GoalExecution, error: Exception) -> None:
        """Ends a goal after an unexpected exception."""
        message = _internal_error(error)
        execution.cancelled.set()
        for stop in execution.stops.values():
            stop()
        if execution.name in self._executions:
            self._end(execution, End(Verdict.FAILED, message))

    def _execute_each(self, execution: GoalExecution, commands: Sequence[Command]) -> None:
        for command in commands:
            if isinstance(command, MakePlan):
                self._plan(execution, command)
            elif isinstance(command, Claim):
                priority = execution.goal.priority
                self._grant(self._resources.request(execution.name, priority, command.requested, command.in_use))
                if execution.goal.interrupts:
                    for other, names in self._resources.lower_holders(execution.name).items():
                        self._events.put(partial(self._interrupt, other, names))
            elif isinstance(command, Start):
                self._start(execution, command.step)
            elif isinstance(command, Stop):
                execution.stops[command.number]()
            elif isinstance(command, ReadWorld):
                execution.world_changed = True
                self._after(command.delay, lambda: self._schedule_read(execution))
            elif isinstance(command, Wake):
                self._after(command.delay, lambda: self._execute(execution, execution.machine.wake()))
            else:
                self._end(execution, command)
                return
        if commands:
            execution.on_change(execution)

    def _plan(self, execution: GoalExecution, command: MakePlan) -> None:
        busy = self._resources.held_by_others(execution.name)
        first = execution.machine.first_number
        execution.work.put(lambda: self._make_plan(execution, command, busy, first))

    def _compare(self, execution: GoalExecution, task: PlanningTask | None) -> None:
        """Logs facts that steps have changed without declaring it.

        :param task: the goal's task for the current world; None if it cannot be read.
        """
        if task is not None:
            machine = execution.machine
            for change in execution.undeclared.compare(machine.facts, task.init, machine.records.values()):
                log.info("%s: %s", execution.name, change)

    def _planned(self, execution: GoalExecution, task: PlanningTask, steps: Sequence[Step]) -> None:
        self._compare(execution, task)
        self._execute(execution, execution.machine.planned(task, steps))

    def _no_plan(self, execution: GoalExecution, task: PlanningTask | None, result: PlanningResult) -> None:
        self._compare(execution, task)
        # Goals that wait for others to end do not wait for each other.
        others = (other.machine.phase for other in self._executions.values() if other is not execution)
        busy = any(phase is not Phase.BLOCKED for phase in others)
        self._execute(execution, execution.machine.no_plan(result.verdict, result.message, busy, result.missing))

    def _grant(self, owners: Iterable[str]) -> None:
        """Notifies goals of their resources, in separate events: one goal may change what another is granted."""
        for owner in owners:
            self._events.put(partial(self._granted, self._executions[owner]))

    def _granted(self, execution: GoalExecution) -> None:
        self._execute(execution, execution.machine.granted())

    def _interrupt(self, name: str, names: frozenset[str]) -> None:
        execution = self._executions.get(name)
        if execution is not None:
            self._execute(execution, execution.machine.interrupt(names))

    def _start(self, execution: GoalExecution, step: Step) -> None:
        def ended(succeeded: bool, message: str, explanations: Sequence[Explanation]) -> None:
            self._events.put(lambda: self._ended(execution, step, succeeded, message, explanations))

        log.info("%s: %s", execution.name, step)
        execution.stops[step.number] = stop = self._runner.start(step, ended)
        if execution.cancelled.is_set():  # just now
            stop()

    def _ended(
        self, execution: GoalExecution, step: Step, succeeded: bool, message: str, explanations: Sequence[Explanation]
    ) -> None:
        execution.stops.pop(step.number, None)
        self._execute(execution, execution.machine.ended(step.number, succeeded, message, explanations))

    def _end(self, execution: GoalExecution, end: End) -> None:
        undeclared = str(execution.undeclared)
        if undeclared and end.verdict not in (*_GOOD, Verdict.CANCELLED):
            end = replace(end, message=f"{end.message}\n{undeclared}")
        log.log(logging.INFO if end.verdict in _GOOD else logging.WARNING, "%s: %s", execution.name, end.message)
        del self._executions[execution.name]
        execution.cancelled.set()
        execution.work.put(None)
        granted = self._resources.release(execution.name)
        execution.on_end(execution, end)
        self._grant(granted)
        for other in list(self._executions.values()):
            self._execute(other, other.machine.retry())

    # -- reading the world model -------------------------------------------------------------------------------

    def _read_for_all(self, change: AuthoredChange | None) -> None:
        for execution in self._executions.values():
            if change is not None:
                execution.undeclared.add(change)
            execution.world_changed = True
            self._schedule_read(execution)

    def _schedule_read(self, execution: GoalExecution) -> None:
        """Reads the world model for a goal, unless it is being read or has not changed."""
        if execution.reading or not execution.world_changed:
            return
        execution.reading = True
        delay = execution.next_read - time.monotonic()
        if delay > 0:
            self._after(delay, lambda: self._start_read(execution))
        else:
            self._start_read(execution)

    def _start_read(self, execution: GoalExecution) -> None:
        execution.world_changed = False
        execution.work.put(lambda: self._read(execution))

    def _on_read(self, execution: GoalExecution, task: PlanningTask | SkirosError, seconds: float) -> None:
        execution.reading = False
        execution.next_read = time.monotonic() + max(_READ_PERIOD, seconds / _READ_SHARE)
        if isinstance(task, PlanningTask):
            self._compare(execution, task)
            self._execute(execution, execution.machine.world(task))
            self._schedule_read(execution)
        elif isinstance(task, WrongValue):
            self._execute(execution, execution.machine.unreadable(str(task)))
        else:
            log.warning("%s: world model read failed, retrying in %g s: %s", execution.name, _RETRY_DELAY, task)
            execution.world_changed = True
            self._after(_RETRY_DELAY, lambda: self._schedule_read(execution))

    # -- the thread of a goal ----------------------------------------------------------------------------------

    def _work(self, execution: GoalExecution) -> None:
        while (work := execution.work.get()) is not None:
            try:
                work()
            except Exception as error:
                self._events.put(partial(self._fail, execution, error))

    def _read(self, execution: GoalExecution) -> None:
        start = time.monotonic()
        task: PlanningTask | SkirosError
        try:
            task = self._planner.read_task(execution.goal.text)
        except Exception as error:
            task = error if isinstance(error, SkirosError) else WrongValue(_internal_error(error))
        seconds = time.monotonic() - start
        self._events.put(lambda: self._on_read(execution, task, seconds))

    def _make_plan(self, execution: GoalExecution, command: MakePlan, busy: frozenset[str], first: int) -> None:
        """Plans first with the robots that are free and the skills that have not failed, then with all."""
        lost = {(manager, "") for manager in command.lost}
        preferred = lost | {(manager, "") for manager in busy} | command.avoided
        for avoided in (preferred, lost) if preferred != lost else (lost,):
            task, result = self._result(execution, command.running, frozenset(avoided))
            if result.verdict in _GOOD or result.verdict is Verdict.CANCELLED:
                break
        if task is None or result.task is None or result.verdict not in _GOOD:  # None: the goal cannot be read
            self._events.put(lambda: self._no_plan(execution, task, result))
            return
        steps = result.plan.numbered_from(first) if result.plan is not None else ()
        world = task
        self._events.put(lambda: self._planned(execution, world, steps))

    def _result(
        self, execution: GoalExecution, running: Iterable[Step], avoided: frozenset[tuple[str, str]]
    ) -> tuple[PlanningTask | None, PlanningResult]:
        """Plans. Returns the task for the current world as well; None if the goal cannot be read."""
        tasks: list[PlanningTask] = []

        def adapt(task: PlanningTask) -> PlanningTask:
            tasks.append(task)
            facts = task.init
            for step in running:
                facts = step.apply(facts)
            return task.after(facts).without_skills(avoided)

        goal = execution.goal
        try:
            result = self._planner.plan(
                goal.text, execution.cancelled, limits=goal.limits, planner=goal.planner, adapt=adapt
            )
        except Exception as error:
            message = str(error) if isinstance(error, SkirosError) else _internal_error(error)
            result = PlanningResult(Verdict.FAILED, message)
        return (tasks[0] if tasks else None), result


def _internal_error(error: Exception) -> str:
    """Logs an unexpected exception. Returns its text."""
    log.error("executing a goal", exc_info=error)
    return f"internal error: {type(error).__name__}: {error}"


_GOOD = (Verdict.PLANNED, Verdict.NOTHING_TO_DO)
