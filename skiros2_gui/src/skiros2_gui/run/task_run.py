"""The recorded ticks of a task.

A tick is stored as the rows that have changed. Every `_KEYFRAME_INTERVAL` ticks, and when the tree changes shape, a
keyframe stores all rows.
"""

from __future__ import annotations

import bisect
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from skiros2_gui.app.state_style import IDLE, RUNNING
from skiros2_gui.run.frame import ROW, Frame, Rows
from skiros2_gui.run.message_log import MessageLog
from skiros2_gui.run.shape import Shape, key_of

#: The number of ticks between keyframes.
_KEYFRAME_INTERVAL = 64

#: Longer run times are invalid (s; a year).
_LONGEST = 3.2e7

#: The overhead of a tick and of a text (bytes).
_TICK, _TEXT = 300, 80


@dataclass
class _Tick:
    """:param indices: of the changed rows; None for a keyframe.
    :param messages: the changed ones ("" if removed), or all for a keyframe.
    """

    time: float
    shape: Shape
    indices: npt.NDArray[np.int32] | None
    rows: Rows
    messages: dict[int, str]

    @property
    def size(self) -> int:
        """The approximate memory (bytes)."""
        texts = sum(len(text) + _TEXT for text in self.messages.values())
        return _TICK + self.rows.nbytes + (self.indices.nbytes if self.indices is not None else 0) + texts


class TaskRun:
    """A task since its first message. One thread at a time.

    :param robot: the manager's node name.
    :param task_id: the root's id. Ids are reused, so several runs may have the same.
    :ivar log: the messages of its nodes.
    :ivar is_lost: whether its manager has disconnected while it was running.
    :ivar dropped: the number of oldest ticks discarded for lack of memory.
    :ivar size: the approximate memory of the ticks (bytes).
    """

    def __init__(self, robot: str, task_id: int) -> None:
        self.robot = robot
        self.task_id = task_id
        self.log = MessageLog()
        self.is_lost = False
        self.dropped = 0
        self.size = 0
        self._start = 0.0
        self._ticks: list[_Tick] = []
        self._times: list[float] = []
        self._since_keyframe = 0
        self._latest: Frame | None = None
        self._nodes: Sequence[Any] = ()

    def __len__(self) -> int:
        """The number of ticks stored."""
        return len(self._ticks)

    @property
    def latest(self) -> Frame:
        """The last tick."""
        assert self._latest is not None, "a run is made with its first tick"
        return self._latest

    @property
    def is_finished(self) -> bool:
        """Whether it has ended or is lost."""
        return self.is_lost or self.latest.has_ended

    @property
    def start(self) -> float:
        """The time of its first message (s since the epoch)."""
        return self._start

    @property
    def times(self) -> Sequence[float]:
        """The times of the stored ticks, oldest first (s since the epoch)."""
        return self._times

    def record(self, nodes: Sequence[Any], time: float) -> bool:
        """Records a message.

        :param nodes: a `SkillProgress` for each node, the root first. A node that is the same object as in the previous
            message counts as unchanged.
        :param time: when it was received (s since the epoch).
        :returns: whether the tree has changed shape.
        """
        before, last = self._latest, self._nodes
        self._nodes = nodes
        if before is None:
            self._start = time
        updated = list(range(len(nodes)))
        if before is not None and len(nodes) == len(last):
            updated = [index for index in updated if nodes[index] is not last[index]]
            if all(key_of(nodes[index]) == before.shape.keys[index] for index in updated):
                self._record_same_shape(nodes, time, before, updated)
                return False
        shape = Shape([key_of(node) for node in nodes])
        rows = _carried_over(shape, before)
        self._update(rows, nodes, updated, time, before is None)
        said = {index: node.progress_message for index, node in enumerate(nodes) if node.progress_message}
        frame = Frame(time, shape, rows, said, self._start)
        self.log.record(frame, updated)
        self._keep(frame, None, said)
        return True

    def frame(self, tick: int) -> Frame:
        """Returns the tree at a stored tick; 0 is the oldest.

        :raises IndexError: there is no such tick.
        """
        if not 0 <= tick < len(self._ticks):
            raise IndexError(f"tick {tick} of {len(self._ticks)}")
        if tick == len(self._ticks) - 1:
            return self.latest
        first = tick
        while self._ticks[first].indices is not None:
            first -= 1
        whole = self._ticks[first]
        rows, messages = whole.rows.copy(), dict(whole.messages)
        for changes in self._ticks[first + 1 : tick + 1]:
            rows[changes.indices] = changes.rows
            messages.update(changes.messages)
        said = {index: text for index, text in messages.items() if text}
        return Frame(self._ticks[tick].time, whole.shape, rows, said, self._start)

    def tick_at(self, time: float) -> int:
        """Returns the last tick at or before a time; 0 for an earlier time."""
        return max(0, bisect.bisect_right(self._times, time) - 1)

    def drop_oldest(self) -> bool:
        """Discards the oldest ticks, up to the next keyframe.

        :returns: whether any could be discarded.
        """
        for number in range(1, len(self._ticks)):
            if self._ticks[number].indices is None:
                self.size -= sum(tick.size for tick in self._ticks[:number])
                del self._ticks[:number], self._times[:number]
                self.dropped += number
                return True
        return False

    def _record_same_shape(self, nodes: Sequence[Any], time: float, before: Frame, updated: list[int]) -> None:
        """Records a message with the nodes of the previous one."""
        rows, said = before.rows, before.messages
        texts = {p: nodes[p].progress_message for p in updated if nodes[p].progress_message != said.get(p, "")}
        if updated:
            rows = rows.copy()
            self._update(rows, nodes, updated, time, False)
        if texts:
            said = {index: text for index, text in {**said, **texts}.items() if text}
        frame = Frame(time, before.shape, rows, said, self._start)
        among = np.array(updated, "i4")
        indices = among[_differ(rows[among], before.rows[among])]
        others = indices[rows["state"][indices] != before.rows["state"][indices]]
        self.log.record(frame, sorted({*others.tolist(), *texts}))
        self._keep(frame, indices, texts)

    def _update(self, rows: Rows, nodes: Sequence[Any], updated: list[int], time: float, is_first: bool) -> None:
        """Updates the rows of some nodes."""
        count, now = len(updated), time - self._start
        at: Any = updated if count < len(rows) else slice(None)
        state = np.fromiter((nodes[index].state for index in updated), "i2", count)
        run_time = np.fromiter((nodes[index].progress_time for index in updated), "f4", count)
        run_time = np.where((run_time > 0.0) & (run_time < _LONGEST), run_time, 0.0)  # both are False for NaN
        began, ended = rows["began"][at], rows["ended"][at]
        runs, idle = state == RUNNING, state == IDLE
        starts = runs & (np.isnan(began) | ~np.isnan(ended))
        # The manager knows the run time of a node that was running before the first message.
        began = np.where(starts, now - (run_time if is_first else 0.0), began)
        ended = np.where(starts, np.nan, ended)
        ends = ~runs & ~idle & np.isnan(ended)
        began = np.where(ends & np.isnan(began), now - run_time, began)
        ended = np.where(ends | (idle & ~np.isnan(began) & np.isnan(ended)), now, ended)
        rows["state"][at], rows["began"][at], rows["ended"][at] = state, began, ended
        rows["code"][at] = np.fromiter((nodes[index].progress_code for index in updated), "i2", count)

    def _keep(self, frame: Frame, indices: npt.NDArray[np.int32] | None, texts: dict[int, str]) -> None:
        """Stores a tick, unless nothing has changed: then the last tick lasts longer.

        :param indices: of the changed rows; None if the tree has changed shape.
        :param texts: the changed messages.
        """
        self._latest = frame
        if indices is not None and not len(indices) and not texts:
            return
        if indices is None or self._since_keyframe >= _KEYFRAME_INTERVAL:
            tick = _Tick(frame.time, frame.shape, None, frame.rows, frame.messages)
            self._since_keyframe = 0
        else:
            tick = _Tick(frame.time, frame.shape, indices, frame.rows[indices], texts)
            self._since_keyframe += 1
        self._ticks.append(tick)
        self._times.append(frame.time)
        self.size += tick.size


def _carried_over(shape: Shape, before: Frame | None) -> Rows:
    """Returns rows for a new shape, with the values of the nodes that the previous tick had."""
    known = _unknown(len(shape))
    if before is not None:
        old = before.shape.index_by_id
        pairs = [(index, old[key[0]]) for index, key in enumerate(shape.keys) if key[0] in old]
        if pairs:
            new, indices = np.array(pairs, "i4").T
            known[new] = before.rows[indices]
    return known


def _unknown(count: int) -> Rows:
    rows = np.zeros(count, ROW)
    rows["began"] = rows["ended"] = np.nan
    return rows


def _differ(rows: Rows, others: Rows) -> npt.NDArray[np.bool_]:
    """Returns which rows differ; compares bytes, as NaN does not equal itself."""
    size = ROW.itemsize
    wide = np.ascontiguousarray(rows).view("u1").reshape(-1, size)
    return np.asarray((wide != np.ascontiguousarray(others).view("u1").reshape(-1, size)).any(axis=1))
