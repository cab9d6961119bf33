"""The details of the selected node, read from its manager while the task is running."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from skiros2_common.core.errors import SkirosError
from skiros2_common.core.explanation import Explanation
from skiros2_gui.app.problems import error_text
from skiros2_gui.app.state_style import FAILURE
from skiros2_gui.app.window import Window
from skiros2_gui.run.frame import Frame
from skiros2_gui.run.node_text import NodeText, node_text
from skiros2_gui.run.runs import RunBag
from skiros2_gui.run.task_run import TaskRun
from skiros2_skill.core.diagnosis.inspection import NodeStatus

_OF_A_BAG = "The values of conditions are not recorded in bags."
_OF_THE_PAST = "The values of conditions are known for the live tick only."
_ENDED = "The task has ended: the values of its conditions are the last ones known."


@dataclass(frozen=True)
class _Answer:
    now: NodeStatus | None
    why: Explanation | None
    note: str


class SelectedNode:
    """Used in the window's thread.

    :param on_change: called when the details have changed.
    """

    def __init__(self, window: Window, on_change: Callable[[], None]) -> None:
        self._window = window
        self._on_change = on_change
        self._of: tuple[TaskRun, int] | None = None
        self._answer = _Answer(None, None, "")
        self._is_asking = False
        self._next_request: Callable[[], None] | None = None

    def clear(self) -> None:
        """No node is selected."""
        self._of = None
        self._answer = _Answer(None, None, "")

    def ask(self, run: TaskRun, frame: Frame, index: int, is_live: bool, bag: RunBag | None) -> None:
        """Reads the details of a node. While a request is running, only the last one is kept."""
        node = frame.shape.id(index)
        if self._of != (run, node):
            self._of, self._answer = (run, node), _Answer(None, None, "")
        manager = self._window.system.managers.get(run.robot) if bag is None else None
        has_failed = frame.state(index) == FAILURE
        is_skill = frame.shape.is_skill(index)
        note = _OF_A_BAG if bag is not None else _ENDED if frame is run.latest else _OF_THE_PAST
        note = note if is_skill and not is_live else ""
        if manager is None or not (is_live or has_failed) or not (is_skill or has_failed):
            known = self._answer.now if note == _ENDED else None
            self._answer = _Answer(known, self._answer.why, note)
            return
        if self._is_asking:
            self._next_request = lambda: self.ask(run, frame, index, is_live, bag)
            return
        self._is_asking = True
        known = self._answer.now if note == _ENDED else None

        def call() -> _Answer:
            now, problem = _inspect(manager, run.task_id, node) if is_live and is_skill else (known, "")
            return _Answer(now, _why(manager, run.task_id, node) if has_failed else None, problem or note)

        self._window.jobs.run(call, lambda answer: self._take(run, node, answer), self._fail, queue=run.robot)

    def text(self, frame: Frame, index: int) -> NodeText:
        """Returns the node's description with the details read so far."""
        is_known = self._of is not None and self._of[1] == frame.shape.id(index)
        answer = self._answer if is_known else _Answer(None, None, "")
        return node_text(frame, index, answer.now, answer.why, answer.note)

    def _take(self, run: TaskRun, node: int, answer: _Answer) -> None:
        self._is_asking = False
        if self._of == (run, node) and answer != self._answer:
            self._answer = answer
            self._on_change()
        again, self._next_request = self._next_request, None
        if again is not None:
            again()

    def _fail(self, error: Exception) -> None:
        self._is_asking = False
        self._next_request = None
        if self._of is not None:
            self._answer = _Answer(None, None, error_text(error))
            self._on_change()


def _inspect(manager: Any, task_id: int, node: int) -> tuple[NodeStatus | None, str]:
    """Returns the details of a node, or None and the error message."""
    try:
        return manager.inspect(task_id, node), ""
    except SkirosError as error:
        return None, error_text(error)


def _why(manager: Any, task_id: int, node: int) -> Explanation | None:
    """Returns the last failure of a node; None if the manager has none."""
    explanations = [Explanation.from_dict(data) for data in json.loads(manager.why(task_id).json)]
    return next((e for e in reversed(explanations) if e.node == node), None)
