"""What is known of the node that is selected: asked of its manager while its task runs."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from skiros2_common.core.errors import SkirosError
from skiros2_common.core.explanation import Explanation
from skiros2_gui.core.problems import in_words
from skiros2_gui.core.run_bag import RunBag
from skiros2_gui.core.run_frame import Frame
from skiros2_gui.core.run_history import TaskRun
from skiros2_gui.core.run_node import NodeText, node_text
from skiros2_gui.core.states import FAILURE
from skiros2_gui.core.window import Window
from skiros2_skill.core.diagnosis.inspection import NodeStatus

_OF_A_BAG = "The values of conditions are not recorded in bags."
_OF_THE_PAST = "The values of conditions are known at present only."
_ENDED = "The task has ended: its conditions are not checked any more, what is told of them is from before."


@dataclass(frozen=True)
class _Answer:
    now: NodeStatus | None
    why: Explanation | None
    note: str


class SelectedNode:
    """Used in the window's thread.

    :param on_change: called when more is known.
    """

    def __init__(self, window: Window, on_change: Callable[[], None]) -> None:
        self._window = window
        self._on_change = on_change
        self._of: tuple[TaskRun, int] | None = None
        self._answer = _Answer(None, None, "")
        self._is_asking = False
        self._asks_again: Callable[[], None] | None = None

    def clear(self) -> None:
        """No node is selected."""
        self._of = None
        self._answer = _Answer(None, None, "")

    def ask(self, run: TaskRun, frame: Frame, place: int, is_live: bool, bag: RunBag | None) -> None:
        """Asks for a node; while an answer is waited for, only the last question stays."""
        node = frame.shape.id(place)
        if self._of != (run, node):
            self._of, self._answer = (run, node), _Answer(None, None, "")
        manager = self._window.system.managers.get(run.robot) if bag is None else None
        has_failed = frame.state(place) == FAILURE
        is_skill = frame.shape.is_skill(place)
        note = _OF_A_BAG if bag is not None else _ENDED if frame is run.now else _OF_THE_PAST
        note = note if is_skill and not is_live else ""
        if manager is None or not (is_live or has_failed) or not (is_skill or has_failed):
            known = self._answer.now if note == _ENDED else None
            self._answer = _Answer(known, self._answer.why, note)
            return
        if self._is_asking:
            self._asks_again = lambda: self.ask(run, frame, place, is_live, bag)
            return
        self._is_asking = True
        known = self._answer.now if note == _ENDED else None

        def call() -> _Answer:
            now, trouble = _inspect(manager, run.task_id, node) if is_live and is_skill else (known, "")
            return _Answer(now, _why(manager, run.task_id, node) if has_failed else None, trouble or note)

        self._window.jobs.run(call, lambda answer: self._take(run, node, answer), self._fail, lane=run.robot)

    def text(self, frame: Frame, place: int) -> NodeText:
        """The node in words, with what its manager told of it."""
        is_known = self._of is not None and self._of[1] == frame.shape.id(place)
        answer = self._answer if is_known else _Answer(None, None, "")
        return node_text(frame, place, answer.now, answer.why, answer.note)

    def _take(self, run: TaskRun, node: int, answer: _Answer) -> None:
        self._is_asking = False
        if self._of == (run, node) and answer != self._answer:
            self._answer = answer
            self._on_change()
        again, self._asks_again = self._asks_again, None
        if again is not None:
            again()

    def _fail(self, error: Exception) -> None:
        self._is_asking = False
        self._asks_again = None
        if self._of is not None:
            self._answer = _Answer(None, None, in_words(error))
            self._on_change()


def _inspect(manager: Any, task_id: int, node: int) -> tuple[NodeStatus | None, str]:
    """What a node is now; where the manager does not tell, as the task has just ended, what it says instead."""
    try:
        return manager.inspect(task_id, node), ""
    except SkirosError as error:
        return None, in_words(error)


def _why(manager: Any, task_id: int, node: int) -> Explanation | None:
    """Why a node failed last; None: the manager does not know."""
    told = [Explanation.from_dict(data) for data in json.loads(manager.why(task_id).json)]
    return next((e for e in reversed(told) if e.node == node), None)
