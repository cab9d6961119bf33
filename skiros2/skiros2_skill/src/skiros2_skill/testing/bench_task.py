"""A task that is ticked by a test, and its trace: the state and progress code of every node after every tick."""

from __future__ import annotations

import threading
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from skiros2_common.core.abstract_skill import State
from skiros2_common.core.errors import UnknownName, WrongValue
from skiros2_common.core.signals import SignalSource
from skiros2_common.core.world_model_port import WorldModelPort
from skiros2_skill.core.runtime.task import Task
from skiros2_skill.core.tree.skill_node import SkillWrapper
from skiros2_skill.testing.fake_clock import FakeClock

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


#: Real time for the threads of skills between two ticks with a fake clock (s).
_THREAD_TIME = 0.001


class BenchTask(Task):
    """A task that is ticked by `tick` or `run` and records a trace.

    :param clock: advances by one period per tick.
    :param period: of the ticks (s).
    :param signals: for hold-conditions on signals; None: no signal is published.
    :param goal: of which the task is a step; "": none.
    """

    def __init__(
        self,
        wmi: WorldModelPort,
        clock: FakeClock | None = None,
        period: float = 0.04,
        signals: SignalSource | None = None,
        goal: str = "",
    ) -> None:
        super().__init__(0, wmi, "test", signals=signals, goal=goal)
        self._clock = clock
        self._period = period
        self._threads_before = set(threading.enumerate())
        self._woken = threading.Event()
        self.waker = self._woken.set
        self.trace = Trace()

    def tick(self, times: int = 1) -> State:
        """Ticks the task, unless it has ended. Returns its state."""
        state = self.state
        for _ in range(times):
            if self.ended.is_set():
                break
            self._woken.clear()
            state = super().tick()
            self.trace.add(_nodes(self.root))
            if self._clock is not None:
                self._clock.advance(self._period)
        return state

    def run(self, ticks: int = 1000) -> BenchTask:
        """Ticks until the task ends, at most `ticks` times. Threads of skills run between ticks."""
        while ticks and self.tick() is State.Running:
            ticks -= 1
            if ticks and not self._threads_before.issuperset(threading.enumerate()):
                self._woken.wait(self._period if self._clock is None else _THREAD_TIME)
        return self

    # -- inspection --------------------------------------------------------------------------------------------

    @property
    def skill(self) -> Any:
        """The first child of the root."""
        return self.root.children[0]

    def node(self, name: str) -> Any:
        """The node with a label, type or processor symbol.

        :raises UnknownName: there is none.
        :raises WrongValue: there are several.
        """
        found = [n for n in self.nodes() if name in (n.label, n.type, n.type.rpartition(":")[2], _name(n))]
        if len(found) == 1:
            return found[0]
        if found:
            raise WrongValue(f"{len(found)} nodes are called {name!r}:\n{self.trace}")
        raise UnknownName(f"no node is called {name!r}; there are: {', '.join(map(_name, self.nodes()))}")

    @property
    def blackboard(self) -> dict[str, Any]:
        """The values on the blackboard, by key; None for unset parameters."""
        return {key: param.value for key, param in self.root.params.items()}

    @property
    def why(self) -> str:
        """Why nodes failed, for people; use it as the message of an assertion."""
        return "\n".join([self.root.progress_msg, *map(str, self.explanations()), str(self.trace)])


def _nodes(root: Any) -> Iterator[TracedNode]:
    """The nodes of a tree, parents before children. Not recursive, because trees may be deeper than Python's stack."""
    pending: list[tuple[Any, tuple[int, ...]]] = [(root, ())]
    while pending:
        node, indices = pending.pop()
        yield TracedNode(indices, _name(node), node.state, node.progress_code)
        pending += [(child, (*indices, index)) for index, child in enumerate(node.children)][::-1]


def _name(node: Any) -> str:
    if node.parent is None:
        return "root"  # its label has the task's id
    if node.label:
        return str(node.label)
    return str(node.type.rpartition(":")[2] if isinstance(node, SkillWrapper) else node.processor.printType())
