"""The tasks of all managers, or of a bag."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from skiros2_gui.run.task_run import TaskRun

#: The most memory for ticks (bytes): minutes of a tree with 1000 nodes that all change at each tick, or many hours of a
#: small one.
MAX_KEPT = 64_000_000

#: The most ended tasks kept.
MAX_TASKS = 100


class Runs:
    """One thread at a time.

    :param most: bytes.
    :ivar evicted: the number of ended tasks discarded for lack of memory.
    """

    def __init__(self, most: int = MAX_KEPT, most_tasks: int = MAX_TASKS) -> None:
        self._most = most
        self._most_tasks = most_tasks
        self._runs: list[TaskRun] = []
        self._current: dict[tuple[str, int], TaskRun] = {}
        self.evicted = 0

    def __iter__(self) -> Iterator[TaskRun]:
        """In the order of their first message."""
        return iter(list(self._runs))

    def __len__(self) -> int:
        return len(self._runs)

    def record(self, robot: str, nodes: Sequence[Any], time: float) -> tuple[TaskRun, bool] | None:
        """Records a message of a manager.

        :param nodes: a `SkillProgress` for each node, the root first.
        :param time: when it was received (s since the epoch).
        :returns: the task and whether its tree has changed shape; None if `nodes` is empty.
        """
        if not nodes:
            return None
        root = nodes[0]
        key = (robot or root.robot, root.task_id)
        run = self._current.get(key)
        is_finished = abs(root.progress_code) == 1
        if run is None or (run.latest.has_ended and not is_finished):  # the id is used again
            run = TaskRun(*key)
            self._current[key] = run
            self._runs.append(run)
        run.is_lost = False  # its messages were only late
        is_new = run.record(nodes, time)
        self._make_room(run)
        return run, is_new

    def mark_lost(self, robot: str) -> None:
        """Marks the running tasks of a manager that has disconnected as lost; later tasks with their ids are
        new ones.
        """
        for run in self._runs:
            if run.robot == robot and not run.latest.has_ended:
                run.is_lost = True
                self._current.pop((robot, run.task_id), None)

    def clear_ended(self) -> None:
        """Removes the tasks that have ended."""
        self._runs = [run for run in self._runs if not run.is_finished]
        self._current = {(run.robot, run.task_id): run for run in self._runs}

    def _make_room(self, used: TaskRun) -> None:
        ended = [run for run in self._runs if run.latest.has_ended and run is not used]
        if len(ended) > self._most_tasks:
            self._evict(ended.pop(0))
        size = sum(run.size for run in self._runs)
        while size > self._most and ended:
            size -= ended[0].size
            self._evict(ended.pop(0))
        while size > self._most:
            largest = max(self._runs, key=lambda run: run.size)
            size -= largest.size
            if not largest.drop_oldest():
                return
            size += largest.size

    def _evict(self, run: TaskRun) -> None:
        self._runs.remove(run)
        if self._current.get((run.robot, run.task_id)) is run:
            del self._current[run.robot, run.task_id]
        self.evicted += 1


def runs_of(messages: Iterable[Any], is_cancelled: Callable[[], bool] = lambda: False) -> Runs:
    """Returns the tasks of a bag.

    :param messages: of the type `TreeProgress`, oldest first, as `skiros2_bags.core.run.Run` reads them.
    :param is_cancelled: called for each message.
    :raises BagError: a message cannot be read.
    """
    runs = Runs()
    for message in messages:
        if is_cancelled():
            break
        robot = message.topic.removesuffix("/monitor")
        runs.record(robot, message.content.progress, message.time)
    return runs


@dataclass(frozen=True)
class RunBag:
    """:param damage: where and why the bag ends early; "" if it is complete."""

    path: str
    runs: Runs
    damage: str


def read_bag(path: str) -> RunBag:
    """Reads the tasks of a bag. Takes about a second for 10 000 ticks of a small tree.

    :raises BagError: it cannot be read, or has no progress of tasks.
    """
    from skiros2_bags.core.errors import BagError  # imported here, as it takes a second
    from skiros2_bags.core.message import PROGRESS
    from skiros2_bags.core.run import Run

    run = Run.open(path)
    if PROGRESS not in run.topics.values():
        raise BagError(f"{path}: the bag holds no progress of tasks: expected a topic of the type {PROGRESS}")
    runs = runs_of(run.messages(PROGRESS))
    if not len(runs):
        raise BagError(f"{path}: no task ran while the bag was recorded")
    return RunBag(path, runs, run.damage)
