"""Traces: the state and progress code of every node after every tick."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from skiros2_common.core.abstract_skill import State
from skiros2_common.core.errors import WrongValue

_LETTERS = {
    State.Success: "S",
    State.Failure: "F",
    State.Running: "R",
    State.Idle: ".",
    State.Uninitialized: ".",
}
_STATES = {"S": State.Success, "F": State.Failure, "R": State.Running, ".": State.Idle}

#: A node that did not exist at a tick.
_ABSENT = "-"


@dataclass(frozen=True)
class TracedNode:
    """A node after a tick.

    :param child_indices: the path from the root; () for the root.
    :param name: "root", or the label; without a label, the processor symbol or the type.
    """

    child_indices: tuple[int, ...]
    name: str
    state: State
    code: int


class Trace:
    """A table: a row for each node, a column for each tick.

        root        R  R  S1
          ->        R  R  S
            first   R1 S2 S2
            second  .  R1 S2

    At least two spaces follow a name. A cell is the state (`R`unning, `S`uccess, `F`ailure, `.` idle) and the
    progress code if it is not 0; `-`: the node did not exist. Traces are equal if their tables are.
    """

    def __init__(self, ticks: Sequence[Sequence[TracedNode]] = ()) -> None:
        self.ticks: list[list[TracedNode]] = [list(nodes) for nodes in ticks]

    def add(self, nodes: Iterable[TracedNode]) -> None:
        """Adds a tick."""
        self.ticks.append(list(nodes))

    def rows(self) -> list[tuple[int, str, State, int]]:
        """(tick, name, state, code) of every node after every tick; ticks count from 1."""
        return [
            (number, node.name, node.state, node.code) for number, nodes in enumerate(self.ticks, 1) for node in nodes
        ]

    @classmethod
    def parse(cls, table: str) -> Trace:
        """Parses a table. Indentation defines the parents.

        :raises WrongValue: a cell is invalid, or rows have different lengths.
        """
        rows: list[tuple[tuple[int, ...], str, list[str]]] = []
        indents: list[int] = []
        children: dict[tuple[int, ...], int] = {}
        for line in filter(str.strip, table.splitlines()):
            name, cells = _split(line)
            indent = len(line) - len(line.lstrip())
            while indents and indents[-1] >= indent:
                indents.pop()
            depth = len(indents)
            indents.append(indent)
            parent = rows[-1][0][: depth - 1] if depth else ()
            if depth:
                index = children.get(parent, 0)
                children[parent] = index + 1
                indices: tuple[int, ...] = (*parent, index)
            else:
                indices = ()
            rows.append((indices, name, cells))
        lengths = {len(cells) for _, _, cells in rows}
        if len(lengths) > 1:
            raise WrongValue(f"rows of {sorted(lengths)} ticks in one trace:\n{table}")
        ticks = [
            [_traced(indices, name, cells[i]) for indices, name, cells in rows if cells[i] != _ABSENT]
            for i in range(lengths.pop() if lengths else 0)
        ]
        return cls(ticks)

    def __str__(self) -> str:
        nodes = [node for tick in self.ticks for node in tick]
        names = {node.child_indices: "  " * len(node.child_indices) + node.name for node in nodes}
        paths = sorted(names)
        cells = [{node.child_indices: _cell(node) for node in tick} for tick in self.ticks]
        columns = [
            [names[path] + " " for path in paths],
            *([tick.get(path, _ABSENT) for path in paths] for tick in cells),
        ]
        padded = [[f"{text:<{max(map(len, column))}}" for text in column] for column in columns if column]
        return "\n".join(" ".join(row).rstrip() for row in zip(*padded, strict=True))

    __repr__ = __str__

    def __eq__(self, other: Any) -> bool:
        return isinstance(other, Trace) and str(self) == str(other)

    __hash__ = None  # type: ignore[assignment]


def _cell(node: TracedNode) -> str:
    return _LETTERS[node.state] + (str(node.code) if node.code else "")


def _split(line: str) -> tuple[str, list[str]]:
    """The name and the cells of a row."""
    name, _, cells = line.strip().partition("  ")
    return name, cells.split()


def _traced(child_indices: tuple[int, ...], name: str, cell: str) -> TracedNode:
    state, code = _STATES.get(cell[0]), cell[1:]
    if state is None or (code and not code.lstrip("-").isdigit()):
        raise WrongValue(f"{name}: {cell!r} is not a state with a code, such as R1 or F-2")
    return TracedNode(child_indices, name, state, int(code or 0))
