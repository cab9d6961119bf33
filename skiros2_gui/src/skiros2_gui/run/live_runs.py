"""The tasks of the running managers."""

from __future__ import annotations

import weakref
from collections.abc import Callable
from functools import partial
from typing import Any

from skiros2_gui.app.events import ManagersChanged, TaskProgress
from skiros2_gui.app.state_style import style_of
from skiros2_gui.app.window import Window
from skiros2_gui.run.runs import Runs
from skiros2_gui.run.task_run import TaskRun

#: Managers publish the progress of each task once a second. After this time (s) a task is checked.
_TIMEOUT = 3.0


class LiveRuns:
    """Used in the window's thread.

    :param on_run: called when a task has published progress, with whether its tree has changed shape.
    :param on_change: called when tasks have been added or their states have changed.
    :param on_robot: called with the name of a manager that has connected or disconnected.
    """

    def __init__(
        self,
        window: Window,
        on_run: Callable[[TaskRun, bool], None],
        on_change: Callable[[], None],
        on_robot: Callable[[str], None],
    ) -> None:
        self._window = window
        self._on_run = on_run
        self._on_change = on_change
        self._on_robot = on_robot
        self._reported: weakref.WeakKeyDictionary[TaskRun, tuple[str, str]] = weakref.WeakKeyDictionary()
        self._robots: set[str] = set()
        self.runs = Runs()
        window.subscribe(TaskProgress, self._on_progress)
        window.subscribe(ManagersChanged, lambda _: self.update_managers())

    def find(self, robot: str, task_id: int) -> TaskRun | None:
        """Returns the latest task with that id."""
        return next((r for r in reversed(list(self.runs)) if (r.robot, r.task_id) == (robot, task_id)), None)

    def newest(self) -> TaskRun | None:
        """Returns the newest running task, or else the newest task."""
        known = list(self.runs)
        chosen = [run for run in known if not run.is_finished] or known
        return chosen[-1] if chosen else None

    def update_managers(self) -> None:
        """Marks the tasks of managers that have disconnected as lost."""
        managers = self._window.system.managers.keys()
        for name in self._robots - managers:
            self.runs.mark_lost(name)
        changed, self._robots = self._robots ^ managers, set(managers)
        for name in sorted(changed):
            self._on_robot(name)
        self._on_change()

    def check(self, now: float) -> None:
        """Asks for tasks without recent progress, in case the message of their end was lost.

        :param now: s since the epoch.
        """
        silent = [run for run in self.runs if not run.is_finished and now - run.latest.time > _TIMEOUT]
        for robot in {run.robot for run in silent} & self._window.system.managers.keys():
            manager = self._window.system.managers[robot]
            of_robot = [run for run in silent if run.robot == robot]
            done = partial(self._mark_missing, of_robot, now)
            self._window.jobs.run(manager.tasks, done, lambda error: None, queue=robot)

    def _mark_missing(self, silent: list[TaskRun], asked: float, tasks: list[Any]) -> None:
        alive = {nodes[0].id for nodes in tasks if nodes}
        for run in silent:
            if run.task_id not in alive and run.latest.time < asked and not run.is_finished:
                run.is_lost = True
                self._on_change()

    def _on_progress(self, event: TaskProgress) -> None:
        recorded = self.runs.record(event.manager, event.nodes, event.stamp)
        if recorded is None:
            return
        run, is_new = recorded
        text = state_text(run)
        if self._reported.get(run) != text:
            self._reported[run] = text
            self._on_change()
        self._on_run(run, is_new)


def is_paused(run: TaskRun) -> bool:
    """Returns whether the task is paused, as its root's message says."""
    return not run.latest.has_ended and run.latest.message(0).startswith("paused")


def state_text(run: TaskRun) -> tuple[str, str]:
    """Returns the symbol and the word for the state of a task."""
    if run.is_lost and not run.latest.has_ended:
        return "?", "lost: its end was not reported"
    if is_paused(run):
        return "‖", "paused"
    style = style_of(run.latest.state(0))
    return style.symbol, style.word
