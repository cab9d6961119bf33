"""The breakpoints of the managers."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from skiros2_common.core.errors import WrongValue
from skiros2_gui.app.events import ManagersChanged
from skiros2_gui.app.system import Manager
from skiros2_gui.app.window import Window
from skiros2_runs.core.frame import Shape
from skiros2_skill.core.breakpoint import AT_END, BEFORE_START, NODE, WHEN, Breakpoint

#: Descriptions, by kind and when.
_TEXTS = {
    ("node", "start"): "before the start of node",
    ("node", "end"): "at the end of node",
    ("condition", "fails"): "when a condition fails:",
    ("world", "changes"): "when the world model changes:",
}


@dataclass(frozen=True)
class ManagerBreakpoint:
    """A breakpoint of a manager."""

    robot: str
    number: int
    breakpoint: Breakpoint

    def __str__(self) -> str:
        b = self.breakpoint
        return f"{_TEXTS.get((b.kind, b.when), f'{b.kind} {b.when}')} {b.pattern}"


#: The kinds of breakpoints: description, kind, when.
CHOICES = [(_TEXTS[kind, when].rstrip(":"), kind, when) for kind, moments in WHEN.items() for when in moments]


class Breakpoints:
    """Used in the window's thread.

    :param on_change: called when the known breakpoints have changed.
    """

    def __init__(self, window: Window, on_change: Callable[[], None]) -> None:
        self._window = window
        self._on_change = on_change
        self._known: dict[str, list[ManagerBreakpoint]] = {}
        self._robots: set[str] = set()
        window.subscribe(ManagersChanged, lambda _: self._update_managers())
        self._update_managers()

    def of(self, robot: str) -> Sequence[ManagerBreakpoint]:
        """Returns the known breakpoints of a manager."""
        return self._known.get(robot, [])

    def ask(self, robot: str) -> None:
        """Reads the breakpoints of a manager; clears those of a manager that is down."""
        if robot in self._window.system.managers:
            self._send(robot, "", lambda manager: None)
        elif self._known.pop(robot, None):
            self._on_change()

    def add(self, robot: str, kind: str, pattern: str, when: str) -> None:
        """Adds a breakpoint; see `skiros2_skill.core.engine.breakpoints`."""
        self._send(robot, "adding a breakpoint", lambda m: m.set_breakpoint(kind, pattern.strip(), when))

    def remove(self, known: ManagerBreakpoint) -> None:
        self._send(known.robot, "removing a breakpoint", lambda m: m.remove_breakpoint(known.number))

    def toggle(self, robot: str, shape: Shape, index: int, when: str = BEFORE_START) -> None:
        """Adds a breakpoint at a node, or removes it."""
        there = [k for k in self.at(robot, shape, index) if k.breakpoint.when == when]
        for known in there:
            self.remove(known)
        if not there:
            self.add(robot, NODE, _pattern(shape, index), when)

    def at(self, robot: str, shape: Shape, index: int) -> list[ManagerBreakpoint]:
        """Returns the breakpoints that match a node."""
        kind, label = shape.type(index), shape.label(index)
        names = (label, kind, f"{kind}-{label}")
        return [k for k in self.of(robot) if k.breakpoint.kind == NODE and k.breakpoint.matches(names)]

    def by_node(self, robot: str, shape: Shape) -> dict[int, str]:
        """Maps the indices of the nodes with breakpoints to `start`, `end` or `start end`."""
        known = [k for k in self.of(robot) if k.breakpoint.kind == NODE]
        found: dict[int, str] = {}
        if known:
            by_name: dict[tuple[str, str], str] = {}
            for index, (_, _, kind, label, _) in enumerate(shape.keys):
                if (kind, label) not in by_name:
                    here = {k.breakpoint.when for k in known if k.breakpoint.matches((label, kind, f"{kind}-{label}"))}
                    by_name[kind, label] = " ".join(w for w in (BEFORE_START, AT_END) if w in here)
                if by_name[kind, label] and index:
                    found[index] = by_name[kind, label]
        return found

    def _update_managers(self) -> None:
        robots = set(self._window.system.managers)
        changed, self._robots = self._robots ^ robots, robots
        for robot in sorted(changed):
            self.ask(robot)

    def _send(self, robot: str, activity: str, change: Callable[[Manager], object]) -> None:
        """Changes the breakpoints of a manager and reads them."""
        manager = self._window.system.managers.get(robot)
        if manager is None:
            self._window.problems.report(activity, WrongValue(f"{robot} is not running"))
            return

        def call() -> list[ManagerBreakpoint]:
            change(manager)
            return [ManagerBreakpoint(robot, number, known) for number, known in manager.breakpoints().items()]

        failed = None if activity else (lambda error: self._take(robot, []))
        self._window.jobs.run(call, lambda known: self._take(robot, known), failed, activity=activity, queue=robot)

    def _take(self, robot: str, known: list[ManagerBreakpoint]) -> None:
        if self._known.get(robot, []) != known:
            self._known[robot] = known
            self._on_change()


def _pattern(shape: Shape, index: int) -> str:
    """Returns the most specific pattern that matches a node."""
    kind, label = shape.type(index), shape.label(index)
    return f"{kind}-{label}" if label else kind
