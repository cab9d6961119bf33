"""A running task as text: a tree, or one line per change."""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from skiros2_common.command_line.layout import Branch, Screen, drawn, table

SUCCESS, FAILURE, RUNNING, IDLE = 1, 2, 3, 4

#: State in messages -> symbol, ASCII symbol, word, ANSI colour.
_STYLES = {
    SUCCESS: ("✓", "+", "success", "32"),
    FAILURE: ("✗", "x", "failure", "31"),
    RUNNING: ("▶", ">", "running", "36"),
    IDLE: ("·", ".", "idle", "90"),
}
_UNKNOWN = ("?", "?", "unknown", "35")

#: The colour of a hold-condition.
_CONDITION = "33"

#: Minimum time between lines for a node of which only the message changes (s).
_MESSAGE_PERIOD = 1.0

#: Returns the texts of the hold-conditions of a skill, by type and label.
HoldConditions = Callable[[str, str], Sequence[str]]


@dataclass(frozen=True)
class Line:
    """A line of text and its colour."""

    text: str
    colour: str

    def shown(self, coloured: bool) -> str:
        return f"\033[{self.colour}m{self.text}\033[0m" if coloured else self.text


def has_ended(nodes: Sequence[Any]) -> bool:
    """Whether a task, given as the `SkillProgress` of each node, has ended."""
    return bool(abs(nodes[0].progress_code) == 1)


def summary(nodes: Sequence[Any]) -> str:
    """A task in one line."""
    root = nodes[0]
    message = first_line(root.progress_message) if root.state != SUCCESS else ""
    word = word_of(root.state)
    return f"task {root.id} on {root.robot}: {word}{f': {message}' if message else ''}"


def picture(screen: Screen, nodes: Sequence[Any], holds: HoldConditions, max_lines: int | None = None) -> list[Line]:
    """The tree of a task.

    :param nodes: the `SkillProgress` of each node, parents before children.
    :param holds: shown for running nodes.
    :param max_lines: maximum number of lines; nodes that neither run nor have failed are omitted first.
    """
    forest = _Forest(screen, nodes, holds)
    room = forest.size() if max_lines is None else max_lines - 1
    if forest.size() > room:
        forest.fold()
    excess = forest.size() - room
    rows = forest.rows(room if excess <= 0 else max(0, room - 1))
    texts = table(screen, [cells for _, cells in rows])
    lines = [Line(text, colour) for (colour, _), text in zip(rows, texts, strict=True)]
    more = [Line(f"{excess + 1} more lines", _style(IDLE)[3])] if excess > 0 else []
    return [Line(screen.fitted(summary(nodes)), _style(nodes[0].state)[3]), *lines, *more]


@dataclass
class _Node(Branch):
    """
    :param busy: whether it or a descendant runs or has failed.
    """

    colour: str = ""
    state: int = IDLE
    busy: bool = False


class _Forest:
    """The nodes of a task without its root, as branches."""

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
            if node.branches:  # its time is only that of its own last progress
                node.cells = [node.cells[0], node.cells[1], "", node.cells[3]]
            node.busy = node.busy or any(isinstance(b, _Node) and b.busy for b in node.branches)

    def size(self) -> int:
        """The number of rows."""
        size, pending = 0, [*self._roots]
        while pending:
            size += 1
            pending += pending.pop().branches
        return size

    def rows(self, limit: int) -> list[tuple[str, list[str]]]:
        """The colour and cells of the first rows."""
        branches = itertools.islice(drawn(self._screen, self._roots), limit)
        return [(getattr(branch, "colour", _CONDITION), [text, *branch.cells[1:]]) for branch, text in branches]

    def fold(self) -> None:
        """Joins adjacent nodes that neither run nor have failed into one line."""
        self._roots = self._folded(self._roots)
        for node in self._all:
            node.branches = self._folded(node.branches) if node.busy else []

    def _folded(self, branches: Sequence[Branch]) -> list[Branch]:
        folded: list[Branch] = []
        idle: list[_Node] = []
        for branch in [*branches, None]:
            if isinstance(branch, _Node) and not branch.busy:
                idle.append(branch)
                continue
            folded += idle if len(idle) < 2 else [_count(idle)]
            idle = []
            if branch is not None:
                folded.append(branch)
        return folded

    def _node(self, progress: Any, holds: HoldConditions) -> _Node:
        state = progress.state
        symbol, ascii_symbol, word, colour = _style(state)
        name = f"{symbol if self._screen.fancy else ascii_symbol} {name_of(progress)} {progress.processor}".rstrip()
        timed = "" if state == IDLE else f"{progress.progress_time:.1f} s"
        cells = [name, word, timed, message_of(progress)]
        conditions = holds(progress.type, progress.label) if state == RUNNING else ()
        return _Node(
            cells, [Branch([f"holds: {text}"]) for text in conditions], colour, state, state in (RUNNING, FAILURE)
        )


def _count(nodes: Sequence[_Node]) -> Branch:
    counts = [(state, sum(node.state == state for node in nodes)) for state in (SUCCESS, IDLE)]
    text = ", ".join(f"{count} {word_of(state)}" for state, count in counts if count)
    return _Node([f"{len(nodes)} more: {text}"], colour=_style(IDLE)[3])


def name_of(progress: Any) -> str:
    """The label of a node; "group" for a group, whose label is its processor's symbol."""
    return "group" if progress.type == ":Skill" else str(progress.label or progress.type)


def message_of(progress: Any) -> str:
    """The first line of the message, with the code of a failure."""
    message = first_line(progress.progress_message)
    return f"{message} ({progress.progress_code})".strip() if progress.progress_code < 0 else message


def word_of(state: int) -> str:
    """The word for a state."""
    return _style(state)[2]


def first_line(text: str) -> str:
    return text.strip().splitlines()[0] if text.strip() else ""


def _style(state: int) -> tuple[str, str, str, str]:
    return _STYLES.get(state, _UNKNOWN)


class Changes:
    """Formats the changes of a task as lines, with the time since the first one.

    The start of a node precedes the changes of its children; its end follows them.

    :param clock: returns the time (s).
    """

    def __init__(self, screen: Screen, clock: Callable[[], float] = time.monotonic) -> None:
        self._screen = screen
        self._clock = clock
        self._began_at = clock()
        self._last: dict[int, tuple[int, str, float]] = {}  # state, message and time by node id

    def lines(self, nodes: Sequence[Any]) -> Iterator[Line]:
        """The changes since the last call; `nodes` has parents before children."""
        depth: dict[int, int] = {}
        ancestors: list[Any] = []
        for node in nodes[1:]:
            depth[node.id] = depth.get(node.parent_id, -1) + 1
            while ancestors and ancestors[-1].id != node.parent_id:
                yield from self._change(ancestors.pop(), depth)
            if node.state == RUNNING:
                yield from self._change(node, depth)
            ancestors.append(node)
        for node in reversed(ancestors):
            yield from self._change(node, depth)

    def _change(self, node: Any, depth: dict[int, int]) -> Iterable[Line]:
        now = self._clock()
        message = message_of(node)
        state, last_message, since = self._last.get(node.id, (IDLE, "", now))
        if node.state == state and (message == last_message or state != RUNNING or now - since < _MESSAGE_PERIOD):
            return
        self._last[node.id] = (node.state, message, now)
        if node.state == IDLE:
            return
        symbol, ascii_symbol, _, colour = _style(node.state)
        sign = symbol if self._screen.fancy else ascii_symbol
        name = f"{'  ' * depth[node.id]}{sign} {name_of(node)} {node.processor}".rstrip()
        text = f"{now - self._began_at:6.1f} s  {f'{name}  {message}' if message else name}"
        yield Line(self._screen.fitted(text), colour)
