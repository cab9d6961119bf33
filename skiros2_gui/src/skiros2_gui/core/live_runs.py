"""The tasks of the managers that are there, as they are told of."""

from __future__ import annotations

import weakref
from collections.abc import Callable
from functools import partial
from typing import Any

from skiros2_gui.core.events import ManagersChanged, Progressed
from skiros2_gui.core.run_history import TaskRun
from skiros2_gui.core.runs import Runs
from skiros2_gui.core.states import look_of
from skiros2_gui.core.window import Window

#: A task that has not ended tells of itself once a second; of one that has not for so long (s) the end may be lost.
_SILENT = 3.0


class LiveRuns:
    """Used in the window's thread.

    :param on_run: called when a task was told of, with whether its tree has another shape.
    :param on_other: called when tasks have come, or are doing something else than before.
    :param on_robot: called with the name of a manager that has come, or gone.
    """

    def __init__(
        self,
        window: Window,
        on_run: Callable[[TaskRun, bool], None],
        on_other: Callable[[], None],
        on_robot: Callable[[str], None],
    ) -> None:
        self._window = window
        self._on_run = on_run
        self._on_other = on_other
        self._on_robot = on_robot
        self._told: weakref.WeakKeyDictionary[TaskRun, tuple[str, str]] = weakref.WeakKeyDictionary()
        self._robots: set[str] = set()
        self.runs = Runs()
        window.subscribe(Progressed, self._on_progress)
        window.subscribe(ManagersChanged, lambda _: self.look_at_managers())

    def find(self, robot: str, task_id: int) -> TaskRun | None:
        """The task of that number; of several that had it the last one."""
        return next((r for r in reversed(list(self.runs)) if (r.robot, r.task_id) == (robot, task_id)), None)

    def newest(self) -> TaskRun | None:
        """The task that was seen to begin last, of those that run if there are any."""
        known = list(self.runs)
        chosen = [run for run in known if not run.is_over] or known
        return chosen[-1] if chosen else None

    def look_at_managers(self) -> None:
        """Takes notice of managers that have come, or gone."""
        there = self._window.system.managers.keys()
        for name in self._robots - there:
            self.runs.lose(name)
        changed, self._robots = self._robots ^ there, set(there)
        for name in sorted(changed):
            self._on_robot(name)
        self._on_other()

    def check(self, now: float) -> None:
        """Asks for the tasks of which nothing was heard for long: news of their end may have got lost.

        :param now: s since the epoch.
        """
        silent = [run for run in self.runs if not run.is_over and now - run.now.time > _SILENT]
        for robot in {run.robot for run in silent} & self._window.system.managers.keys():
            manager = self._window.system.managers[robot]
            of_robot = [run for run in silent if run.robot == robot]
            taken = partial(self._take_alive, of_robot, now)
            self._window.jobs.run(manager.tasks, taken, lambda error: None, lane=robot)

    def _take_alive(self, silent: list[TaskRun], asked: float, tasks: list[Any]) -> None:
        alive = {nodes[0].id for nodes in tasks if nodes}
        for run in silent:
            if run.task_id not in alive and run.now.time < asked and not run.is_over:
                run.is_lost = True
                self._on_other()

    def _on_progress(self, event: Progressed) -> None:
        entered = self.runs.enter(event.manager, event.nodes, event.stamp)
        if entered is None:
            return
        run, is_new = entered
        said = state_text(run)
        if self._told.get(run) != said:
            self._told[run] = said
            self._on_other()
        self._on_run(run, is_new)


def is_paused(run: TaskRun) -> bool:
    """Whether the task waits for somebody to go on with it: its root says so."""
    return not run.now.has_ended and run.now.message(0).startswith("paused")


def state_text(run: TaskRun) -> tuple[str, str]:
    """A symbol and a word for what a task is doing."""
    if run.is_lost and not run.now.has_ended:
        return "?", "lost: its end was not heard of"
    if is_paused(run):
        return "‖", "paused"
    look = look_of(run.now.state(0))
    return look.symbol, look.word
