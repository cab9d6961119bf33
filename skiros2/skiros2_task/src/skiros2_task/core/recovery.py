"""Continues the goals of an earlier process: attaches to their steps, then continues, asks or aborts."""

from __future__ import annotations

import logging
from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Protocol

from skiros2_common.core.errors import SkirosError, WrongValue
from skiros2_common.core.explanation import Explanation
from skiros2_task.core.commands import Command
from skiros2_task.core.goal_execution import GoalExecution, StepRunner
from skiros2_task.core.goal_store import OnRestart, StoredGoal
from skiros2_task.core.plan import Step
from skiros2_task.core.step_record import Phase, StepState
from skiros2_task.core.task import PlanningTask

log = logging.getLogger(__name__)

#: How long the goals of an earlier process wait for the robots that ran then (s).
ROBOTS_TIMEOUT = 60.0

#: The delay before a failed read of the world model is repeated (s).
_RETRY_DELAY = 1.0

#: The message of a step whose result is unknown.
INTERRUPTED = "interrupted: its robot no longer knows the step"


@dataclass(frozen=True)
class Restart:
    """The state that the earlier process has left.

    :param managers: of the robots that ran.
    :param on_restart: returns what happens to a goal, by its id.
    :param question: returns why a person has to decide, given the managers of a goal whose steps do not run; "" if
        there is no reason. May block.
    """

    managers: frozenset[str]
    on_restart: Callable[[str], OnRestart]
    question: Callable[[Collection[str]], str]


@dataclass
class _Returning:
    """A goal that does not continue yet.

    :param unclear: the numbers of the steps of which it is unknown whether they run.
    :param attached: the managers whose step runs, or has ended meanwhile.
    """

    execution: GoalExecution
    unclear: set[int] = field(default_factory=set)
    attached: set[str] = field(default_factory=set)


class Executor(Protocol):
    """What `Recovery` needs of `GoalExecutor`."""

    def missing(self, managers: Iterable[str], /) -> set[str]: ...

    def put(self, event: Callable[[], None], /) -> None: ...

    def after(self, seconds: float, event: Callable[[], None], /) -> None: ...

    def add(self, execution: GoalExecution, /) -> None: ...

    def execute(self, execution: GoalExecution, commands: Sequence[Command], /) -> None: ...

    def began(self, execution: GoalExecution, step: Step, task: int, /) -> None: ...

    def ended(
        self, execution: GoalExecution, step: Step, succeeded: bool, message: str, why: Sequence[Explanation], /
    ) -> None: ...

    def read_task(self, execution: GoalExecution, /) -> PlanningTask | SkirosError: ...

    def robot_lost(self, manager: str, /) -> None: ...


class Recovery:
    """In the executor's thread.

    :param executor: executes the goals.
    """

    def __init__(self, executor: Executor, runner: StepRunner, restart: Restart) -> None:
        self._executor = executor
        self._runner = runner
        self._restart = restart
        self._awaited: set[str] = set()
        self._returning: dict[str, _Returning] = {}

    def begin(self, goals: Sequence[tuple[GoalExecution, StoredGoal]]) -> None:
        """Attaches to the steps of the goals, and waits for the robots."""
        for execution, stored in goals:
            self._begin(execution, stored)
        self._awaited = set(self._restart.managers)
        for execution, _ in goals:
            machine = execution.machine
            self._awaited |= {step.call.manager for step in (*machine.running, *machine.waiting)}
        self._awaited = self._executor.missing(self._awaited)
        self._executor.after(ROBOTS_TIMEOUT, self._stop_waiting)
        self._check()

    def robot_found(self, manager: str) -> None:
        """Continues if this was the last missing robot."""
        self._awaited.discard(manager)
        self._check()

    def answer(self, execution: GoalExecution) -> None:
        """`on_restart` of a goal has changed. One that asks follows it."""
        if execution.machine.phase is Phase.ASKING:
            self._decide(_Returning(execution))

    # -- internals ---------------------------------------------------------------------------------------------

    def _begin(self, execution: GoalExecution, stored: StoredGoal) -> None:
        machine, executor = execution.machine, self._executor
        assert execution.log is not None
        executor.add(execution)
        returning = self._returning[execution.name] = _Returning(execution)
        try:
            state = execution.log.restore(stored, machine.clock())
        except (WrongValue, KeyError, TypeError, ValueError) as error:
            log.error("%s: its stored state cannot be read: %s", execution.name, error)
            del self._returning[execution.name]
            executor.execute(execution, machine.unreadable(f"its stored state cannot be read: {error}"))
            return
        executor.execute(execution, machine.restore(state))
        for step in machine.running:
            returning.unclear.add(step.number)
            execution.stops[step.number] = self._attach(returning, step)

    def _attach(self, returning: _Returning, step: Step) -> Callable[[], None]:
        execution, executor = returning.execution, self._executor
        assert execution.log is not None

        def known(is_known: bool) -> None:
            executor.put(partial(self._on_attached, returning, step, is_known))

        def ended(succeeded: bool, message: str, explanations: Sequence[Explanation]) -> None:
            executor.put(partial(executor.ended, execution, step, succeeded, message, explanations))

        began = partial(executor.began, execution, step)
        return self._runner.attach(step, execution.log.run_of(step.number), known, ended, began)

    def _on_attached(self, returning: _Returning, step: Step, is_known: bool) -> None:
        execution = returning.execution
        returning.unclear.discard(step.number)
        if is_known:
            log.info("%s: attached to %s", execution.name, step)
            returning.attached.add(step.call.manager)
        else:
            log.warning("%s: %s was interrupted", execution.name, step)
            execution.stops.pop(step.number, None)
            self._executor.execute(execution, execution.machine.interrupted(step.number, INTERRUPTED))
        self._check()

    def _stop_waiting(self) -> None:
        missing, self._awaited = self._awaited, set()
        for manager in sorted(missing):
            log.warning("%s has not come back within %g s", manager, ROBOTS_TIMEOUT)
            self._executor.robot_lost(manager)
        self._executor.put(self._check)

    def _check(self) -> None:
        if self._awaited:
            return
        for name, returning in list(self._returning.items()):
            if not returning.unclear:
                del self._returning[name]
                self._decide(returning)

    def _decide(self, returning: _Returning) -> None:
        execution = returning.execution
        on_restart = self._restart.on_restart(execution.goal.id)
        log.info("%s was interrupted by a restart; on_restart is %r", execution.name, on_restart.value)
        if on_restart is OnRestart.ABORT:
            reason = "the task manager was restarted, and on_restart is abort"
            self._executor.execute(execution, execution.machine.abort(reason))
        elif on_restart is OnRestart.ASK:
            self._ask(execution, "the task manager was restarted, and on_restart is ask")
        elif on_restart is OnRestart.CONTINUE:
            self._continue(execution)
        else:
            records = execution.machine.records.values()
            managers = {r.step.call.manager for r in records if r.state is not StepState.DROPPED} - returning.attached
            execution.work.put(partial(self._read_question, execution, managers))

    def _ask(self, execution: GoalExecution, question: str) -> None:
        log.warning("%s does not continue by itself: %s", execution.name, question)
        self._executor.execute(execution, execution.machine.ask(question))

    def _continue(self, execution: GoalExecution) -> None:
        execution.work.put(partial(self._read_world, execution))

    def _on_world(self, execution: GoalExecution, task: PlanningTask | SkirosError) -> None:
        if isinstance(task, PlanningTask):
            self._executor.execute(execution, execution.machine.resume(task))
        elif isinstance(task, WrongValue):
            self._executor.execute(execution, execution.machine.unreadable(str(task)))
        else:
            log.warning("%s: world model read failed, retrying in %g s: %s", execution.name, _RETRY_DELAY, task)
            self._executor.after(_RETRY_DELAY, partial(self._continue, execution))

    # -- the thread of a goal ----------------------------------------------------------------------------------

    def _read_question(self, execution: GoalExecution, managers: Collection[str]) -> None:
        try:
            question = self._restart.question(managers)
        except SkirosError as error:
            question = f"what its robots hold is unknown: {error}"
        then = partial(self._ask, execution, question) if question else partial(self._continue, execution)
        self._executor.put(then)

    def _read_world(self, execution: GoalExecution) -> None:
        task = self._executor.read_task(execution)
        self._executor.put(partial(self._on_world, execution, task))
