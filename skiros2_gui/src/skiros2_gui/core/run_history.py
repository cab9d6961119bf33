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
from skiros2_gui.core.run_shape import Shape, key_of
from skiros2_gui.core.states import IDLE, RUNNING

#: Every so many ticks are kept whole.
_WHOLE = 64

#: Who has run for longer (s, a year) does not know for how long.
_LONGEST = 3.2e7

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
        self._nodes: Sequence[Any] = ()

    def __len__(self) -> int:
        """How many ticks there are to go to."""
        return len(self._ticks)

    @property
    def now(self) -> Frame:
        """The last tick."""
        assert self._now is not None, "a run is made with its first tick"
        return self._now

    @property
    def is_over(self) -> bool:
        """Whether it has ended, as far as is known."""
        return self.is_lost or self.now.has_ended

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

        :param nodes: a `SkillProgress` for each node, the root first. One that is the same object as the last time is
            taken for unchanged.
        :param time: when it was told (s since the epoch).
        :returns: whether the tree has another shape now.
        """
        before, last = self._now, self._nodes
        self._nodes = nodes
        if before is None:
            self._start = time
        touched = list(range(len(nodes)))
        if before is not None and len(nodes) == len(last):
            touched = [place for place in touched if nodes[place] is not last[place]]
            if all(key_of(nodes[place]) == before.shape.keys[place] for place in touched):
                self._go_on(nodes, time, before, touched)
                return False
        shape = Shape([key_of(node) for node in nodes])
        rows = _moved(shape, before)
        self._update(rows, nodes, touched, time, before is None)
        said = {place: node.progress_message for place, node in enumerate(nodes) if node.progress_message}
        frame = Frame(time, shape, rows, said, self._start)
        self.log.enter(frame, touched)
        self._keep(frame, None, said)
        return True

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

    def _go_on(self, nodes: Sequence[Any], time: float, before: Frame, touched: list[int]) -> None:
        """Takes in a message that tells of the same nodes as the one before."""
        rows, said = before.rows, before.messages
        texts = {p: nodes[p].progress_message for p in touched if nodes[p].progress_message != said.get(p, "")}
        if touched:
            rows = rows.copy()
            self._update(rows, nodes, touched, time, False)
        if texts:
            said = {place: text for place, text in {**said, **texts}.items() if text}
        frame = Frame(time, before.shape, rows, said, self._start)
        among = np.array(touched, "i4")
        places = among[_differ(rows[among], before.rows[among])]
        others = places[rows["state"][places] != before.rows["state"][places]]
        self.log.enter(frame, sorted({*others.tolist(), *texts}))
        self._keep(frame, places, texts)

    def _update(self, rows: Rows, nodes: Sequence[Any], touched: list[int], time: float, is_first: bool) -> None:
        """Enters what was told of some nodes."""
        count, now = len(touched), time - self._start
        at: Any = touched if count < len(rows) else slice(None)
        state = np.fromiter((nodes[place].state for place in touched), "i2", count)
        told = np.fromiter((nodes[place].progress_time for place in touched), "f4", count)
        told = np.where((told > 0.0) & (told < _LONGEST), told, 0.0)  # of NaN both are false
        began, ended = rows["began"][at], rows["ended"][at]
        runs, idle = state == RUNNING, state == IDLE
        starts = runs & (np.isnan(began) | ~np.isnan(ended))
        # Of one that ran already when it was first told of, the manager knows for how long.
        began = np.where(starts, now - (told if is_first else 0.0), began)
        ended = np.where(starts, np.nan, ended)
        ends = ~runs & ~idle & np.isnan(ended)
        began = np.where(ends & np.isnan(began), now - told, began)
        ended = np.where(ends | (idle & ~np.isnan(began) & np.isnan(ended)), now, ended)
        rows["state"][at], rows["began"][at], rows["ended"][at] = state, began, ended
        rows["code"][at] = np.fromiter((nodes[place].progress_code for place in touched), "i2", count)

    def _keep(self, frame: Frame, places: npt.NDArray[np.int32] | None, texts: dict[int, str]) -> None:
        """Keeps a tick. One in which nothing has changed is told at times only: it makes the last one longer.

        :param places: of the rows that have changed; None: the tree has another shape.
        :param texts: the messages that have.
        """
        self._now = frame
        if places is not None and not len(places) and not texts:
            return
        if places is None or self._since_whole >= _WHOLE:
            tick = _Tick(frame.time, frame.shape, None, frame.rows, frame.messages)
            self._since_whole = 0
        else:
            tick = _Tick(frame.time, frame.shape, places, frame.rows[places], texts)
            self._since_whole += 1
        self._ticks.append(tick)
        self._times.append(frame.time)
        self.size += tick.size


def _moved(shape: Shape, before: Frame | None) -> Rows:
    """What is known of the nodes of another shape from the tick before: when they began and ended."""
    known = _unknown(len(shape))
    if before is not None:
        old = before.shape.places
        pairs = [(place, old[key[0]]) for place, key in enumerate(shape.keys) if key[0] in old]
        if pairs:
            new, places = np.array(pairs, "i4").T
            known[new] = before.rows[places]
    return known


def _unknown(count: int) -> Rows:
    rows = np.zeros(count, ROW)
    rows["began"] = rows["ended"] = np.nan
    return rows


def _differ(rows: Rows, others: Rows) -> npt.NDArray[np.bool_]:
    """Which rows are others; compared as bytes, as NaN is not equal to itself."""
    size = ROW.itemsize
    wide = np.ascontiguousarray(rows).view("u1").reshape(-1, size)
    return np.asarray((wide != np.ascontiguousarray(others).view("u1").reshape(-1, size)).any(axis=1))
