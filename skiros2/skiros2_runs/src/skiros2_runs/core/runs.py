"""The tasks of all managers, or of a bag."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from skiros2_runs.core.progress import NodeMessage, has_ended
from skiros2_runs.core.task_run import Recorded, TaskRun

#: The most memory for ticks (bytes): minutes of a tree with 1000 nodes that all change at each tick, or many hours of a
#: small one.
MAX_KEPT = 64_000_000

#: The most ended tasks kept.
MAX_TASKS = 100

#: A lost task may return for this long after its last message (s). Then it is kept as one that has ended.
RETURN_TIME = 3600.0


class Runs:
    """One thread at a time.

    :param most_bytes: the most memory for ticks.
    :param most_tasks: the most ended tasks, and lost ones that may no longer return.
    """

    def __init__(self, most_bytes: int = MAX_KEPT, most_tasks: int = MAX_TASKS) -> None:
        self._most_bytes = most_bytes
        self._most_tasks = most_tasks
        self._runs: list[TaskRun] = []
        self._current: dict[tuple[str, int], TaskRun] = {}
        #: The last lost task of each id.
        self._lost: dict[tuple[str, int], TaskRun] = {}
        #: When the first message of each manager was received (s since the epoch).
        self._heard_since: dict[str, float] = {}

    def __iter__(self) -> Iterator[TaskRun]:
        """In the order of their first message."""
        return iter(list(self._runs))

    def __len__(self) -> int:
        return len(self._runs)

    def record(self, robot: str, nodes: Sequence[NodeMessage], time: float) -> Recorded | None:
        """Records a message of a manager.

        :param nodes: a `SkillProgress` for each node, the root first.
        :param time: when it was received (s since the epoch).
        :returns: the task and what has changed; None if `nodes` is empty.
        """
        if not nodes:
            return None
        root = nodes[0]
        key = (robot or root.robot, root.task_id)
        run = self._current.get(key)
        if run is None and (lost := self._lost.pop(key, None)) is not None and lost.continues(nodes, time):
            self._current[key] = run = lost
        if run is None or (run.latest.has_ended and not has_ended(nodes)):  # the id is used again
            run = TaskRun(*key, heard_since=self._heard_since.setdefault(key[0], time))
            self._current[key] = run
            self._runs.append(run)
        run.is_lost = False  # its messages were only late
        recorded = run.record(nodes, time)
        self._make_room(run)
        return recorded

    def mark_lost(self, robot: str, *, may_return: bool = False) -> None:
        """Marks the running tasks of a manager that has disconnected as lost.

        :param may_return: they continue with their next message, as ids are not used again. Otherwise one continues
            only with a message of a task that began before its last one: the manager was silent, and has not restarted.
        """
        self._heard_since.pop(robot, None)
        for run in self._runs:
            if run.robot == robot:
                is_lost, run.is_lost = run.is_lost, run.is_lost or not run.latest.has_ended
                if not may_return:
                    self._current.pop((robot, run.task_id), None)
                    if run.is_lost and not is_lost:
                        self._lost[robot, run.task_id] = run

    def clear_ended(self) -> None:
        """Removes the tasks that have ended."""
        self._runs = [run for run in self._runs if not run.is_finished]
        self._current = {(run.robot, run.task_id): run for run in self._runs}
        self._lost.clear()

    def _make_room(self, used: TaskRun) -> None:
        lost_before = used.latest.time - RETURN_TIME
        ended = [
            run
            for run in self._runs
            if run is not used and (run.latest.has_ended or (run.is_lost and run.latest.time < lost_before))
        ]
        if len(ended) > self._most_tasks:
            self._evict(ended.pop(0))
        size = sum(run.size for run in self._runs)
        while size > self._most_bytes and ended:
            size -= ended[0].size
            self._evict(ended.pop(0))
        while size > self._most_bytes:
            largest = max(self._runs, key=lambda run: run.size)
            size -= largest.size
            if not largest.drop_oldest():
                return
            size += largest.size

    def _evict(self, run: TaskRun) -> None:
        self._runs.remove(run)
        for runs in (self._current, self._lost):
            if runs.get((run.robot, run.task_id)) is run:
                del runs[run.robot, run.task_id]
