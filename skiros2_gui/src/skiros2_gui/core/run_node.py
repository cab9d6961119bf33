"""The selected node of a tree, in words."""

from __future__ import annotations

import time
from dataclasses import dataclass, field

from skiros2_common.core.explanation import HOLD, POST, PRE, Explanation
from skiros2_gui.core.run_frame import Frame
from skiros2_gui.core.states import IDLE, RUNNING, look_of
from skiros2_skill.core.diagnosis.inspection import FAILS, HOLDS, ConditionStatus, NodeStatus

#: How a verdict is marked.
VERDICTS = {HOLDS: "✓", FAILS: "✗"}

#: So many of the nodes that it is in are named.
_MOST_ABOVE = 5

#: Said of a skill without a label.
CHOSEN_LATER = "chosen when it starts"

#: When a condition is needed.
STAGES = {PRE: "before the start", HOLD: "while it runs", POST: "at the end"}


@dataclass(frozen=True)
class ConditionText:
    """
    :param stage: when it is needed.
    :param mark: whether it holds: ✓, ✗ or ?.
    :param text: what it asks for.
    :param found: what is so instead; "" where nothing more is known.
    :param elements: those that the texts speak of, as they stand there: `id-label`.
    """

    stage: str
    mark: str
    text: str
    found: str
    elements: list[str]


@dataclass(frozen=True)
class NodeText:
    """
    :param title: the node's name.
    :param facts: each a name and a value.
    :param conditions: in the order in which they are needed.
    :param params: each a name, a value, and where that came from.
    :param why: why it failed, in lines.
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
    frame: Frame, place: int, now: NodeStatus | None = None, why: Explanation | None = None, note: str = ""
) -> NodeText:
    """A node at a tick.

    :param now: what its manager says of it; None: it was not asked.
    :param why: why it failed, as far as it is known.
    """
    shape, state = frame.shape, frame.state(place)
    facts = [("state", f"{look_of(state).symbol} {look_of(state).word}")]
    if why is None and (message := frame.message(place)):
        facts.append(("message", message))
    duration = frame.duration(place)
    if duration is not None:
        facts.append(("runs for" if state == RUNNING else "took", duration_text(duration)))
        began = frame.began(place)
        if began is not None:
            facts.append(("began", clock_text(began)))
    if shape.is_skill(place):
        facts.append(("skill", shape.type(place)))
        if not shape.label(place):
            facts.append(("implementation", CHOSEN_LATER))
    if shape.processor(place):
        facts.append(("children", processor_text(shape.processor(place))))
    if state != IDLE:
        facts.append(("code", str(frame.code(place))))
    path = shape.path_names(place)[:-1]
    if path:
        facts.append(("in", " › ".join(["…", *path[-_MOST_ABOVE:]] if len(path) > _MOST_ABOVE else path)))
    conditions = [_condition(condition, state) for condition in now.conditions] if now is not None else []
    params = [] if now is None else [(p.key, p.value or "unset", p.words if p.source else "") for p in now.params]
    return NodeText(
        shape.name(place), state, facts, conditions, params, list(why.lines())[1:] if why is not None else [], note
    )


def _condition(now: ConditionStatus, state: int) -> ConditionText:
    """What a condition is now; that is not always when it is needed."""
    stage = STAGES.get(now.stage, now.stage)
    if now.stage == PRE and state != IDLE:
        stage += " (it has started; this is how it is now)"
    elif now.stage == POST and state in (IDLE, RUNNING):
        stage += " (not yet)"
    mark = VERDICTS.get(now.verdict, "?")
    return ConditionText(stage, mark, now.text, now.found, now.elements)


#: How nodes tick their children, by the symbol.
_PROCESSORS = {
    "->": "one after the other, from the first again at each tick",
    "->*": "one after the other",
    "?": "the first that does not fail, tried anew at each tick",
    "?*": "the first that does not fail",
    "|ff|": "all at once; fails as soon as one fails",
    "|fs|": "all at once; ends as soon as one ends",
}


def processor_text(symbol: str) -> str:
    """How a node ticks its children, in words."""
    words = _PROCESSORS.get(symbol, "")
    return f"{words} ({symbol})" if words else symbol


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
    """In six characters at most: `0.42 s`, `12.3 s`, `3 min`, `2 h`."""
    if seconds < 59.95:
        return f"{seconds:.2f} s" if seconds < 9.995 else f"{seconds:.1f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5970 else f"{seconds / 3600:.0f} h"


def clock_text(moment: float) -> str:
    """The local time of day with tenths of a second, such as `14:05:30.2`."""
    tenths = int(moment * 10)
    return f"{time.strftime('%H:%M:%S', time.localtime(tenths // 10))}.{tenths % 10}"
