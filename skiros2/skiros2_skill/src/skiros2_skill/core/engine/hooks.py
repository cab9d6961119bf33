"""Calls the hooks of skills. An exception or a wrong return value is a failure of the skill."""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import Any

from skiros2_common.core.abstract_skill import State, as_state
from skiros2_common.core.errors import FOREIGN_ERRORS, SkirosError
from skiros2_common.core.explanation import EXCEPTION, EXECUTE, PREEMPT, START
from skiros2_common.core.property import is_bool
from skiros2_common.core.source_location import format_error
from skiros2_skill.core.engine.elements import discard_changes
from skiros2_skill.core.engine.failures import (
    EXECUTE_RAISED,
    POST_FAILED,
    PRE_FAILED,
    PREEMPT_RAISED,
    START_RAISED,
    Failure,
    Failures,
)
from skiros2_skill.core.tree.hook_guard import EXECUTE_HOOK, HookAbandoned, HookGuard
from skiros2_skill.core.tree.skill_node import SkillWrapper

log = logging.getLogger(__name__)

#: The progress code of a preempted skill.
PREEMPTED = -1

#: The result of `Hooks.call` when the hook raises.
RAISED: Any = object()

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
    """

    def __init__(self, failures: Failures) -> None:
        self._failures = failures
        self.guard = HookGuard()

    def execute(self, node: SkillWrapper, of_children: State | None = None, late: bool = False) -> State:
        """Calls `execute` and returns the new state.

        :param of_children: of a compound: the state of its children, which an `execute` that returns None keeps.
        :param late: the node has ended already.
        """
        try:
            answer = self.guard.call(node, EXECUTE_HOOK, node.instance.execute)
        except HookAbandoned:
            raise
        except FOREIGN_ERRORS as error:
            return self.execute_raised(node, error, late)
        return self.execute_state(node, answer, of_children, late)

    def call(self, node: SkillWrapper, name: str, hook: Callable[[], Any], code: int, late: bool = False) -> Any:
        """Calls another hook. Returns its value; `RAISED`, with the traceback as progress, when it raises.

        :param name: of the hook.
        :param code: the progress code when it raises.
        :param late: the node has failed or ended already.
        """
        try:
            return self.guard.call(node, name, hook)
        except HookAbandoned:
            raise
        except FOREIGN_ERRORS as error:
            self.record_exception(node, error, code, late)
            return RAISED

    def on_start(self, node: SkillWrapper, start: Callable[[SkillWrapper], str]) -> Any:
        """Calls `start`, which calls `onStart`. Returns the refusal, "" for none; `RAISED` when it raises."""
        refused = self.call(node, "onStart", lambda: start(node), START_RAISED)
        if refused and refused is not RAISED:
            set_failure_reason(node, f"{node.label}: onStart returned {refused}", PRE_FAILED)
            instance = node.instance
            self._failures.record(node, Failure(START, instance._progress_code, instance.progress_msg))
        return refused

    def on_preempt(self, node: SkillWrapper) -> State:
        """Calls `onPreempt`. Returns Running, Success or Failure."""
        instance = node.instance
        progressed_at = instance.progressed_at
        state = self.call(
            node, "onPreempt", lambda: as_state(instance.onPreempt(), _FAILURE), PREEMPT_RAISED, late=True
        )
        if state is _RUNNING or state is _SUCCESS:
            return _RUNNING if state is _RUNNING else _SUCCESS
        if instance.progressed_at == progressed_at:
            instance._setProgress("Preempted", PREEMPTED)
        return _FAILURE

    def on_end(self, node: SkillWrapper, state: State, preempted: bool) -> State:
        """Calls `onEnd`. Returns the state after it, which may turn a success into a failure."""
        instance = node.instance
        progressed_at = instance.progressed_at
        late = preempted or state is not _SUCCESS
        answer = self.call(node, "onEnd", lambda: refusal_text(instance.onEnd()), EXECUTE_RAISED, late)
        if not answer:
            return state
        if answer is not RAISED and state is _SUCCESS:
            if instance.progressed_at == progressed_at:
                instance._setProgress(f"{node.label}: onEnd returned {answer}", POST_FAILED)
            failure = Failure(EXECUTE, instance._progress_code, instance.progress_msg, late=late)
            self._failures.record(node, failure)
        return _FAILURE

    def execute_raised(self, node: SkillWrapper, error: Exception | SystemExit, late: bool = False) -> State:
        """Same as `record_exception`, for `execute`."""
        return self.record_exception(node, error, EXECUTE_RAISED, late)

    def record_exception(
        self, node: SkillWrapper, error: Exception | SystemExit, code: int, late: bool = False
    ) -> State:
        """Records what the code of a node has raised; called in the `except` clause. Returns Failure."""
        preempted = isinstance(error, SkillPreempted)
        message = str(error) if preempted else format_error(error, type(node.instance).__module__)
        node.instance._setProgress(message, code)
        discard_changes(node.element_slots, node._wmi)  # the changes may be incomplete
        self._failures.record(node, Failure(PREEMPT if preempted else EXCEPTION, code, message, late=late))
        log.error("%s: %s", node.printState(), message)
        return _FAILURE

    def execute_state(
        self, node: SkillWrapper, answer: Any, of_children: State | None = None, late: bool = False
    ) -> State:
        """The state that a return value of `execute` stands for. A failure is recorded."""
        if answer is _RUNNING or answer is _SUCCESS:
            return _SUCCESS if answer is _SUCCESS else _RUNNING
        if answer is None and of_children is not None:
            return of_children
        instance = node.instance
        if is_bool(answer) and answer:
            return _SUCCESS
        text = f"{node.label}: execute returned {answer!r}"
        if answer is not _FAILURE and not is_bool(answer):
            instance._setProgress(f"{text}, expected step(...), success(...) or fail(...)", EXECUTE_RAISED)
        elif of_children is _FAILURE and instance.progressed_at == node.progressed_at:
            return _FAILURE  # the failure of the children, without a progress of its own
        else:
            set_failure_reason(node, text, EXECUTE_RAISED)
        late = late or instance.fails_late
        self._failures.record(node, Failure(EXECUTE, instance._progress_code, instance.progress_msg, late=late))
        return _FAILURE


def refusal_text(answer: Any) -> str:
    """The text of a refusal by `onStart` or `onEnd` (False, or the value of `fail`); "" for other values, also None."""
    return repr(answer) if answer is _FAILURE or (answer is not None and not answer) else ""


def set_failure_reason(node: SkillWrapper, text: str, code: int) -> None:
    """Sets the progress of a failed skill that has not set it itself."""
    instance = node.instance
    if instance._progress_code >= 0:
        reported = instance.progress_msg
        instance._setProgress(f"{text} after: {reported}" if reported else text, code)
