"""Calling the code of skills: what it raises, or answers wrongly, is a failure of the skill."""

from __future__ import annotations

import logging
import traceback
from collections.abc import Callable
from typing import Any

from skiros2_common.core.abstract_skill import State
from skiros2_common.core.explanation import EXCEPTION, EXECUTE, PREEMPT
from skiros2_skill.core.failures import EXECUTE_RAISED, Failure, Failures
from skiros2_skill.core.inside import Inside, LeftBehind
from skiros2_skill.core.preemption import SkillPreempted
from skiros2_skill.core.wrapper import SkillWrapper

log = logging.getLogger(__name__)

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
        notes = self.inside.enter(node, "execute")
        try:
            try:
                answer = node._instance.execute()
            finally:
                self.inside.leave(notes)
        except LeftBehind:
            raise
        except Exception as error:
            return self._raised(node, error, EXECUTE_RAISED, late)
        if isinstance(answer, State):
            if answer is _FAILURE:
                self._note(node, of_children, late)
            return answer
        if answer is None and of_children is not None:
            return of_children
        if answer is True:
            return _SUCCESS
        if answer is not False:
            text = f"{node.label}: execute returned {answer!r}, expected step(...), success(...) or fail(...)"
            node._instance._setProgress(text, EXECUTE_RAISED)
        self._note(node, of_children, late)
        return _FAILURE

    def call(self, node: SkillWrapper, name: str, hook: Callable[[], Any], code: int, late: bool = False) -> Any:
        """What another hook answers; Failure, with the traceback as progress, when it raises.

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
        except Exception as error:
            return self._raised(node, error, code, late)

    def _raised(self, node: SkillWrapper, error: Exception, code: int, late: bool = False) -> State:
        preempted = isinstance(error, SkillPreempted)
        message = str(error) if preempted else traceback.format_exc()
        node._instance._setProgress(message, code)
        self._failures.note(node, Failure(PREEMPT if preempted else EXCEPTION, code, message, late=late))
        log.error("%s: %s", node.printState(), message)
        return _FAILURE

    def _note(self, node: SkillWrapper, of_children: State | None, late: bool) -> None:
        """The skill's own code has failed; not when it passes on the failure of its children without a word."""
        instance = node._instance
        if of_children is not _FAILURE or instance._progressed_at != node._progressed_at:
            self._failures.note(node, Failure(EXECUTE, instance._progress_code, instance._progress_msg, late=late))
