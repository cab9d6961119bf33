"""The details of the selected node, read from its manager. Values that were read are kept with the task run."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from skiros2_common.core.errors import SkirosError
from skiros2_common.core.explanation import Explanation
from skiros2_gui.app.problems import error_text
from skiros2_gui.app.system import Manager
from skiros2_gui.app.window import Window
from skiros2_gui.run.node_text import NodeText, node_text
from skiros2_runs.core.frame import Frame
from skiros2_runs.core.states import FAILURE, IDLE
from skiros2_runs.core.task_run import TaskRun
from skiros2_runs.core.values import NodeStatus

_OF_A_BAG = "The values of conditions are not recorded in bags."
_NOT_KNOWN = "The values of this tick are not known."


@dataclass(frozen=True)
class _Answer:
    why: Explanation | None
    problem: str


_NOTHING = _Answer(None, "")


class SelectedNode:
    """Used in the window's thread.

    :param on_change: called when the details have changed.
    """

    def __init__(self, window: Window, on_change: Callable[[], None]) -> None:
        self._window = window
        self._on_change = on_change
        self._of: tuple[TaskRun, int] | None = None
        self._answer = _NOTHING
        self._is_asking = False
        self._next_request: Callable[[], None] | None = None

    def clear(self) -> None:
        """No node is selected."""
        self._of = None
        self._answer = _NOTHING

    def ask(self, run: TaskRun, frame: Frame, index: int, is_live: bool, can_ask: bool) -> None:
        """Reads the details of a node. While a request is running, only the last one is kept.

        :param can_ask: whether the manager may know the task.
        """
        node = frame.shape.id(index)
        if self._of != (run, node):
            self._of, self._answer = (run, node), _NOTHING
        manager = self._window.system.managers.get(run.robot) if can_ask else None
        has_failed = frame.state(index) == FAILURE
        wants_values = frame.shape.is_skill(index) and (is_live or _lacks_values(run, frame, index))
        if manager is None or not (wants_values or has_failed):
            return
        if self._is_asking:
            self._next_request = lambda: self.ask(run, frame, index, is_live, can_ask)
            return
        self._is_asking = True

        def call() -> tuple[NodeStatus | None, _Answer]:
            now, problem = _inspect(manager, run.task_id, node) if wants_values else (None, "")
            return now, _Answer(_why(manager, run.task_id, node) if has_failed else None, problem)

        self._window.jobs.run(call, lambda answer: self._take(run, node, *answer), self._fail, queue=run.robot)

    def text(self, run: TaskRun, frame: Frame, index: int, is_recorded: bool) -> NodeText:
        """Returns the node's description with the details read so far.

        :param is_recorded: whether the task is one of a bag.
        """
        node = frame.shape.id(index)
        answer = self._answer if self._of is not None and self._of[1] == node else _NOTHING
        values = _values(run, frame, index)
        note = answer.problem
        if values is None and not note and frame.shape.is_skill(index) and frame is not run.latest:
            note = _NOT_KNOWN
        return node_text(frame, index, values, answer.why, _OF_A_BAG if is_recorded else note)

    def _take(self, run: TaskRun, node: int, now: NodeStatus | None, answer: _Answer) -> None:
        self._is_asking = False
        is_new = now is not None and run.add_values(now)
        if self._of == (run, node) and (is_new or answer != self._answer):
            self._answer = answer
            self._on_change()
        again, self._next_request = self._next_request, None
        if again is not None:
            again()

    def _fail(self, error: Exception) -> None:
        self._is_asking = False
        self._next_request = None
        if self._of is not None:
            self._answer = _Answer(None, error_text(error))
            self._on_change()


def _lacks_values(run: TaskRun, frame: Frame, index: int) -> bool:
    """Returns whether the manager may know more about a node than was read before it ended."""
    values = _values(run, frame, index)
    return values is None or (frame is run.latest and values.time < run.latest.time)


def _values(run: TaskRun, frame: Frame, index: int) -> NodeStatus | None:
    """Returns the values of a node at a tick, as far as they were read; None for a node that had not started."""
    if frame is run.latest:
        return run.values_at(frame.shape.id(index), math.inf)
    return run.values_at(frame.shape.id(index), frame.time) if frame.state(index) != IDLE else None


def _inspect(manager: Manager, task_id: int, node: int) -> tuple[NodeStatus | None, str]:
    """Returns the details of a node, or None and the error message."""
    try:
        return manager.inspect(task_id, node), ""
    except SkirosError as error:
        return None, error_text(error)


def _why(manager: Manager, task_id: int, node: int) -> Explanation | None:
    """Returns the last failure of a node; None if the manager has none."""
    return next((e for e in reversed(manager.why(task_id).explanations) if e.node == node), None)
