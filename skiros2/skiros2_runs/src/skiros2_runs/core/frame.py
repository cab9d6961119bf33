"""A task's tree: its shape, and its state at a tick."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from skiros2_common.core.names import local_name
from skiros2_runs.core.progress import GOAL_TYPE, GROUP_TYPE, NodeMessage
from skiros2_runs.core.states import FAILURE, RUNNING, TaskState

#: The id, parent id, type, label and processor of a node.
Key = tuple[int, int, str, str, str]

#: The names of control-flow nodes, by processor symbol.
_GROUPS = {
    "->": "sequence",
    "->*": "sequence",
    "?": "fallback",
    "?*": "fallback",
    "|ff|": "parallel",
    "|fs|": "parallel",
}

#: A node: state, progress code and run time as in `SkillProgress`; start and end (s after the task's first tick; NaN if
#: unset).
ROW = np.dtype([("state", "i2"), ("code", "i2"), ("began", "f4"), ("ended", "f4"), ("run_time", "f4")])
Rows = npt.NDArray[np.void]


def _is_skill(kind: str) -> bool:
    """Skills have a class of the ontology as type, control-flow nodes a type without prefix."""
    return kind.find(":") > 0


def key_of(node: NodeMessage) -> Key:
    """Returns the parts of a `SkillProgress` that define the shape."""
    label = node.label if node.type != GROUP_TYPE else ""  # the label of a control-flow node is its processor symbol
    return (node.id, node.parent_id, node.type, label, node.processor)


class Shape:
    """Nodes by their index in the message; 0 is the root. Immutable; any thread.

    A node whose parent does not precede it becomes a child of the root, so that any message gives a tree.

    :ivar keys: of each node.
    :ivar parents: the index of each node's parent; -1 for the root.
    :ivar children: the indices of each node's children, in order.
    :ivar depths: 0 for the root.
    :ivar index_by_id: the index of each id; the last one of a duplicate id.
    """

    def __init__(self, keys: list[Key]) -> None:
        self.keys = keys
        self.index_by_id: dict[int, int] = {}
        self.parents: list[int] = []
        self.depths: list[int] = []
        self.children: list[list[int]] = [[] for _ in keys]
        for index, key in enumerate(keys):
            above = self.index_by_id.get(key[1], 0) if index else -1
            self.parents.append(above)
            self.depths.append(self.depths[above] + 1 if index else 0)
            if index:
                self.children[above].append(index)
            self.index_by_id[key[0]] = index

    @classmethod
    def of(cls, nodes: Sequence[NodeMessage]) -> Shape:
        """Returns the shape of a message."""
        return cls([key_of(node) for node in nodes])

    @functools.cached_property
    def index_paths(self) -> list[tuple[int, ...]]:
        """The child indices from the root to each node; () for the root."""
        paths: list[tuple[int, ...]] = [()] * len(self.keys)
        for parent, children in enumerate(self.children):
            for number, child in enumerate(children):
                paths[child] = (*paths[parent], number)
        return paths

    def __len__(self) -> int:
        return len(self.keys)

    def id(self, index: int) -> int:
        return self.keys[index][0]

    def type(self, index: int) -> str:
        return self.keys[index][2]

    def label(self, index: int) -> str:
        return self.keys[index][3]

    def processor(self, index: int) -> str:
        """Returns the symbol of its processor, such as `->*`; "" for none."""
        return self.keys[index][4]

    def is_skill(self, index: int) -> bool:
        """Returns whether it is a skill, not a control-flow node."""
        return index > 0 and _is_skill(self.type(index))

    def name(self, index: int) -> str:
        """Returns the label, or else the type without prefix, or the kind of control-flow node."""
        _, _, kind, label, processor = self.keys[index]
        if not index:
            return label if kind == GOAL_TYPE else f"task {self.keys[index][0]}"
        if label:
            return label
        if _is_skill(kind):
            return local_name(kind) or f"node {self.keys[index][0]}"
        return f"{_GROUPS.get(processor, '')} {processor}".strip() or kind or f"node {self.keys[index][0]}"

    def path(self, index: int) -> list[int]:
        """Returns the indices from the root to a node, both included."""
        path = [index]
        while (index := self.parents[index]) >= 0:
            path.append(index)
        return path[::-1]

    def path_names(self, index: int) -> list[str]:
        """Returns the names from below the root to a node."""
        return [self.name(above) for above in self.path(index)[1:]]

    def skills_text(self, most: int = 0) -> str:
        """Returns the names of the nodes below the root; of a goal its own.

        :param most: how many are named; 0: all.
        """
        if self.keys and self.type(0) == GOAL_TYPE:
            return self.label(0)
        names = [self.name(index) for index in self.children[0]] if self.keys else []
        more = f" and {len(names) - most} more" if 0 < most < len(names) else ""
        return ", ".join(names[: most or None]) + more


@dataclass(frozen=True)
class NodeProgress:
    """A node at a tick.

    :param path: the names from below the root to the node.
    :param code: the progress code.
    :param run_time: time from its start to its last progress (s), as the manager measured it.
    """

    path: tuple[str, ...]
    type: str
    label: str
    processor: str
    state: int
    code: int
    message: str
    run_time: float

    @property
    def name(self) -> str:
        return self.path[-1] if self.path else "root"


@dataclass(frozen=True)
class Frame:
    """A tree at a tick.

    :param time: s since the epoch.
    :param rows: by node index, of the type `ROW`.
    :param messages: by node index; nodes without a message are missing.
    :param start: the time of the task's first tick (s since the epoch).
    :param task_state: as reported; never `LOST`.
    """

    time: float
    shape: Shape
    rows: Rows
    messages: dict[int, str]
    start: float
    task_state: TaskState = TaskState.RUNNING

    def state(self, index: int) -> int:
        return int(self.rows["state"][index])

    def code(self, index: int) -> int:
        return int(self.rows["code"][index])

    def message(self, index: int) -> str:
        return self.messages.get(index, "")

    def report(self, index: int) -> tuple[int, int, str]:
        """Returns state, progress code and message."""
        return self.state(index), self.code(index), self.message(index)

    @functools.cached_property
    def nodes(self) -> dict[tuple[int, ...], NodeProgress]:
        """The nodes by their child indices from the root, each before its children."""
        shape = self.shape
        found = {
            path: NodeProgress(
                tuple(shape.path_names(index)),
                shape.type(index),
                shape.label(index),
                shape.processor(index),
                *self.report(index),
                float(self.rows["run_time"][index]),
            )
            for index, path in enumerate(shape.index_paths)
        }
        return {path: found[path] for path in sorted(found)}

    def began(self, index: int) -> float | None:
        """Returns when the node started (s since the epoch); None if it has not."""
        began = float(self.rows["began"][index])
        return None if np.isnan(began) else self.start + began

    def duration(self, index: int) -> float | None:
        """Returns how long the node ran, or has been running (s); None if it has not started."""
        began, ended = float(self.rows["began"][index]), float(self.rows["ended"][index])
        if np.isnan(began):
            return None
        return max(0.0, (self.time - self.start if np.isnan(ended) else ended) - began)

    def durations(self) -> list[float]:
        """Returns the duration of each node (s); NaN for nodes that have not started."""
        began, ended = self.rows["began"], self.rows["ended"]
        ended = np.where(np.isnan(ended), self.time - self.start, ended)
        durations: list[float] = np.maximum(ended - began, 0.0).tolist()
        return durations

    def running(self) -> list[int]:
        """Returns the indices of running nodes without running children, ordered by start."""
        indices = np.flatnonzero(self.rows["state"] == RUNNING).tolist()
        parents, inner = self.shape.parents, {-1}
        for index in indices:
            while (index := parents[index]) not in inner:
                inner.add(index)
        lowest = [index for index in indices if index not in inner]
        began = self.rows["began"][lowest]
        return [lowest[number] for number in np.argsort(began, kind="stable").tolist()]

    def failed(self) -> list[int]:
        """Returns the indices of failed nodes without failed children, ordered by end."""
        indices = np.flatnonzero(self.rows["state"] == FAILURE).tolist()
        inner = {self.shape.parents[index] for index in indices}
        lowest = [index for index in indices if index not in inner]
        return sorted(lowest, key=lambda index: float(np.nan_to_num(self.rows["ended"][index])))

    @property
    def has_ended(self) -> bool:
        """Whether the task has ended."""
        return self.task_state.has_ended
