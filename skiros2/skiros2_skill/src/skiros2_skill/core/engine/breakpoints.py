"""Breakpoints: where a task is to pause by itself."""

from __future__ import annotations

import fnmatch
import threading
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from skiros2_common.core.errors import UnknownName, WrongValue
from skiros2_common.core.names import full_name

NODE, CONDITION, WORLD = "node", "condition", "world"
BEFORE_START, AT_END, FAILS, CHANGES = "start", "end", "fails", "changes"

#: When a breakpoint of each kind may hold a task; the first is the default.
WHEN = {NODE: (BEFORE_START, AT_END), CONDITION: (FAILS,), WORLD: (CHANGES,)}


@dataclass(frozen=True)
class Breakpoint:
    """Where tasks pause.

    :param kind: `node`, `condition` or `world`.
    :param pattern: a name, or a pattern of one with `*`, `?` and `[]`; upper and lower case are the same, the
        prefix of the default ontology may be left out. For a node its label, its type, or `type-label`; for a condition
        its label; for the world the id or label of an element, or a relation.
    :param when: for a node `start` (before it starts) or `end`, for a condition `fails`, for the world `changes`; "" is
        the first of these.
    """

    kind: str
    pattern: str
    when: str = ""

    def __str__(self) -> str:
        return f"{self.kind} {self.pattern} {self.when}"

    def matches(self, names: Iterable[str]) -> bool:
        patterns = {self.pattern.lower(), full_name(self.pattern.lower())}
        return any(fnmatch.fnmatchcase(name.lower(), pattern) for name in names if name for pattern in patterns)


class Break(Exception):
    """A tick has come to a breakpoint and ends there; the next one goes on."""


class Breakpoints:
    """The breakpoints of all tasks of a manager, by number. Any thread."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._known: dict[int, Breakpoint] = {}
        self._last = 0

    def __bool__(self) -> bool:
        return bool(self._known)

    def add(self, breakpoint: Breakpoint) -> int:
        """
        :returns: its number.
        :raises WrongValue: there is no such kind or time, or no pattern.
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
            self._known = {**self._known, self._last: Breakpoint(breakpoint.kind, breakpoint.pattern, when)}
            return self._last

    def remove(self, number: int) -> None:
        """
        :raises UnknownName: there is no such breakpoint.
        """
        with self._lock:
            if number not in self._known:
                known = ", ".join(map(str, self._known)) or "none"
                raise UnknownName(f"no breakpoint {number}; there are: {known}")
            self._known = {n: b for n, b in self._known.items() if n != number}

    def all(self) -> dict[int, Breakpoint]:
        """The breakpoints by number."""
        return dict(self._known)

    # -- what has come to one, in words; "" when nothing has -----------------------------------------------------

    def at_node(self, node: Any, when: str) -> str:
        names = (node.label, node.type, f"{node.type}-{node.label}")
        place = "before the start" if when == BEFORE_START else "at the end"
        name = f"{node.type}-{node.label}" if node.label else node.type
        return self._reached(NODE, when, names, f"{place} of {name}")

    def at_condition(self, label: str) -> str:
        return self._reached(CONDITION, FAILS, (label,), f"condition [{label}] fails")

    def at_change(self, change: Any) -> str:
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
        for number, known in self._known.items():
            if known.kind == kind and known.when == when and known.matches(names):
                return f"paused at breakpoint {number}: {text}"
        return ""
