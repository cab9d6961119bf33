"""Breakpoints, at which tasks pause.

A breakpoint ends the tick early without preempting anything; the next tick continues at the same node.
"""

from __future__ import annotations

import threading
from collections.abc import Iterable, Sequence

from skiros2_common.core.condition import ConditionBase
from skiros2_common.core.errors import UnknownName, WrongValue
from skiros2_common.core.operations import Change
from skiros2_skill.core.breakpoint import AT_END, BEFORE_START, CHANGES, CONDITION, FAILS, NODE, WHEN, WORLD, Breakpoint
from skiros2_skill.core.engine.skill_run import Node


class BreakpointReached(Exception):
    """A tick has reached a breakpoint and ends there."""


class Breakpoints:
    """The breakpoints of a manager, by number. Any thread."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._breakpoints: dict[int, Breakpoint] = {}
        self._last = 0

    def __bool__(self) -> bool:
        return bool(self._breakpoints)

    def add(self, breakpoint: Breakpoint) -> int:
        """Adds a breakpoint.

        :returns: its number.
        :raises WrongValue: the kind or event is unknown, or the pattern is empty.
        """
        if breakpoint.kind not in WHEN:
            raise WrongValue(f"a breakpoint of kind {breakpoint.kind!r}, expected one of: {', '.join(WHEN)}")
        when = breakpoint.when or WHEN[breakpoint.kind][0]
        if when not in WHEN[breakpoint.kind]:
            known = ", ".join(WHEN[breakpoint.kind])
            raise WrongValue(f"a {breakpoint.kind} breakpoint at {when!r}, expected one of: {known}")
        if not breakpoint.pattern:
            raise WrongValue(f"a {breakpoint.kind} breakpoint without a name or pattern")
        with self._lock:
            self._last += 1
            self._breakpoints = {**self._breakpoints, self._last: Breakpoint(breakpoint.kind, breakpoint.pattern, when)}
            return self._last

    def remove(self, number: int) -> None:
        """Removes a breakpoint.

        :raises UnknownName: there is no such breakpoint.
        """
        with self._lock:
            if number not in self._breakpoints:
                known = ", ".join(map(str, self._breakpoints)) or "none"
                raise UnknownName(f"no breakpoint {number}; there are: {known}")
            self._breakpoints = {n: b for n, b in self._breakpoints.items() if n != number}

    def all(self) -> dict[int, Breakpoint]:
        """The breakpoints by number."""
        return dict(self._breakpoints)

    # -- the message when a breakpoint is reached, else "" -------------------------------------------------------

    def at_node(self, node: Node, when: str) -> str:
        names = (node.label, node.type, f"{node.type}-{node.label}")
        event = "before the start" if when == BEFORE_START else "at the end"
        name = f"{node.type}-{node.label}" if node.label else node.type
        return self._reached(NODE, when, names, f"{event} of {name}")

    def at_condition(self, label: str) -> str:
        return self._reached(CONDITION, FAILS, (label,), f"condition [{label}] fails")

    def at_change(self, change: Change) -> str:
        for element in change.elements:
            reached = self._reached(WORLD, CHANGES, (element.id, element.label), f"{change.action} of {element!r}")
            if reached:
                return reached
        for r in change.relations:
            names = (r["type"], r["src"], r["dst"])
            reached = self._reached(WORLD, CHANGES, names, f"{change.action} of {r['src']} {r['type']} {r['dst']}")
            if reached:
                return reached
        return ""

    def _reached(self, kind: str, when: str, names: Iterable[str], text: str) -> str:
        for number, breakpoint in self._breakpoints.items():
            if breakpoint.kind == kind and breakpoint.when == when and breakpoint.matches(names):
                return f"paused at breakpoint {number}: {text}"
        return ""


class TaskBreakpoints:
    """Checks the breakpoints during the ticks of one task. For the ticking thread.

    :param breakpoints: of the manager; None: there are none.
    """

    def __init__(self, breakpoints: Breakpoints | None) -> None:
        self._breakpoints = breakpoints if breakpoints is not None else Breakpoints()
        self._reached = ""  # raised later, when the parents of the node have processed its state
        self._stopped: Node | None = None  # the node that was stopped before its start

    def __bool__(self) -> bool:
        """Whether there is anything to check."""
        return bool(self._reached or self._stopped is not None or self._breakpoints._breakpoints)

    def ignore_all(self) -> None:
        """Ignores breakpoints from now on."""
        self._breakpoints, self._reached, self._stopped = Breakpoints(), "", None

    def before_start(self, node: Node) -> None:
        """Checks the breakpoints on the start of a node.

        :raises BreakpointReached: the task pauses before the start.
        """
        if not self._reached and self._stopped is not node:
            self._reached = self._breakpoints.at_node(node, BEFORE_START)
            self._stopped = node if self._reached else None
        else:
            self._stopped = None
        self.raise_if_reached()

    def after_end(self, node: Node) -> None:
        """Checks the breakpoints on the end of a node."""
        self._reached = self._reached or self._breakpoints.at_node(node, AT_END)

    def at_failure(self, conditions: Sequence[ConditionBase]) -> None:
        """Checks the breakpoints on unsatisfied conditions."""
        for condition in conditions:
            self._reached = self._reached or self._breakpoints.at_condition(condition.label)

    def raise_if_reached(self) -> None:
        """
        :raises BreakpointReached: a breakpoint was reached.
        """
        reached, self._reached = self._reached, ""
        if reached:
            raise BreakpointReached(reached)
