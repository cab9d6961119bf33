"""The selected node: its details as text, read from its manager."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field

from skiros2_common.core.errors import SkirosError
from skiros2_common.core.explanation import HOLD, POST, PRE, Explanation
from skiros2_common.core.names import local_name
from skiros2_gui.app.problems import error_text
from skiros2_gui.app.system import Manager
from skiros2_gui.app.window import Window
from skiros2_runs.core.frame import Frame
from skiros2_runs.core.states import FAILURE, IDLE, RUNNING, style_of
from skiros2_runs.core.task_run import TaskRun
from skiros2_runs.core.values import FAILS, HOLDS, ConditionStatus, NodeStatus

#: The symbols of verdicts.
VERDICTS = {HOLDS: "✓", FAILS: "✗"}

#: The most ancestors named.
_MAX_ANCESTORS = 5

#: The implementation of a skill without a label.
CHOSEN_LATER = "chosen when it starts"

#: When a condition is checked.
STAGES = {PRE: "before the start", HOLD: "while it runs", POST: "at the end"}


@dataclass(frozen=True)
class ConditionText:
    """:param stage: when it is checked.
    :param symbol: whether it holds: ✓, ✗ or ?.
    :param text: the condition.
    :param found: the actual state; "" if unknown.
    :param elements: the elements in the texts, each as `id-label`.
    """

    stage: str
    symbol: str
    text: str
    found: str
    elements: list[str]


@dataclass(frozen=True)
class NodeText:
    """:param title: the node's name.
    :param facts: pairs of name and value.
    :param conditions: in the order of their stages.
    :param params: name, value and provenance of each.
    :param why: the explanation of a failure, in lines.
    :param note: why there are no conditions.
    """

    title: str
    state: int
    facts: list[tuple[str, str]] = field(default_factory=list)
    conditions: list[ConditionText] = field(default_factory=list)
    params: list[tuple[str, str, str]] = field(default_factory=list)
    why: list[str] = field(default_factory=list)
    note: str = ""


def node_text(
    frame: Frame, index: int, now: NodeStatus | None = None, why: Explanation | None = None, note: str = ""
) -> NodeText:
    """Describes a node at a tick.

    :param now: its parameters and conditions at that tick; None if they are not known.
    :param why: why it failed, if known.
    """
    shape, state = frame.shape, frame.state(index)
    facts = [("state", f"{style_of(state).symbol} {style_of(state).word}")]
    if why is None and (message := frame.message(index)):
        facts.append(("message", message))
    duration = frame.duration(index)
    if duration is not None:
        facts.append(("runs for" if state == RUNNING else "took", duration_text(duration)))
        began = frame.began(index)
        if began is not None:
            facts.append(("began", clock_text(began)))
    if shape.is_skill(index):
        facts.append(("skill", local_name(shape.type(index))))
        if not shape.label(index):
            facts.append(("implementation", CHOSEN_LATER))
    if shape.processor(index):
        facts.append(("children", processor_text(shape.processor(index))))
    if state != IDLE:
        facts.append(("code", str(frame.code(index))))
    path = shape.path_names(index)[:-1]
    if path:
        facts.append(("in", " › ".join(["…", *path[-_MAX_ANCESTORS:]] if len(path) > _MAX_ANCESTORS else path)))
    conditions = [_condition(condition) for condition in now.conditions] if now is not None else []
    params = [] if now is None else [(p.key, p.value or "unset", p.source_text if p.source else "") for p in now.params]
    return NodeText(
        shape.name(index), state, facts, conditions, params, list(why.lines()) if why is not None else [], note
    )


def _condition(condition: ConditionStatus) -> ConditionText:
    """Describes a condition as it was evaluated, with the time; before its evaluation, as a preview."""
    stage = STAGES.get(condition.stage, condition.stage)
    stage += f", evaluated at {clock_text(condition.time)}" if condition.time else " (not evaluated yet; as it is now)"
    symbol = VERDICTS.get(condition.verdict, "?")
    return ConditionText(stage, symbol, condition.text, condition.found, condition.elements)


#: How processors tick the children, by symbol.
_PROCESSORS = {
    "->": "in sequence, from the first again at each tick",
    "->*": "in sequence",
    "?": "fallback to the next after a failure, from the first again at each tick",
    "?*": "fallback to the next after a failure",
    "|ff|": "in parallel; fails as soon as one fails",
    "|fs|": "in parallel; ends as soon as one ends",
}


def processor_text(symbol: str) -> str:
    """Describes how a node ticks its children."""
    text = _PROCESSORS.get(symbol, "")
    return f"{text} ({symbol})" if text else symbol


def duration_text(seconds: float) -> str:
    """`0.42 s`, `12.3 s`, `3 min 20 s`, `2 h 05 min`."""
    if seconds < 10:
        return f"{seconds:.2f} s"
    if seconds < 60:
        return f"{seconds:.1f} s"
    minutes, rest = divmod(int(seconds), 60)
    if minutes < 60:
        return f"{minutes} min {rest:02d} s"
    return f"{minutes // 60} h {minutes % 60:02d} min"


def short_duration(seconds: float) -> str:
    """At most six characters: `0.42 s`, `12.3 s`, `3 min`, `2 h`."""
    if seconds < 59.95:
        return f"{seconds:.2f} s" if seconds < 9.995 else f"{seconds:.1f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5970 else f"{seconds / 3600:.0f} h"


def clock_text(moment: float) -> str:
    """The local time of day with tenths of a second, such as `14:05:30.2`."""
    tenths = int(moment * 10)
    return f"{time.strftime('%H:%M:%S', time.localtime(tenths // 10))}.{tenths % 10}"


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

    def ask(
        self, run: TaskRun, node: int, shown: TaskRun, frame: Frame, index: int, is_live: bool, can_ask: bool
    ) -> None:
        """Reads the details of a node. While a request is running, only the last one is kept.

        :param run: the task of the node.
        :param node: the id of the node in its task.
        :param shown: the task whose tree has the node at `index`: the same, or a goal.
        :param can_ask: whether the manager may know the task.
        """
        if self._of != (run, node):
            self._of, self._answer = (run, node), _NOTHING
        manager = self._window.system.managers.get(run.robot) if can_ask else None
        has_failed = frame.state(index) == FAILURE
        wants_values = frame.shape.is_skill(index) and (is_live or _lacks_values(run, node, shown, frame, index))
        if manager is None or not (wants_values or has_failed):
            return
        if self._is_asking:
            self._next_request = lambda: self.ask(run, node, shown, frame, index, is_live, can_ask)
            return
        self._is_asking = True

        def call() -> tuple[NodeStatus | None, _Answer]:
            now, problem = _inspect(manager, run.task_id, node) if wants_values else (None, "")
            return now, _Answer(_why(manager, run.task_id, node) if has_failed else None, problem)

        self._window.jobs.run(call, lambda answer: self._take(run, node, *answer), self._fail, queue=run.robot)

    def text(self, run: TaskRun, node: int, shown: TaskRun, frame: Frame, index: int, is_recorded: bool) -> NodeText:
        """Returns the node's description with the details read so far.

        :param run, node, shown: see `ask`.
        :param is_recorded: whether the task is one of a bag.
        """
        answer = self._answer if self._of is not None and self._of[1] == node else _NOTHING
        values = _values(run, node, shown, frame, index)
        note = answer.problem
        if values is None and not note and frame.shape.is_skill(index) and frame is not shown.latest:
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


def _lacks_values(run: TaskRun, node: int, shown: TaskRun, frame: Frame, index: int) -> bool:
    """Returns whether the manager may know more about a node than was read before it ended."""
    values = _values(run, node, shown, frame, index)
    return values is None or (frame is shown.latest and values.time < run.latest.time)


def _values(run: TaskRun, node: int, shown: TaskRun, frame: Frame, index: int) -> NodeStatus | None:
    """Returns the values of a node at a tick, as far as they were read; None for a node that had not started."""
    if frame is shown.latest:
        return run.values_at(node, math.inf)
    return run.values_at(node, frame.time) if frame.state(index) != IDLE else None


def _inspect(manager: Manager, task_id: int, node: int) -> tuple[NodeStatus | None, str]:
    """Returns the details of a node, or None and the error message."""
    try:
        return manager.inspect(task_id, node), ""
    except SkirosError as error:
        return None, error_text(error)


def _why(manager: Manager, task_id: int, node: int) -> Explanation | None:
    """Returns the last failure of a node; None if the manager has none."""
    return next((e for e in reversed(manager.why(task_id).explanations) if e.node == node), None)
