"""The tasks that are, or were, seen to run: of all managers, or of a bag."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any

from skiros2_gui.core.run_history import TaskRun

#: The ticks of all tasks may take so much (bytes): minutes of a tree of 1000 nodes that all change at each tick, many
#: hours of a small one.
MOST_KEPT = 64_000_000

#: So many tasks that have ended are kept.
MOST_TASKS = 100


class Runs:
    """One thread at a time.

    :param most: bytes.
    :ivar gone: how many tasks that had ended were given up for want of room.
    """

    def __init__(self, most: int = MOST_KEPT, most_tasks: int = MOST_TASKS) -> None:
        self._most = most
        self._most_tasks = most_tasks
        self._runs: list[TaskRun] = []
        self._current: dict[tuple[str, int], TaskRun] = {}
        self.gone = 0

    def __iter__(self) -> Iterator[TaskRun]:
        """In the order in which they were first seen."""
        return iter(list(self._runs))

    def __len__(self) -> int:
        return len(self._runs)

    def enter(self, robot: str, nodes: Sequence[Any], time: float) -> tuple[TaskRun, bool] | None:
        """Takes in what a manager told of a task.

        :param nodes: a `SkillProgress` for each node, the root first.
        :param time: when it was told (s since the epoch).
        :returns: the task, and whether its tree has another shape now; None where nothing was told.
        """
        if not nodes:
            return None
        root = nodes[0]
        key = (robot or root.robot, root.task_id)
        run = self._current.get(key)
        is_over = abs(root.progress_code) == 1
        if run is None or (run.now.has_ended and not is_over):  # the number is used again
            run = TaskRun(*key)
            self._current[key] = run
            self._runs.append(run)
        run.is_lost = False  # it was silent for a while
        is_new = run.enter(nodes, time)
        self._make_room(run)
        return run, is_new

    def lose(self, robot: str) -> None:
        """The manager has gone: its tasks are at an end, whatever they told last. One that comes counts anew."""
        for run in self._runs:
            if run.robot == robot and not run.now.has_ended:
                run.is_lost = True
                self._current.pop((robot, run.task_id), None)

    def forget_ended(self) -> None:
        """Gives up the tasks that have ended."""
        self._runs = [run for run in self._runs if not run.is_over]
        self._current = {(run.robot, run.task_id): run for run in self._runs}

    def _make_room(self, used: TaskRun) -> None:
        ended = [run for run in self._runs if run.now.has_ended and run is not used]
        if len(ended) > self._most_tasks:
            self._give_up(ended.pop(0))
        size = sum(run.size for run in self._runs)
        while size > self._most and ended:
            size -= ended[0].size
            self._give_up(ended.pop(0))
        while size > self._most:
            largest = max(self._runs, key=lambda run: run.size)
            size -= largest.size
            if not largest.drop_oldest():
                return
            size += largest.size

    def _give_up(self, run: TaskRun) -> None:
        self._runs.remove(run)
        if self._current.get((run.robot, run.task_id)) is run:
            del self._current[run.robot, run.task_id]
        self.gone += 1


def runs_of(messages: Iterable[Any], is_cancelled: Callable[[], bool] = lambda: False) -> Runs:
    """The tasks of a bag.

    :param messages: of the type `TreeProgress`, oldest first, as `skiros2_bags.core.run.Run` reads them.
    :param is_cancelled: asked for each message.
    :raises BagError: one cannot be read.
    """
    runs = Runs()
    for message in messages:
        if is_cancelled():
            break
        robot = message.topic.removesuffix("/monitor")
        runs.enter(robot, message.content.progress, message.time)
    return runs
