"""What a tree did: the state and progress code of every node after every tick."""

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

#: A node that was not there at a tick.
_NOT_THERE = "-"


@dataclass(frozen=True)
class Seen:
    """A node after a tick.

    :param place: which child of which child of the root it is; () is the root.
    :param name: "root"; of others their label; where there is none, what its processor prints, or its type.
    """

    place: tuple[int, ...]
    name: str
    state: State
    code: int


class Trace:
    """A table: a row for each node, a column for each tick.

        root        R  R  S1
          ->        R  R  S
            first   R1 S2 S2
            second  .  R1 S2

    Two blanks at least come after a name. A cell is the state (`R`unning, `S`uccess, `F`ailure, `.` idle) and the
    progress code where it is not 0; `-`: the node was not there. Traces are equal when their tables are.
    """

    def __init__(self, ticks: Sequence[Sequence[Seen]] = ()) -> None:
        self.ticks: list[list[Seen]] = [list(nodes) for nodes in ticks]

    def add(self, nodes: Iterable[Seen]) -> None:
        """Adds a tick."""
        self.ticks.append(list(nodes))

    def rows(self) -> list[tuple[int, str, State, int]]:
        """(tick, name, state, code) of every node after every tick; ticks count from 1."""
        return [
            (number, node.name, node.state, node.code) for number, nodes in enumerate(self.ticks, 1) for node in nodes
        ]

    @classmethod
    def parse(cls, table: str) -> Trace:
        """The trace that a table stands for. What is indented further is below.

        :raises WrongValue: a cell is none, or rows are of different length.
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
            above = rows[-1][0][: depth - 1] if depth else ()
            if depth:
                index = children.get(above, 0)
                children[above] = index + 1
                place: tuple[int, ...] = (*above, index)
            else:
                place = ()
            rows.append((place, name, cells))
        lengths = {len(cells) for _, _, cells in rows}
        if len(lengths) > 1:
            raise WrongValue(f"rows of {sorted(lengths)} ticks in one trace:\n{table}")
        ticks = [
            [_seen(place, name, cells[i]) for place, name, cells in rows if cells[i] != _NOT_THERE]
            for i in range(lengths.pop() if lengths else 0)
        ]
        return cls(ticks)

    def __str__(self) -> str:
        names = {node.place: "  " * len(node.place) + node.name for nodes in self.ticks for node in nodes}
        places = sorted(names)
        cells = [{node.place: _cell(node) for node in nodes} for nodes in self.ticks]
        columns = [
            [names[place] + " " for place in places],
            *([tick.get(place, _NOT_THERE) for place in places] for tick in cells),
        ]
        padded = [[f"{text:<{max(map(len, column))}}" for text in column] for column in columns if column]
        return "\n".join(" ".join(row).rstrip() for row in zip(*padded, strict=True))

    __repr__ = __str__

    def __eq__(self, other: Any) -> bool:
        return isinstance(other, Trace) and str(self) == str(other)

    __hash__ = None  # type: ignore[assignment]


def _cell(node: Seen) -> str:
    return _LETTERS[node.state] + (str(node.code) if node.code else "")


def _split(line: str) -> tuple[str, list[str]]:
    """The name and the cells of a row."""
    name, _, cells = line.strip().partition("  ")
    return name, cells.split()


def _seen(place: tuple[int, ...], name: str, cell: str) -> Seen:
    state, code = _STATES.get(cell[0]), cell[1:]
    if state is None or (code and not code.lstrip("-").isdigit()):
        raise WrongValue(f"{name}: {cell!r} is no state with a code, such as R1 or F-2")
    return Seen(place, name, state, int(code or 0))
