"""Executes goals, any number at once: plans, runs the steps on robots and monitors the world model."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from functools import partial
from itertools import count

from skiros2_common.core.errors import SkirosError, WrongValue
from skiros2_common.core.explanation import Explanation
from skiros2_common.core.manager_names import matching_name
from skiros2_common.core.operations import Change
from skiros2_task.core.commands import Claim, Command, End, MakePlan, ReadWorld, Start, Stop, Wake
from skiros2_task.core.event_queue import EventQueue
from skiros2_task.core.execution import ExecutionStateMachine
from skiros2_task.core.execution_log import ExecutionLog
from skiros2_task.core.goal_execution import Goal, GoalExecution, OnChange, OnEnd, StepRunner
from skiros2_task.core.goal_planning import GOOD, internal_error, make_plan, plan_ahead, read_task
from skiros2_task.core.goal_store import GoalStore, StoredGoal, StoreFailed
from skiros2_task.core.plan import Step
from skiros2_task.core.planning import PlanningResult, TaskPlanner, Verdict
from skiros2_task.core.recovery import Recovery, Restart
from skiros2_task.core.resources import Resources
from skiros2_task.core.step_record import Phase
from skiros2_task.core.task import PlanningTask
from skiros2_task.core.undeclared import UndeclaredChanges

log = logging.getLogger(__name__)

#: The shortest time between two reads of a changing world (s), and the largest share of the time spent on reading.
_READ_PERIOD, _READ_SHARE = 0.05, 0.2

#: The delay before a failed read of the world model is repeated (s).
_RETRY_DELAY = 1.0


class GoalExecutor:
    """Executes goals. One thread owns all state; each goal has another thread that plans and reads the world model."""

    def __init__(self, planner: TaskPlanner, runner: StepRunner, store: GoalStore | None = None) -> None:
        """
        :param store: has the goals with an id; None: goals are not stored.
        """
        self._planner = planner
        self._runner = runner
        self._store = store
        self._recovery: Recovery | None = None
        self._resources = Resources()
        self._executions: dict[str, GoalExecution] = {}
        self._lost: set[str] = set()
        self._found: set[str] = set()
        self._events = EventQueue()
        self._ids = count(1)
        self._thread = threading.Thread(target=self._run, name="goal executor", daemon=True)
        self._thread.start()

    # -- any thread --------------------------------------------------------------------------------------------

    def achieve(self, goal: Goal, on_change: OnChange, on_end: OnEnd) -> GoalExecution:
        """Starts to execute a goal. Does not block."""
        execution = self.prepare(goal, on_change, on_end)
        self._events.put(lambda: self._begin(execution))
        return execution

    def prepare(self, goal: Goal, on_change: OnChange, on_end: OnEnd) -> GoalExecution:
        """Returns an execution that has not begun, for `recover`."""
        machine = ExecutionStateMachine(time.monotonic, goal.max_replans, goal.replans_after_limit)
        undeclared = UndeclaredChanges(time.monotonic)
        log = ExecutionLog(self._store, goal.id) if self._store is not None and goal.id else None
        execution = GoalExecution(f"goal {next(self._ids)}", goal, on_change, on_end, machine, undeclared, log=log)
        threading.Thread(target=self._work, args=(execution,), name=execution.name, daemon=True).start()
        return execution

    def recover(self, goals: Sequence[tuple[GoalExecution, StoredGoal]], restart: Restart) -> None:
        """Continues goals of an earlier process, as their `on_restart` says. Call it before `achieve`."""
        self._recovery = Recovery(self, self._runner, restart)
        self._events.put(partial(self._recovery.begin, goals))

    def decide(self, execution: GoalExecution) -> None:
        """Reports that `on_restart` of a goal has changed: one that asks follows it."""
        recovery = self._recovery
        if recovery is not None:
            self._events.put(lambda: recovery.answer(execution))

    def report(self, execution: GoalExecution) -> None:
        """Calls `on_change` of a goal that has not ended."""
        self._events.put(lambda: execution.on_change(execution) if execution.name in self._executions else None)

    def cancel(self, execution: GoalExecution) -> None:
        """Cancels a goal. Its running steps are stopped at once, whatever the executor's thread does."""
        execution.cancelled.set()
        self._events.put(lambda: self.execute(execution, execution.machine.cancel()))
        for stop in list(execution.stops.values()):
            stop()

    def world_changed(self, change: Change | None = None) -> None:
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

    def began(self, execution: GoalExecution, step: Step, task: int) -> None:
        """Reports the number of a step's task."""
        self._events.put(lambda: self._note_task(execution, step.number, task))

    # -- for `Recovery` ----------------------------------------------------------------------------------------

    def missing(self, managers: Iterable[str]) -> set[str]:
        """Returns the managers that do not run. Goals that begin now wait for them. In the executor's thread."""
        self._lost |= (missing := set(managers) - self._found)
        return missing

    def put(self, event: Callable[[], None]) -> None:
        """Calls a function in the executor's thread. Any thread."""
        self._events.put(event)

    def add(self, execution: GoalExecution) -> None:
        """Adds a goal. In the executor's thread."""
        self._executions[execution.name] = execution
        for manager in self._lost:
            execution.machine.robot_lost(manager)

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

    def after(self, seconds: float, event: Callable[[], None]) -> None:
        """Calls a function in the executor's thread, later. In the executor's thread."""
        self._events.put_later(seconds, event)

    def _begin(self, execution: GoalExecution) -> None:
        self.add(execution)
        self.execute(execution, execution.machine.begin())

    def _cancel_all(self) -> None:
        for execution in list(self._executions.values()):
            execution.cancelled.set()
            self.execute(execution, execution.machine.cancel())

    def _on_robot(self, manager: str, found: bool) -> None:
        (self._lost.discard if found else self._lost.add)(manager)
        (self._found.add if found else self._found.discard)(manager)
        if found and self._recovery is not None:
            self._recovery.robot_found(manager)
        for execution in list(self._executions.values()):
            machine = execution.machine
            self.execute(execution, machine.robot_found(manager) if found else machine.robot_lost(manager))

    def execute(self, execution: GoalExecution, commands: Sequence[Command]) -> None:
        """Executes commands of a goal's state machine. An unexpected exception ends the goal as failed."""
        try:
            for command in commands:  # before anything waits for the disk
                if isinstance(command, Stop):
                    execution.stops[command.number]()
            self._execute_each(execution, self._write(execution, commands))
        except Exception as error:
            self._fail(execution, error)

    def _fail(self, execution: GoalExecution, error: Exception) -> None:
        """Ends a goal after an unexpected exception."""
        message = internal_error(error)
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
            elif isinstance(command, ReadWorld):
                execution.world_changed = True
                self.after(command.delay, lambda: self._schedule_read(execution))
            elif isinstance(command, Wake):
                self.after(command.delay, lambda: self.execute(execution, execution.machine.wake()))
            elif isinstance(command, End):
                self._end(execution, command)
                return
        if commands:
            execution.on_change(execution)

    def _write(self, execution: GoalExecution, commands: Sequence[Command]) -> Sequence[Command]:
        """Stores the execution. Returns the commands that may be executed: no step starts that is not stored."""
        if execution.log is None:
            return commands
        try:
            execution.log.write(execution.machine)
        except StoreFailed as error:
            log.error("%s: %s", execution.name, error)
            for command in commands:
                if isinstance(command, Start):
                    self._events.put(partial(self.ended, execution, command.step, False, str(error), ()))
            return [command for command in commands if not isinstance(command, Start)]
        return commands

    def _plan(self, execution: GoalExecution, command: MakePlan) -> None:
        busy = self._resources.held_by_others(execution.name)
        first = execution.machine.first_number
        execution.work.put(lambda: self._make_plan(execution, command, busy, first))

    def _plan_ahead(self, execution: GoalExecution) -> None:
        """Plans in advance as long as the plan is broken, and the world may still settle."""
        command = execution.machine.next_planning
        if command is not None or execution.machine.phase is Phase.RUNNING:
            busy = self._resources.held_by_others(execution.name)
            execution.work.put(lambda: plan_ahead(self._planner, execution, command, busy))

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
        self.execute(execution, execution.machine.planned(task, steps))

    def _no_plan(self, execution: GoalExecution, task: PlanningTask | None, result: PlanningResult) -> None:
        self._compare(execution, task)
        # Goals that wait for others to end do not wait for each other.
        others = (other.machine.phase for other in self._executions.values() if other is not execution)
        busy = any(phase is not Phase.BLOCKED for phase in others)
        absent = {name for name in self._found if not matching_name(name, result.managers)}
        machine = execution.machine
        self.execute(execution, machine.no_plan(result.verdict, result.message, busy, result.missing, bool(absent)))

    def _grant(self, owners: Iterable[str]) -> None:
        """Notifies goals of their resources, in separate events: one goal may change what another is granted."""
        for owner in owners:
            self._events.put(partial(self._granted, self._executions[owner]))

    def _granted(self, execution: GoalExecution) -> None:
        self.execute(execution, execution.machine.granted())

    def _interrupt(self, name: str, names: frozenset[str]) -> None:
        execution = self._executions.get(name)
        if execution is not None:
            self.execute(execution, execution.machine.interrupt(names))

    def _start(self, execution: GoalExecution, step: Step) -> None:
        def ended(succeeded: bool, message: str, explanations: Sequence[Explanation]) -> None:
            self._events.put(lambda: self.ended(execution, step, succeeded, message, explanations))

        log.info("%s: %s", execution.name, step)
        run = execution.log.run_of(step.number) if execution.log is not None else ""
        began = partial(self.began, execution, step)
        execution.stops[step.number] = stop = self._runner.start(step, ended, run, began, execution.key)
        if execution.cancelled.is_set():  # just now
            stop()

    def _note_task(self, execution: GoalExecution, number: int, task: int) -> None:
        execution.machine.records[number].task = task
        if execution.name in self._executions:
            execution.on_change(execution)

    def ended(
        self, execution: GoalExecution, step: Step, succeeded: bool, message: str, explanations: Sequence[Explanation]
    ) -> None:
        execution.stops.pop(step.number, None)
        self.execute(execution, execution.machine.ended(step.number, succeeded, message, explanations))

    def _end(self, execution: GoalExecution, end: End) -> None:
        undeclared = str(execution.undeclared)
        if undeclared and end.verdict not in (*GOOD, Verdict.CANCELLED):
            end = replace(end, message=f"{end.message}\n{undeclared}")
        log.log(logging.INFO if end.verdict in GOOD else logging.WARNING, "%s: %s", execution.name, end.message)
        del self._executions[execution.name]
        execution.cancelled.set()
        execution.work.put(None)
        granted = self._resources.release(execution.name)
        execution.on_end(execution, end)
        self._grant(granted)
        for other in list(self._executions.values()):
            self.execute(other, other.machine.retry())

    # -- reading the world model -------------------------------------------------------------------------------

    def _read_for_all(self, change: Change | None) -> None:
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
            self.after(delay, lambda: self._start_read(execution))
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
            self.execute(execution, execution.machine.world(task))
            self._plan_ahead(execution)
            self._schedule_read(execution)
        elif isinstance(task, WrongValue):
            self.execute(execution, execution.machine.unreadable(str(task)))
        else:
            log.warning("%s: world model read failed, retrying in %g s: %s", execution.name, _RETRY_DELAY, task)
            execution.world_changed = True
            self.after(_RETRY_DELAY, lambda: self._schedule_read(execution))

    # -- the thread of a goal ----------------------------------------------------------------------------------

    def _work(self, execution: GoalExecution) -> None:
        while (work := execution.work.get()) is not None:
            try:
                work()
            except Exception as error:
                self._events.put(partial(self._fail, execution, error))
        plan_ahead(self._planner, execution, None)

    def _read(self, execution: GoalExecution) -> None:
        start = time.monotonic()
        task = self.read_task(execution)
        seconds = time.monotonic() - start
        self._events.put(lambda: self._on_read(execution, task, seconds))

    def read_task(self, execution: GoalExecution) -> PlanningTask | SkirosError:
        """Returns the goal's task for the current world, or why it cannot be read. Blocks."""
        return read_task(self._planner, execution)

    def _make_plan(self, execution: GoalExecution, command: MakePlan, busy: frozenset[str], first: int) -> None:
        task, result = make_plan(self._planner, execution, command, busy)
        if task is None or result.task is None or result.verdict not in GOOD:  # None: the goal cannot be read
            self._events.put(lambda: self._no_plan(execution, task, result))
            return
        steps = result.plan.numbered_from(first) if result.plan is not None else ()
        self._events.put(lambda: self._planned(execution, task, steps))
