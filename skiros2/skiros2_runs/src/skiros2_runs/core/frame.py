"""The state of a task's tree at a tick."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from skiros2_runs.core.shape import Shape
from skiros2_runs.core.states import FAILURE, RUNNING, TaskState

#: A node: state, progress code and run time as in `SkillProgress`; start and end (s after the task's first tick; NaN if
#: unset).
ROW = np.dtype([("state", "i2"), ("code", "i2"), ("began", "f4"), ("ended", "f4"), ("run_time", "f4")])
Rows = npt.NDArray[np.void]


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
