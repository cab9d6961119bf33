"""Calls the hooks of skills. An exception or a wrong return value is a failure of the skill."""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import Any

from skiros2_common.core.abstract_skill import SkillCore, State, as_state
from skiros2_common.core.errors import FOREIGN_ERRORS, SkirosError
from skiros2_common.core.explanation import EXCEPTION, EXECUTE, PREEMPT, START
from skiros2_common.core.property import is_bool
from skiros2_common.core.source_location import format_error
from skiros2_common.core.task_context import starting_in
from skiros2_common.core.world_model_port import WorldModelPort
from skiros2_skill.core.engine.breakpoints import TaskBreakpoints
from skiros2_skill.core.engine.devices import free_devices
from skiros2_skill.core.engine.elements import discard_changes
from skiros2_skill.core.engine.evidence import Evidence
from skiros2_skill.core.engine.failures import (
    EXECUTE_RAISED,
    POST_FAILED,
    PRE_FAILED,
    PREEMPT_RAISED,
    START_RAISED,
    Failure,
    Failures,
)
from skiros2_skill.core.engine.hook_guard import EXECUTE_HOOK, HookAbandoned, HookGuard
from skiros2_skill.core.engine.skill_run import SkillRun

log = logging.getLogger(__name__)

#: The progress code of a preempted skill.
PREEMPTED = -1

#: The result of `Hooks.call` when the hook raises.
RAISED: Any = object()

# These do nothing, and are not called: most skills override only `execute`.
_DEFAULT_START, _DEFAULT_END = SkillCore.onStart, SkillCore.onEnd

_RUNNING: State = State.Running
_SUCCESS: State = State.Success
_FAILURE: State = State.Failure


class SkillPreempted(SkirosError):
    """Raised by a hook, ends the skill as a preemption does, without a traceback."""

    def __init__(self, value: object) -> None:
        super().__init__(str(value))
        self.value = value


class Hooks:
    """Calls the hooks of the skills of one task, in the ticking thread.

    :param failures: records their failures.
    :param wmi: the world model as the task sees it.
    """

    def __init__(self, failures: Failures, breakpoints: TaskBreakpoints, wmi: WorldModelPort) -> None:
        self._failures, self._breakpoints, self._wmi = failures, breakpoints, wmi
        self.evidence = Evidence()
        self.guard: HookGuard[SkillRun] = HookGuard()
        #: Stands for the task, or for the goal of which it is a step.
        self.task: object = object()

    def fail(self, run: SkillRun, failure: Failure) -> None:
        """Sets the progress and the kind of a failed run and records the failure."""
        run.report(failure.message, failure.code)
        run.failure_kind = run.failure_kind.worst(failure.kind)
        self.guard.call(run, "the explanation of its failure", self._failures.record, run.node, failure)
        if self._breakpoints:
            self._breakpoints.at_failure(failure.conditions)

    def give_up(self, run: SkillRun, reason: str) -> None:
        """Sets the progress of a run that does not end, and records that."""
        run.report(reason, PREEMPT_RAISED)
        self._failures.record(run.node, Failure(PREEMPT, PREEMPT_RAISED, reason))

    def report_end(self, run: SkillRun, state: State, preempted: bool) -> None:
        """Sets the progress of a compound that has ended and has not set it itself."""
        if state is _FAILURE and not preempted and run.node.children and run.progress.code >= 0:
            cause = self._failures.cause_below(run.node)
            if cause is not None:
                run.report(*cause)
        elif state is _SUCCESS and run.implementation.is_compound and not run.progress.code:
            run.report("End", 1)

    def free(self, run: SkillRun) -> None:
        """Unlocks the devices that a run has locked."""
        if run.locks:
            self.guard.call(run, "the release of its devices", free_devices, run, self._wmi)

    def execute(self, run: SkillRun, of_children: State | None = None, secondary: bool = False) -> State:
        """Calls `execute` and returns the new state.

        :param of_children: of a compound: the state of its children, which an `execute` that returns None keeps.
        :param secondary: the node has ended already.
        """
        if self.evidence.is_on:
            self.evidence.hook(run, EXECUTE_HOOK)
        try:
            answer = self.guard.call(run, EXECUTE_HOOK, run.instance.execute)
        except HookAbandoned:
            raise
        except FOREIGN_ERRORS as error:
            return self.execute_raised(run, error, secondary)
        return self.execute_state(run, answer, of_children, secondary)

    def call(self, run: SkillRun, name: str, hook: Callable[[], Any], code: int, secondary: bool = False) -> Any:
        """Calls another hook. Returns its value; `RAISED`, with the traceback as progress, when it raises.

        :param name: of the hook.
        :param code: the progress code when it raises.
        :param secondary: the node has failed or ended already.
        """
        if self.evidence.is_on:
            self.evidence.hook(run, name)
        try:
            return self.guard.call(run, name, hook)
        except HookAbandoned:
            raise
        except FOREIGN_ERRORS as error:
            self.record_exception(run, error, code, secondary)
            return RAISED

    def on_start(self, run: SkillRun) -> Any:
        """Expands the subtree and calls `onStart`. Returns the refusal, "" for none; `RAISED` when it raises."""
        if not run.implementation.is_compound and getattr(run.instance.onStart, "__func__", None) is _DEFAULT_START:
            if self.evidence.is_on:
                self.evidence.hook(run, "onStart")
            return ""
        with starting_in(self.task):
            refused = self.call(run, "onStart", lambda: refusal_text(run.start()), START_RAISED)
        if refused and refused is not RAISED:
            set_failure_reason(run, f"{run.label}: onStart returned {refused}", PRE_FAILED)
            self._failures.record(run.node, _reported(run, START))
        return refused

    def on_preempt(self, run: SkillRun) -> State:
        """Calls `onPreempt`. Returns Running, Success or Failure."""
        instance = run.instance
        progressed_at = instance.progressed_at
        state = self.call(
            run, "onPreempt", lambda: as_state(instance.onPreempt(), _FAILURE), PREEMPT_RAISED, secondary=True
        )
        if state is _RUNNING or state is _SUCCESS:
            return _RUNNING if state is _RUNNING else _SUCCESS
        if instance.progressed_at == progressed_at:
            run.report("Preempted", PREEMPTED)
        return _FAILURE

    def on_end(self, run: SkillRun, state: State, preempted: bool) -> State:
        """Calls `onEnd`. Returns the state after it, which may turn a success into a failure."""
        instance = run.instance
        if getattr(instance.onEnd, "__func__", None) is _DEFAULT_END:
            if self.evidence.is_on:
                self.evidence.hook(run, "onEnd")
            return state
        progressed_at = instance.progressed_at
        secondary = preempted or state is not _SUCCESS
        answer = self.call(run, "onEnd", lambda: refusal_text(instance.onEnd()), EXECUTE_RAISED, secondary)
        if not answer:
            return state
        if answer is not RAISED and state is _SUCCESS:
            if instance.progressed_at == progressed_at:
                run.report(f"{run.label}: onEnd returned {answer}", POST_FAILED)
            self._failures.record(run.node, _reported(run, EXECUTE, secondary))
        return _FAILURE

    def execute_raised(self, run: SkillRun, error: Exception | SystemExit, secondary: bool = False) -> State:
        """Same as `record_exception`, for `execute`."""
        return self.record_exception(run, error, EXECUTE_RAISED, secondary)

    def record_exception(
        self, run: SkillRun, error: Exception | SystemExit, code: int, secondary: bool = False
    ) -> State:
        """Records what the code of a node has raised; called in the `except` clause. Returns Failure."""
        preempted = isinstance(error, SkillPreempted)
        message = str(error) if preempted else format_error(error, type(run.instance).__module__)
        run.report(message, code)
        discard_changes(run.element_slots, self._wmi)  # the changes may be incomplete
        stage = PREEMPT if preempted else EXCEPTION
        self._failures.record(run.node, Failure(stage, code, message, secondary=secondary))
        log.error("%s: %s", run.node.printState(), message)
        return _FAILURE

    def execute_state(
        self, run: SkillRun, answer: Any, of_children: State | None = None, secondary: bool = False
    ) -> State:
        """The state that a return value of `execute` stands for. A failure is recorded."""
        if answer is _RUNNING or answer is _SUCCESS:
            return _SUCCESS if answer is _SUCCESS else _RUNNING
        if answer is None and of_children is not None:
            return of_children
        instance = run.instance
        if is_bool(answer) and answer:
            return _SUCCESS
        text = f"{run.label}: execute returned {answer!r}"
        if answer is not _FAILURE and not is_bool(answer):
            run.report(f"{text}, expected step(...), success(...) or fail(...)", EXECUTE_RAISED)
        elif of_children is _FAILURE and instance.progressed_at == run.progressed_at:
            return _FAILURE  # the failure of the children, without a progress of its own
        else:
            set_failure_reason(run, text, EXECUTE_RAISED)
        self._failures.record(run.node, _reported(run, EXECUTE, secondary or instance.fails_late))
        return _FAILURE


def refusal_text(answer: Any) -> str:
    """The text of a refusal by `onStart` or `onEnd` (False, or the value of `fail`); "" for other values, also None."""
    return repr(answer) if answer is _FAILURE or (answer is not None and not answer) else ""


def _reported(run: SkillRun, stage: str, secondary: bool = False) -> Failure:
    """The failure that the instance of a run has reported as its progress."""
    instance = run.instance
    return Failure(
        stage, instance.progress_code, instance.progress_msg, secondary=secondary, kind=instance.failure_kind
    )


def set_failure_reason(run: SkillRun, text: str, code: int) -> None:
    """Sets the progress of a failed skill that has not set it itself."""
    instance = run.instance
    if instance.progress_code >= 0:
        reported = instance.progress_msg
        run.report(f"{text} after: {reported}" if reported else text, code)
