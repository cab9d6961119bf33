"""The ticks of a task: what each node was, kept in little room, so that one can go back to any of them.

A tick is kept as what it has changed; every so often, and when the tree has another shape, one is kept whole.
"""

from __future__ import annotations

import bisect
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from skiros2_gui.core.run_frame import ROW, Frame, Rows
from skiros2_gui.core.run_log import RunLog
from skiros2_gui.core.run_shape import Shape, keys_of
from skiros2_gui.core.states import IDLE, RUNNING

#: Every so many ticks are kept whole.
_WHOLE = 64

#: What a tick takes beside its rows and texts (bytes), about.
_TICK, _TEXT = 300, 80


@dataclass
class _Tick:
    """
    :param places: of the rows that it changed; None: it is whole.
    :param messages: of those that it changed ("" for those that say nothing any more), or all.
    """

    time: float
    shape: Shape
    places: npt.NDArray[np.int32] | None
    rows: Rows
    messages: dict[int, str]

    @property
    def size(self) -> int:
        """What it takes (bytes), about."""
        texts = sum(len(text) + _TEXT for text in self.messages.values())
        return _TICK + self.rows.nbytes + (self.places.nbytes if self.places is not None else 0) + texts


class TaskRun:
    """A task from when it was first seen. One thread at a time.

    :param robot: the manager's node name.
    :param task_id: the root's id. Numbers are used again, so several runs may have the same.
    :ivar log: what its nodes said.
    :ivar is_lost: its manager went while it was running.
    :ivar dropped: how many of the oldest ticks were given up for want of room.
    :ivar size: what the ticks take (bytes), about.
    """

    def __init__(self, robot: str, task_id: int) -> None:
        self.robot = robot
        self.task_id = task_id
        self.log = RunLog()
        self.is_lost = False
        self.dropped = 0
        self.size = 0
        self._start = 0.0
        self._ticks: list[_Tick] = []
        self._times: list[float] = []
        self._since_whole = 0
        self._now: Frame | None = None

    def __len__(self) -> int:
        """How many ticks there are to go to."""
        return len(self._ticks)

    @property
    def now(self) -> Frame:
        """The last tick."""
        assert self._now is not None, "a run is made with its first tick"
        return self._now

    @property
    def start(self) -> float:
        """When it was first seen (s since the epoch)."""
        return self._start

    @property
    def times(self) -> Sequence[float]:
        """Of the ticks there are to go to, oldest first (s since the epoch)."""
        return self._times

    def enter(self, nodes: Sequence[Any], time: float) -> bool:
        """Takes in what was told of the task.

        :param nodes: a `SkillProgress` for each node, the root first.
        :param time: when it was told (s since the epoch).
        :returns: whether the tree has another shape now.
        """
        before = self._now
        if before is None:
            self._start = time
        keys = keys_of(nodes)
        is_new = before is None or keys != before.shape.keys
        shape = Shape(keys) if is_new or before is None else before.shape
        rows = self._rows(nodes, time, shape, before)
        messages = {place: node.progress_message for place, node in enumerate(nodes) if node.progress_message}
        self._keep(Frame(time, shape, rows, messages, self._start), before, is_new)
        return is_new

    def frame(self, tick: int) -> Frame:
        """The tree at a tick: 0 the oldest that is kept.

        :raises IndexError: there is no such tick.
        """
        if not 0 <= tick < len(self._ticks):
            raise IndexError(f"tick {tick} of {len(self._ticks)}")
        if tick == len(self._ticks) - 1:
            return self.now
        first = tick
        while self._ticks[first].places is not None:
            first -= 1
        whole = self._ticks[first]
        rows, messages = whole.rows.copy(), dict(whole.messages)
        for changes in self._ticks[first + 1 : tick + 1]:
            rows[changes.places] = changes.rows
            messages.update(changes.messages)
        said = {place: text for place, text in messages.items() if text}
        return Frame(self._ticks[tick].time, whole.shape, rows, said, self._start)

    def tick_at(self, time: float) -> int:
        """The last tick that was told at a time, the first one for an earlier time."""
        return max(0, bisect.bisect_right(self._times, time) - 1)

    def drop_oldest(self) -> bool:
        """Gives up the oldest ticks, up to the next one that is kept whole.

        :returns: whether there were any beside those that are needed for the last one.
        """
        for number in range(1, len(self._ticks)):
            if self._ticks[number].places is None:
                self.size -= sum(tick.size for tick in self._ticks[:number])
                del self._ticks[:number], self._times[:number]
                self.dropped += number
                return True
        return False

    def _rows(self, nodes: Sequence[Any], time: float, shape: Shape, before: Frame | None) -> Rows:
        rows = np.empty(len(nodes), ROW)
        rows["state"] = [node.state for node in nodes]
        rows["code"] = [node.progress_code for node in nodes]
        began, ended = self._known_times(shape, before)
        told = np.fromiter((node.progress_time for node in nodes), "f4", len(nodes))
        told = np.where(np.isfinite(told) & (told > 0.0), told, 0.0)
        now = time - self._start
        runs, idle = rows["state"] == RUNNING, rows["state"] == IDLE
        starts = runs & (np.isnan(began) | ~np.isnan(ended))
        # Of one that ran already when it was first told of, the manager knows for how long.
        began = np.where(starts, now - (told if before is None else 0.0), began)
        ended = np.where(starts, np.nan, ended)
        ends = ~runs & ~idle & np.isnan(ended)
        began = np.where(ends & np.isnan(began), now - told, began)
        ended = np.where(ends | (idle & ~np.isnan(began) & np.isnan(ended)), now, ended)
        rows["began"], rows["ended"] = began, ended
        return rows

    def _known_times(self, shape: Shape, before: Frame | None) -> tuple[Any, Any]:
        """When the nodes began and ended, as far as it is known from the tick before."""
        if before is not None and shape is before.shape:
            known = before.rows
        else:
            known = _unknown(len(shape))
            if before is not None:
                pairs = [
                    (place, before.shape.places[key[0]])
                    for place, key in enumerate(shape.keys)
                    if key[0] in before.shape.places
                ]
                if pairs:
                    new, old = np.array(pairs, "i4").T
                    known[new] = before.rows[old]
        return known["began"], known["ended"]

    def _keep(self, frame: Frame, before: Frame | None, is_new: bool) -> None:
        """Keeps a tick. One in which nothing has changed is told at times only: it makes the last one longer."""
        self._now = frame
        self.log.enter(frame)
        if before is None or is_new or self._since_whole >= _WHOLE:
            tick = _Tick(frame.time, frame.shape, None, frame.rows, frame.messages)
            self._since_whole = 0
        else:
            places = np.flatnonzero(_differ(frame.rows, before.rows)).astype("i4")
            messages = _changed(before.messages, frame.messages)
            if not len(places) and not messages:
                return
            tick = _Tick(frame.time, frame.shape, places, frame.rows[places], messages)
            self._since_whole += 1
        self._ticks.append(tick)
        self._times.append(frame.time)
        self.size += tick.size


def _unknown(count: int) -> Rows:
    rows = np.zeros(count, ROW)
    rows["began"] = rows["ended"] = np.nan
    return rows


def _differ(rows: Rows, others: Rows) -> npt.NDArray[np.bool_]:
    """Which rows are others; compared as bytes, as NaN is not equal to itself."""
    size = ROW.itemsize
    wide = np.ascontiguousarray(rows).view("u1").reshape(-1, size)
    return np.asarray((wide != np.ascontiguousarray(others).view("u1").reshape(-1, size)).any(axis=1))


def _changed(before: dict[int, str], now: dict[int, str]) -> dict[int, str]:
    """The messages that are others than before, "" for those that are no more."""
    changed = {place: text for place, text in now.items() if before.get(place) != text}
    changed.update((place, "") for place in before.keys() - now.keys())
    return changed
