"""A running task as text: what its nodes do, as a tree and as a line for each change."""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from skiros2_common.command_line.layout import Branch, Screen, drawn, table

SUCCESS, FAILURE, RUNNING, IDLE = 1, 2, 3, 4

#: State on the wire -> symbol, the same in ASCII, word, ANSI colour.
_LOOKS = {
    SUCCESS: ("✓", "+", "success", "32"),
    FAILURE: ("✗", "x", "failure", "31"),
    RUNNING: ("▶", ">", "running", "36"),
    IDLE: ("·", ".", "idle", "90"),
}
_UNKNOWN = ("?", "?", "unknown", "35")

#: The colour of a hold-condition.
_CONDITION = "33"

#: A node whose message alone changes is told of so often at most (s).
_PACE = 1.0

#: The texts of the hold-conditions of a skill, by its type and label.
HoldConditions = Callable[[str, str], Sequence[str]]


@dataclass(frozen=True)
class Line:
    """A line of a picture, with the colour that it may be given."""

    text: str
    colour: str

    def shown(self, coloured: bool) -> str:
        return f"\033[{self.colour}m{self.text}\033[0m" if coloured else self.text


def has_ended(nodes: Sequence[Any]) -> bool:
    """Whether a `SkillProgress` of each node tells of a task that has ended."""
    return bool(abs(nodes[0].progress_code) == 1)


def summary(nodes: Sequence[Any]) -> str:
    """A task in one line."""
    root = nodes[0]
    message = first_line(root.progress_message) if root.state != SUCCESS else ""
    word = word_of(root.state)
    return f"task {root.id} on {root.robot}: {word}{f': {message}' if message else ''}"


def picture(screen: Screen, nodes: Sequence[Any], holds: HoldConditions, most: int | None = None) -> list[Line]:
    """The tree of a task.

    :param nodes: a `SkillProgress` for each, each before its children, the root first.
    :param holds: told of the nodes that run.
    :param most: so many lines at most; what neither runs nor has failed is left out first.
    """
    forest = _Forest(screen, nodes, holds)
    room = forest.size() if most is None else most - 1
    if forest.size() > room:
        forest.fold()
    left = forest.size() - room
    rows = forest.rows(room if left <= 0 else max(0, room - 1))
    texts = table(screen, [cells for _, cells in rows])
    lines = [Line(text, colour) for (colour, _), text in zip(rows, texts, strict=True)]
    more = [Line(f"{left + 1} more lines", _looks(IDLE)[3])] if left > 0 else []
    return [Line(screen.fitted(summary(nodes)), _looks(nodes[0].state)[3]), *lines, *more]


@dataclass
class _Node(Branch):
    """
    :param busy: whether it, or a node under it, runs or has failed.
    """

    colour: str = ""
    state: int = IDLE
    busy: bool = False


class _Forest:
    """The nodes of a task under its root, as branches."""

    def __init__(self, screen: Screen, nodes: Sequence[Any], holds: HoldConditions) -> None:
        self._screen = screen
        self._roots: list[Branch] = []
        known: dict[int, _Node] = {}
        self._all: list[_Node] = []
        for progress in nodes[1:]:
            node = self._node(progress, holds)
            parent = known.get(progress.parent_id)
            (parent.branches if parent is not None else self._roots).append(node)
            known[progress.id] = node
            self._all.append(node)
        for node in reversed(self._all):
            if node.branches:  # what is told of it is the time of its own last report
                node.cells = [node.cells[0], node.cells[1], "", node.cells[3]]
            node.busy = node.busy or any(isinstance(b, _Node) and b.busy for b in node.branches)

    def size(self) -> int:
        """How many rows there are."""
        size, waiting = 0, [*self._roots]
        while waiting:
            size += 1
            waiting += waiting.pop().branches
        return size

    def rows(self, most: int) -> list[tuple[str, list[str]]]:
        """Each row's colour and cells, from the first on."""
        branches = itertools.islice(drawn(self._screen, self._roots), most)
        return [(getattr(branch, "colour", _CONDITION), [text, *branch.cells[1:]]) for branch, text in branches]

    def fold(self) -> None:
        """Puts what neither runs nor has failed, several side by side, on one line."""
        self._roots = self._folded(self._roots)
        for node in self._all:
            node.branches = self._folded(node.branches) if node.busy else []

    def _folded(self, branches: Sequence[Branch]) -> list[Branch]:
        folded: list[Branch] = []
        quiet: list[_Node] = []
        for branch in [*branches, None]:
            if isinstance(branch, _Node) and not branch.busy:
                quiet.append(branch)
                continue
            folded += quiet if len(quiet) < 2 else [_count(quiet)]
            quiet = []
            if branch is not None:
                folded.append(branch)
        return folded

    def _node(self, progress: Any, holds: HoldConditions) -> _Node:
        state = progress.state
        symbol, ascii_symbol, word, colour = _looks(state)
        name = f"{symbol if self._screen.fancy else ascii_symbol} {name_of(progress)} {progress.processor}".rstrip()
        timed = "" if state == IDLE else f"{progress.progress_time:.1f} s"
        cells = [name, word, timed, message_of(progress)]
        conditions = holds(progress.type, progress.label) if state == RUNNING else ()
        return _Node(
            cells, [Branch([f"holds: {text}"]) for text in conditions], colour, state, state in (RUNNING, FAILURE)
        )


def _count(nodes: Sequence[_Node]) -> Branch:
    counts = [(state, sum(node.state == state for node in nodes)) for state in (SUCCESS, IDLE)]
    told = ", ".join(f"{count} {word_of(state)}" for state, count in counts if count)
    return _Node([f"{len(nodes)} more: {told}"], colour=_looks(IDLE)[3])


def name_of(progress: Any) -> str:
    """The label of a node; "group" for a node that only groups others, whose label is its processor's symbol."""
    return "group" if progress.type == ":Skill" else str(progress.label or progress.type)


def message_of(progress: Any) -> str:
    """The message in one line, with the code of a failure."""
    message = first_line(progress.progress_message)
    return f"{message} ({progress.progress_code})".strip() if progress.progress_code < 0 else message


def word_of(state: int) -> str:
    """A state in a word."""
    return _looks(state)[2]


def first_line(text: str) -> str:
    return text.strip().splitlines()[0] if text.strip() else ""


def _looks(state: int) -> tuple[str, str, str, str]:
    return _LOOKS.get(state, _UNKNOWN)


class Changes:
    """A task as a line for each change of a node, with the time since the first one.

    A node's beginning comes before what its children do, its end after that.

    :param clock: gives the time (s).
    """

    def __init__(self, screen: Screen, clock: Callable[[], float] = time.monotonic) -> None:
        self._screen = screen
        self._clock = clock
        self._began_at = clock()
        self._told: dict[int, tuple[int, str, float]] = {}  # state, message and time by node

    def lines(self, nodes: Sequence[Any]) -> Iterator[Line]:
        """What is new in the progress of the nodes of the task, the root first."""
        depth: dict[int, int] = {}
        above: list[Any] = []
        for node in nodes[1:]:
            depth[node.id] = depth.get(node.parent_id, -1) + 1
            while above and above[-1].id != node.parent_id:
                yield from self._new(above.pop(), depth)
            if node.state == RUNNING:
                yield from self._new(node, depth)
            above.append(node)
        for node in reversed(above):
            yield from self._new(node, depth)

    def _new(self, node: Any, depth: dict[int, int]) -> Iterable[Line]:
        now = self._clock()
        message = message_of(node)
        state, told, since = self._told.get(node.id, (IDLE, "", now))
        if node.state == state and (message == told or state != RUNNING or now - since < _PACE):
            return
        self._told[node.id] = (node.state, message, now)
        if node.state == IDLE:
            return
        symbol, ascii_symbol, _, colour = _looks(node.state)
        mark = symbol if self._screen.fancy else ascii_symbol
        name = f"{'  ' * depth[node.id]}{mark} {name_of(node)} {node.processor}".rstrip()
        text = f"{now - self._began_at:6.1f} s  {f'{name}  {message}' if message else name}"
        yield Line(self._screen.fitted(text), colour)
