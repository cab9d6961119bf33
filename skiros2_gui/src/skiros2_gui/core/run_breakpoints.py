"""The breakpoints of the managers, as the window knows them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from skiros2_common.core.errors import WrongValue
from skiros2_gui.core.run_shape import Shape
from skiros2_gui.core.window import Window
from skiros2_skill.core.engine.breakpoints import AT_END, BEFORE_START, NODE, WHEN, Breakpoint

#: In words, by kind and when.
_WORDS = {
    ("node", "start"): "before the start of node",
    ("node", "end"): "at the end of node",
    ("condition", "fails"): "when a condition fails:",
    ("world", "changes"): "when the world model changes:",
}


@dataclass(frozen=True)
class Known:
    """A breakpoint that a manager has."""

    robot: str
    number: int
    breakpoint: Breakpoint

    def __str__(self) -> str:
        b = self.breakpoint
        return f"{_WORDS.get((b.kind, b.when), f'{b.kind} {b.when}')} {b.pattern}"


#: What a user may choose between: words, kind, when.
CHOICES = [(_WORDS[kind, when].rstrip(":"), kind, when) for kind, moments in WHEN.items() for when in moments]


class RunBreakpoints:
    """Used in the window's thread.

    :param on_change: called when those that are known have changed.
    """

    def __init__(self, window: Window, on_change: Callable[[], None]) -> None:
        self._window = window
        self._on_change = on_change
        self._known: dict[str, list[Known]] = {}

    def of(self, robot: str) -> Sequence[Known]:
        """Those of a manager, as they were told last."""
        return self._known.get(robot, [])

    def ask(self, robot: str) -> None:
        """Has the manager tell them; one that is not there has none."""
        if robot in self._window.system.managers:
            self._send(robot, "", "list")
        elif self._known.pop(robot, None):
            self._on_change()

    def add(self, robot: str, kind: str, pattern: str, when: str) -> None:
        """Has tasks of a manager pause; see `skiros2_skill.core.engine.breakpoints`."""
        self._send(robot, "adding a breakpoint", "add", kind, pattern.strip(), when)

    def remove(self, known: Known) -> None:
        self._send(known.robot, "removing a breakpoint", "remove", number=known.number)

    def toggle(self, robot: str, shape: Shape, place: int, when: str = BEFORE_START) -> None:
        """Has tasks pause at a node, or no more."""
        there = [k for k in self.at(robot, shape, place) if k.breakpoint.when == when]
        for known in there:
            self.remove(known)
        if not there:
            self.add(robot, NODE, _pattern(shape, place), when)

    def at(self, robot: str, shape: Shape, place: int) -> list[Known]:
        """Those that a node would stop at."""
        kind, label = shape.type(place), shape.label(place)
        names = (label, kind, f"{kind}-{label}")
        return [k for k in self.of(robot) if k.breakpoint.kind == NODE and k.breakpoint.matches(names)]

    def marks(self, robot: str, shape: Shape) -> dict[int, str]:
        """The places of the nodes at which tasks pause: `start`, `end` or `start end`."""
        known = [k for k in self.of(robot) if k.breakpoint.kind == NODE]
        marked: dict[int, str] = {}
        if known:
            by_name: dict[tuple[str, str], str] = {}
            for place, (_, _, kind, label, _) in enumerate(shape.keys):
                if (kind, label) not in by_name:
                    here = {k.breakpoint.when for k in known if k.breakpoint.matches((label, kind, f"{kind}-{label}"))}
                    by_name[kind, label] = " ".join(w for w in (BEFORE_START, AT_END) if w in here)
                if by_name[kind, label] and place:
                    marked[place] = by_name[kind, label]
        return marked

    def _send(
        self, robot: str, what: str, action: str, kind: str = "", pattern: str = "", when: str = "", number: int = 0
    ) -> None:
        manager = self._window.system.managers.get(robot)
        if manager is None:
            self._window.problems.tell(what, WrongValue(f"{robot} is not there"))
            return

        def call() -> list[Known]:
            manager.breakpoint(action, kind, pattern, when, number)
            return _read(robot, manager.breakpoint("list")[1])

        failed = None if what else (lambda error: self._take(robot, []))
        self._window.jobs.run(call, lambda known: self._take(robot, known), failed, what=what, lane=robot)

    def _take(self, robot: str, known: list[Known]) -> None:
        if self._known.get(robot, []) != known:
            self._known[robot] = known
            self._on_change()


def _pattern(shape: Shape, place: int) -> str:
    """What names a node and as few others as may be."""
    kind, label = shape.type(place), shape.label(place)
    return f"{kind}-{label}" if label else kind


def _read(robot: str, listed: Any) -> list[Known]:
    """
    :raises WrongValue: a manager answers something else than breakpoints.
    """
    try:
        return [Known(robot, int(b["number"]), Breakpoint(b["kind"], b["pattern"], b["when"])) for b in listed]
    except (KeyError, TypeError, ValueError) as error:
        raise WrongValue(f"{robot} answers {listed!r}, expected a list of breakpoints") from error
