"""Calling the code of skills: what it raises, or answers wrongly, is a failure of the skill."""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import Any

from skiros2_common.core.abstract_skill import State, as_state
from skiros2_common.core.errors import FOREIGN_ERRORS
from skiros2_common.core.explanation import EXCEPTION, EXECUTE, PREEMPT, START
from skiros2_common.core.property import is_bool
from skiros2_common.core.source_location import format_error
from skiros2_skill.core.blackboard import drop_changes
from skiros2_skill.core.failures import (
    EXECUTE_RAISED,
    POST_FAILED,
    PRE_FAILED,
    PREEMPT_RAISED,
    START_RAISED,
    Failure,
    Failures,
)
from skiros2_skill.core.inside import EXECUTE_HOOK, Inside, LeftBehind
from skiros2_skill.core.preemption import SkillPreempted
from skiros2_skill.core.wrapper import SkillWrapper

log = logging.getLogger(__name__)

#: The progress code of a skill that was preempted.
PREEMPTED = -1

#: What `Hooks.call` gives when the hook raises.
RAISED: Any = object()

_RUNNING: State = State.Running
_SUCCESS: State = State.Success
_FAILURE: State = State.Failure


class Hooks:
    """Calls the hooks of the skills of one task, in the ticking thread.

    :param failures: where failures are noted.

    `inside` tells other threads which hook is being called.
    """

    def __init__(self, failures: Failures) -> None:
        self._failures = failures
        self.inside = Inside()

    def execute(self, node: SkillWrapper, of_children: State | None = None, late: bool = False) -> State:
        """What `execute` answers; None keeps the state of the children, where there are some.

        :param late: the node is ended already.
        """
        notes = self.inside.enter(node, EXECUTE_HOOK)
        try:
            try:
                answer = node._instance.execute()
            finally:
                self.inside.leave(notes)
        except LeftBehind:
            raise
        except FOREIGN_ERRORS as error:
            return self.execute_raised(node, error, late)
        return self.judged(node, answer, of_children, late)

    def call(self, node: SkillWrapper, name: str, hook: Callable[[], Any], code: int, late: bool = False) -> Any:
        """What another hook answers; `RAISED`, with the traceback as progress, when it raises.

        :param name: of the hook.
        :param code: the progress code then.
        :param late: the node has failed or is ended already.
        """
        notes = self.inside.enter(node, name)
        try:
            try:
                return hook()
            finally:
                self.inside.leave(notes)
        except LeftBehind:
            raise
        except FOREIGN_ERRORS as error:
            self.raised(node, error, code, late)
            return RAISED

    def on_start(self, node: SkillWrapper, start: Callable[[SkillWrapper], str]) -> Any:
        """What `start`, which calls `onStart`, answers: the no in words, else ""; `RAISED` when it raises."""
        refused = self.call(node, "onStart", lambda: start(node), START_RAISED)
        if refused and refused is not RAISED:
            give_reason(node, f"{node.label}: onStart returned {refused}", PRE_FAILED)
            instance = node._instance
            self._failures.note(node, Failure(START, instance._progress_code, instance._progress_msg))
        return refused

    def on_preempt(self, node: SkillWrapper) -> State:
        """The state that `onPreempt` answers: Running, Success or Failure."""
        instance = node._instance
        told_at = instance._progressed_at
        state = self.call(
            node, "onPreempt", lambda: as_state(instance.onPreempt(), _FAILURE), PREEMPT_RAISED, late=True
        )
        if state is _RUNNING or state is _SUCCESS:
            return _RUNNING if state is _RUNNING else _SUCCESS
        if instance._progressed_at == told_at:
            instance._setProgress("Preempted", PREEMPTED)
        return _FAILURE

    def on_end(self, node: SkillWrapper, state: State, preempted: bool) -> State:
        """The state after `onEnd`, which may make a success a failure."""
        instance = node._instance
        told_at = instance._progressed_at
        late = preempted or state is not _SUCCESS
        answer = self.call(node, "onEnd", lambda: refusal(instance.onEnd()), EXECUTE_RAISED, late)
        if not answer:
            return state
        if answer is not RAISED and state is _SUCCESS:
            if instance._progressed_at == told_at:
                instance._setProgress(f"{node.label}: onEnd returned {answer}", POST_FAILED)
            failure = Failure(EXECUTE, instance._progress_code, instance._progress_msg, late=late)
            self._failures.note(node, failure)
        return _FAILURE

    def execute_raised(self, node: SkillWrapper, error: Exception | SystemExit, late: bool = False) -> State:
        """As `raised`, for `execute`."""
        return self.raised(node, error, EXECUTE_RAISED, late)

    def raised(self, node: SkillWrapper, error: Exception | SystemExit, code: int, late: bool = False) -> State:
        """Tells and notes what the code of a node raised, in an `except` clause. Returns Failure."""
        preempted = isinstance(error, SkillPreempted)
        message = str(error) if preempted else format_error(error, type(node._instance).__module__)
        node._instance._setProgress(message, code)
        drop_changes(node.element_slots, node._wmi)  # it was about to change them further
        self._failures.note(node, Failure(PREEMPT if preempted else EXCEPTION, code, message, late=late))
        log.error("%s: %s", node.printState(), message)
        return _FAILURE

    def judged(self, node: SkillWrapper, answer: Any, of_children: State | None = None, late: bool = False) -> State:
        """The state that an answer of `execute` stands for; a failure is told and noted."""
        if answer is _RUNNING or answer is _SUCCESS:
            return _SUCCESS if answer is _SUCCESS else _RUNNING
        if answer is None and of_children is not None:
            return of_children
        instance = node._instance
        if is_bool(answer) and answer:
            return _SUCCESS
        text = f"{node.label}: execute returned {answer!r}"
        if answer is not _FAILURE and not is_bool(answer):
            instance._setProgress(f"{text}, expected step(...), success(...) or fail(...)", EXECUTE_RAISED)
        elif of_children is _FAILURE and instance._progressed_at == node._progressed_at:
            return _FAILURE  # it passes on the failure of its children without a word
        else:
            give_reason(node, text, EXECUTE_RAISED)
        self._failures.note(node, Failure(EXECUTE, instance._progress_code, instance._progress_msg, late=late))
        return _FAILURE


def refusal(answer: Any) -> str:
    """A no of `onStart` or `onEnd` (False, or what `fail` gives) in words; "" for other answers, None too."""
    return repr(answer) if answer is _FAILURE or (answer is not None and not answer) else ""


def give_reason(node: SkillWrapper, text: str, code: int) -> None:
    """Tells why a skill has failed when it has not done so itself."""
    instance = node._instance
    if instance._progress_code >= 0:
        reported = instance._progress_msg
        instance._setProgress(f"{text} after: {reported}" if reported else text, code)
