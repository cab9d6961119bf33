"""The recorded ticks of a task.

A tick is stored as the rows that have changed. Every `_KEYFRAME_INTERVAL` ticks, and when the tree changes shape, a
keyframe stores all rows.
"""

from __future__ import annotations

import bisect
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from skiros2_runs.core.frame import ROW, Frame, Rows, Shape, key_of
from skiros2_runs.core.message_log import MessageLog
from skiros2_runs.core.progress import NodeMessage, has_ended, task_state
from skiros2_runs.core.states import IDLE, RUNNING, TaskState
from skiros2_runs.core.values import NodeStatus

#: The number of ticks between keyframes.
_KEYFRAME_INTERVAL = 64

#: Longer run times are invalid (s; a year).
_LONGEST = 3.2e7

#: Managers publish the progress of each task at least this often (s).
KEEP_ALIVE = 1.0

#: By how much a message may be later than another of its task (s). No manager restarts in this time.
_LATENESS = 0.5

#: The longest time between two messages of a task (s), with a margin.
_LONGEST_PERIOD = 1.5 * KEEP_ALIVE

#: The most values kept of each node.
_MAX_VALUES = 20

#: The most parameters kept of each node, beside the first.
MAX_PARAMS = 50

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
    task_state: TaskState

    @property
    def size(self) -> int:
        """The approximate memory (bytes)."""
        texts = sum(len(text) + _TEXT for text in self.messages.values())
        return _TICK + self.rows.nbytes + (self.indices.nbytes if self.indices is not None else 0) + texts


@dataclass(frozen=True)
class Recorded:
    """The result of recording a message.

    :param is_new_tick: whether anything but the time has changed.
    :param is_new_shape: whether the tree has changed shape.
    """

    run: TaskRun
    is_new_tick: bool
    is_new_shape: bool


class TaskRun:
    """A task since its first message. One thread at a time.

    :param robot: the manager's node name.
    :param task_id: the root's id. Ids are reused, so several runs may have the same.
    :param heard_since: when the first message of its manager was received (s since the epoch).
    :ivar log: the messages of its nodes.
    :ivar params: the parameters that messages had, by node id: time (s since the epoch) and a JSON text for each
        parameter, oldest first: the first, and the last `MAX_PARAMS`. Managers send them on request only.
    :ivar is_lost: whether its manager has disconnected while it was running.
    :ivar dropped: the number of oldest ticks discarded for lack of memory.
    :ivar size: the approximate memory of the ticks (bytes).
    :ivar start: the time of its first message (s since the epoch).
    :ivar times: the times of the stored ticks, oldest first (s since the epoch).
    :ivar is_complete: whether the first message can be that of the task's first tick.
    """

    def __init__(self, robot: str, task_id: int, heard_since: float = math.inf) -> None:
        self.robot = robot
        self.task_id = task_id
        self._heard_since = heard_since
        self.log = MessageLog()
        self.params: dict[int, list[tuple[float, tuple[str, ...]]]] = {}
        self._values: dict[int, list[NodeStatus]] = {}
        self.is_lost = False
        self.dropped = 0
        self.size = 0
        self.start = 0.0
        self.times: list[float] = []
        self.is_complete = False
        self._ticks: list[_Tick] = []
        self._since_keyframe = 0
        self._latest: Frame | None = None
        self._nodes: Sequence[NodeMessage] = ()

    def __len__(self) -> int:
        """The number of ticks stored."""
        return len(self._ticks)

    @property
    def latest(self) -> Frame:
        """The last tick."""
        assert self._latest is not None, "a run is made with its first tick"
        return self._latest

    @property
    def nodes(self) -> Sequence[NodeMessage]:
        """The last message."""
        return self._nodes

    @property
    def is_finished(self) -> bool:
        """Whether it has ended or is lost."""
        return self.is_lost or self.latest.has_ended

    @property
    def state(self) -> TaskState:
        """The state of the task."""
        return TaskState.LOST if self.is_lost and not self.latest.has_ended else self.latest.task_state

    def continues(self, nodes: Sequence[NodeMessage], time: float) -> bool:
        """Returns whether a message with this task's id is of a task that began before the last message of this one, or
        that has run no longer since it: the task is paused, or has not been ticked yet.

        :param time: when it was received (s since the epoch).
        """
        age = _age(nodes)
        return time - age <= self.latest.time + _LATENESS or 0.0 < age == _age(self._nodes)

    def end_of(self, nodes: Sequence[NodeMessage], time: float) -> float | None:
        """Returns when the task has ended (s since the epoch), by how long it has run; None if `nodes` is not its end.

        :param nodes: the last message of a task with this task's id.
        :param time: when it was received (s since the epoch).
        """
        ended = self.latest.time + _age(nodes) - _age(self._nodes)
        is_of_skill = list(map(key_of, nodes[:2])) == list(map(key_of, self._nodes[:2]))
        is_end = is_of_skill and not self.latest.has_ended and has_ended(nodes)
        return ended if is_end and self.latest.time <= ended <= time + KEEP_ALIVE else None

    def record(self, nodes: Sequence[NodeMessage], time: float) -> Recorded:
        """Records a message.

        :param nodes: a `SkillProgress` for each node, the root first. A node that is the same object as in the previous
            message counts as unchanged.
        :param time: when it was received (s since the epoch).
        :returns: what has changed.
        """
        before, last = self._latest, self._nodes
        self._nodes = nodes
        if before is None:
            self.start = time
            age = _age(nodes)
            # beside much other load, the first tick may be long after the task's start
            self.is_complete = age < _LONGEST_PERIOD or time - age > self._heard_since
        updated = list(range(len(nodes)))
        if len(nodes) == len(last):
            updated = [index for index in updated if nodes[index] is not last[index]]
        self._record_params(nodes, updated, time)
        texts = {index: nodes[index].progress_message for index in updated}
        if before is None or len(nodes) != len(last) or any(key_of(nodes[i]) != before.shape.keys[i] for i in updated):
            shape, said = Shape.of(nodes), {}
            texts = {index: node.progress_message for index, node in enumerate(nodes) if node.progress_message}
            rows = _carried_over(shape, before)
        else:
            shape, rows, said = before.shape, before.rows, before.messages
            texts = {index: text for index, text in texts.items() if text != said.get(index, "")}
            rows = rows.copy() if updated else rows
        if updated:
            self._update(rows, nodes, updated, time, before is None)
        if texts:
            said = {index: text for index, text in {**said, **texts}.items() if text}
        frame = Frame(time, shape, rows, said, self.start, task_state(nodes[0]))
        if before is None or shape is not before.shape:
            self.log.record(frame, updated)
            self._keep(frame, None, said)
            return Recorded(self, True, True)
        among = np.array(updated, "i4")
        changed = among[_differ(rows[among], before.rows[among])]
        new_states = changed[rows["state"][changed] != before.rows["state"][changed]]
        self.log.record(frame, sorted({*new_states.tolist(), *texts}))
        is_new_tick = bool(len(changed) or texts) or frame.task_state != before.task_state
        if is_new_tick:
            self._keep(frame, changed, texts)
        self._latest = frame  # without a new tick, the last one lasts longer
        return Recorded(self, is_new_tick, False)

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
        return list(self._frames(first, tick + 1))[-1]

    def frames(self) -> Iterator[Frame]:
        """Yields the tree at each stored tick, oldest first."""
        return self._frames(0, len(self._ticks))

    def _frames(self, first: int, end: int) -> Iterator[Frame]:
        """:param first: the index of a keyframe."""
        before: Frame | None = None
        for tick in self._ticks[first:end]:
            rows, texts = tick.rows, tick.messages
            if tick.indices is not None:
                assert before is not None, "a run begins with a keyframe"
                rows = before.rows.copy()
                rows[tick.indices] = tick.rows
                texts = before.messages
                if tick.messages:
                    texts = {index: text for index, text in {**texts, **tick.messages}.items() if text}
            before = Frame(tick.time, tick.shape, rows, texts, self.start, tick.task_state)
            yield before

    def tick_at(self, time: float) -> int:
        """Returns the last tick at or before a time; 0 for an earlier time."""
        return max(0, bisect.bisect_right(self.times, time) - 1)

    def add_values(self, values: NodeStatus) -> bool:
        """Keeps the values of a node. The oldest ones are discarded, and those between two equal ones.

        :returns: whether they differ from the last ones in more than the time at which they were read.
        """
        known = self._values.setdefault(values.node, [])
        is_new = not known or (known[-1].params, known[-1].conditions) != (values.params, values.conditions)
        if len(known) > 1 and values.equals(known[-1]) and values.equals(known[-2]):
            known[-1] = values
        else:
            bisect.insort(known, values, key=lambda other: other.time)
            del known[:-_MAX_VALUES]
        return is_new

    def values_at(self, node: int, time: float) -> NodeStatus | None:
        """Returns the last known values of a node at or before a time, else the first known later ones of a run that
        had started by then; None if there are none.

        :param node: its id.
        :param time: s since the epoch.
        """
        known = self._values.get(node, [])
        number = bisect.bisect_right(known, time, key=lambda values: values.time)
        if number:
            return known[number - 1]
        return next((values for values in known if values.started_by(time)), None)

    def drop_oldest(self) -> bool:
        """Discards the oldest ticks, up to the next keyframe.

        :returns: whether any could be discarded.
        """
        for number in range(1, len(self._ticks)):
            if self._ticks[number].indices is None:
                self.size -= sum(tick.size for tick in self._ticks[:number])
                del self._ticks[:number], self.times[:number]
                self.dropped += number
                return True
        return False

    def _record_params(self, nodes: Sequence[NodeMessage], updated: list[int], time: float) -> None:
        for index in updated:
            if index and nodes[index].params:
                known = self.params.setdefault(nodes[index].id, [])
                texts = tuple(param.param for param in nodes[index].params)
                if not known or known[-1][1] != texts:
                    known.append((time, texts))
                    del known[1:-MAX_PARAMS]

    def _update(
        self, rows: Rows, nodes: Sequence[NodeMessage], updated: list[int], time: float, is_first: bool
    ) -> None:
        """Updates the rows of some nodes."""
        count, now = len(updated), time - self.start
        at: Any = updated if count < len(rows) else slice(None)
        state = np.fromiter((nodes[index].state for index in updated), "i2", count)
        run_time = np.fromiter((nodes[index].progress_time for index in updated), "f4", count)
        rows["run_time"][at] = run_time
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
        """Stores a tick.

        :param indices: of the changed rows; None if the tree has changed shape.
        :param texts: the changed messages.
        """
        self._latest = frame
        if indices is None or self._since_keyframe >= _KEYFRAME_INTERVAL:
            tick = _Tick(frame.time, frame.shape, None, frame.rows, frame.messages, frame.task_state)
            self._since_keyframe = 0
        else:
            tick = _Tick(frame.time, frame.shape, indices, frame.rows[indices], texts, frame.task_state)
            self._since_keyframe += 1
        self._ticks.append(tick)
        self.times.append(frame.time)
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


def _age(nodes: Sequence[NodeMessage]) -> float:
    """Returns how long a task has run (s)."""
    return max(node.progress_time for node in nodes)
