"""A task's tree at a moment: what each of its nodes is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from skiros2_gui.core.run_shape import Shape
from skiros2_gui.core.states import FAILURE, RUNNING

#: What is kept of a node: state and code on the wire, when it began and ended (s after the task's first tick; NaN: it
#: has not).
ROW = np.dtype([("state", "i2"), ("code", "i2"), ("began", "f4"), ("ended", "f4")])
Rows = npt.NDArray[np.void]


@dataclass(frozen=True)
class Frame:
    """A tree at a tick.

    :param time: s since the epoch.
    :param rows: by place, of the type `ROW`.
    :param messages: by place, of those nodes that said something.
    :param start: when the task's first tick was told (s since the epoch).
    """

    time: float
    shape: Shape
    rows: Rows
    messages: dict[int, str]
    start: float

    def state(self, place: int) -> int:
        return int(self.rows["state"][place])

    def code(self, place: int) -> int:
        return int(self.rows["code"][place])

    def message(self, place: int) -> str:
        return self.messages.get(place, "")

    def began(self, place: int) -> float | None:
        """When the node began to run (s since the epoch); None when it has not."""
        began = float(self.rows["began"][place])
        return None if np.isnan(began) else self.start + began

    def duration(self, place: int) -> float | None:
        """For how long it ran, or has been running (s); None when it has not."""
        began, ended = float(self.rows["began"][place]), float(self.rows["ended"][place])
        if np.isnan(began):
            return None
        return max(0.0, (self.time - self.start if np.isnan(ended) else ended) - began)

    def durations(self) -> list[float]:
        """For how long each node ran, or has been running (s); NaN for those that have not."""
        began, ended = self.rows["began"], self.rows["ended"]
        lasted: list[float] = np.maximum(np.where(np.isnan(ended), self.time - self.start, ended) - began, 0.0).tolist()
        return lasted

    def running(self) -> list[int]:
        """The places of the nodes that run and under which none does, the last to begin at the end: what the robot is
        at."""
        places = np.flatnonzero(self.rows["state"] == RUNNING).tolist()
        parents, above = self.shape.parents, {-1}
        for place in places:
            while (place := parents[place]) not in above:
                above.add(place)
        lowest = [place for place in places if place not in above]
        began = self.rows["began"][lowest]
        return [lowest[number] for number in np.argsort(began, kind="stable").tolist()]

    def failed(self) -> list[int]:
        """The places of the nodes that have failed and under which none has, the one that failed last at the end."""
        places = np.flatnonzero(self.rows["state"] == FAILURE).tolist()
        above = {self.shape.parents[place] for place in places}
        lowest = [place for place in places if place not in above]
        return sorted(lowest, key=lambda place: float(np.nan_to_num(self.rows["ended"][place])))

    @property
    def has_ended(self) -> bool:
        """Whether the root has told the task's end."""
        return abs(self.code(0)) == 1
