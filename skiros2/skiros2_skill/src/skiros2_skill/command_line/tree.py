"""A task as text: a tree, or one line per change."""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import TextIO

from skiros2_common.command_line.layout import Branch, Screen, drawn, styled, table
from skiros2_runs.core.frame import Frame, NodeProgress
from skiros2_runs.core.progress import NodeMessage
from skiros2_runs.core.states import ENDS, FAILURE, IDLE, RUNNING, StateStyle, TaskState, style_of
from skiros2_runs.core.task_run import TaskRun

#: The ANSI colour of each colour role.
_COLOURS = {"success": "32", "failure": "31", "running": "36", "paused": "33", "idle": "90", "changed": "35"}


@dataclass(frozen=True)
class Line:
    """A line of text and its colour."""

    text: str
    colour: str

    def shown(self, out: TextIO) -> str:
        """The text, in its colour where a stream shows colours."""
        return styled(self.text, self.colour, out)


def frame_of(nodes: Sequence[NodeMessage]) -> Frame:
    """Returns the tree in one message.

    :param nodes: parents before children.
    """
    run = TaskRun(nodes[0].robot, nodes[0].task_id)
    run.record(nodes, 0.0)
    return run.latest


def summary(frame: Frame, robot: str) -> str:
    """A task in one line."""
    word, message = style_of(frame.task_state).word, first_line(frame.message(0))
    if not message or (frame.state(0) not in (FAILURE, RUNNING) and frame.task_state is not TaskState.PAUSED):
        text = word
    elif message.lower().startswith(word):  # "paused at breakpoint 1", "Preempted"
        text = word + message[len(word) :]
    else:
        text = f"{word}: {message}"
    return f"task {frame.shape.id(0)} on {robot}: {text}"


def picture(screen: Screen, frame: Frame, robot: str, max_lines: int | None = None) -> list[Line]:
    """The tree of a task.

    :param max_lines: maximum number of lines; nodes that neither run nor have failed are omitted first.
    """
    forest = _Forest(screen, frame)
    room = forest.size() if max_lines is None else max_lines - 1
    if forest.size() > room:
        forest.fold()
    excess = forest.size() - room
    rows = forest.rows(room if excess <= 0 else max(0, room - 1))
    texts = table(screen, [cells for _, cells in rows])
    lines = [Line(text, colour) for (colour, _), text in zip(rows, texts, strict=True)]
    more = [Line(f"{excess + 1} more lines", _colour(style_of(IDLE)))] if excess > 0 else []
    return [Line(screen.fitted(summary(frame, robot)), _colour(style_of(frame.task_state))), *lines, *more]


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

    def __init__(self, screen: Screen, frame: Frame) -> None:
        self._screen = screen
        self._roots: list[Branch] = []
        known: dict[tuple[int, ...], _Node] = {}
        for path, progress in frame.nodes.items():
            if path:
                known[path] = node = self._node(progress)
                parent = known.get(path[:-1])
                (parent.branches if parent is not None else self._roots).append(node)
        self._all = list(known.values())
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
        return [(getattr(branch, "colour", ""), [text, *branch.cells[1:]]) for branch, text in branches]

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

    def _node(self, node: NodeProgress) -> _Node:
        style = style_of(node.state)
        timed = "" if node.state == IDLE else f"{node.run_time:.1f} s"
        cells = [_title(self._screen, style, node.name, node.processor), style.word, timed, _message(node)]
        return _Node(cells, [], _colour(style), node.state, node.state in (RUNNING, FAILURE))


def _count(nodes: Sequence[_Node]) -> Branch:
    words = [style_of(node.state).word for node in nodes]
    text = ", ".join(f"{words.count(word)} {word}" for word in sorted(set(words), reverse=True))
    return _Node([f"{len(nodes)} more: {text}"], colour=_colour(style_of(IDLE)))


def _title(screen: Screen, style: StateStyle, name: str, processor: str) -> str:
    """The symbol, name and processor of a node; the names of groups contain the processor."""
    more = "" if name.endswith(processor) else f" {processor}"
    return f"{style.symbol if screen.fancy else style.ascii} {name}{more}"


def _message(node: NodeProgress) -> str:
    """The first line of the message, with the code of a failure."""
    message = first_line(node.message)
    return f"{message} ({node.code})".strip() if node.code < 0 else message


def _colour(style: StateStyle) -> str:
    return _COLOURS[style.colour_role]


def first_line(text: str) -> str:
    return text.strip().splitlines()[0] if text.strip() else ""


#: The indent of the continuation of a line, which starts with a time.
_INDENT = " " * 10


class Changes:
    """Formats the changes of a task as lines, with the time since the first one.

    The start of a node precedes the changes of its children; its end follows them. Messages of a running node are at
    least a second apart.

    :param clock: returns the time (s).
    """

    def __init__(self, screen: Screen, clock: Callable[[], float] = time.time) -> None:
        self._screen = screen
        self._clock = clock
        self._run: TaskRun | None = None
        self._count = 0  # of the lines seen

    def lines(self, nodes: Sequence[NodeMessage]) -> Iterator[Line]:
        """The changes since the last call; `nodes` has parents before children."""
        if self._run is None:
            self._run = TaskRun(nodes[0].robot, nodes[0].task_id)
        run = self._run
        run.record(nodes, self._clock())
        run.drop_oldest()
        new = run.log.count - self._count
        self._count = run.log.count
        tree = run.latest.nodes
        for line in itertools.islice(run.log.lines, max(0, len(run.log) - new), None):
            if not line.path and line.state == RUNNING and line.message:  # paused, and why
                text = f"{line.time - run.start:6.1f} s  {first_line(line.message)}"
                yield from (Line(part, _COLOURS["paused"]) for part in self._screen.wrapped(text, _INDENT))
            elif line.path and line.state in (*ENDS, RUNNING):
                style, node = style_of(line.state), tree[line.path]
                name = "  " * (len(line.path) - 1) + _title(self._screen, style, line.name, node.processor)
                message = _message(node)
                text = f"{line.time - run.start:6.1f} s  {f'{name}  {message}' if message else name}"
                yield from (Line(part, _colour(style)) for part in self._screen.wrapped(text, _INDENT))
