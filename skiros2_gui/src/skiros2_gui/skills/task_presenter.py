"""The presenter of the list of tasks: commands, and why a task failed."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Sequence
from typing import Any

from skiros2_common.core.explanation import Explanation
from skiros2_gui.app.events import ManagersChanged, TaskProgress, TaskStarted
from skiros2_gui.app.system import Manager
from skiros2_gui.app.window import Window
from skiros2_gui.skills.task_rows import Key, TaskRow, TaskRows


class TaskListPresenter:
    """Used in the window's thread. The view sets `on_tasks` and `on_why`, which are called on changes."""

    def __init__(self, window: Window, clock: Callable[[], float] = time.time) -> None:
        self._window = window
        self._clock = clock
        self._tasks = TaskRows()
        self._last: dict[str, int] = {}  # the last started task, by manager
        self._known: set[str] = set()  # the connected managers
        self.on_tasks: Callable[[], None] = _nothing
        self.on_why: Callable[[], None] = _nothing
        #: The task that `why` (in lines) explains.
        self.why_of: Key | None = None
        self.why: tuple[str, ...] = ()
        window.subscribe(TaskProgress, self._progressed)
        window.subscribe(ManagersChanged, lambda _: self._managers_changed())
        self._managers_changed()

    @property
    def rows(self) -> list[TaskRow]:
        """Running tasks, then ended ones; the newest first."""
        return self._tasks.rows

    def get(self, key: Key | None) -> TaskRow | None:
        """Returns a task, or None."""
        return self._tasks.get(key)

    def last_of(self, manager: str) -> TaskRow | None:
        """Returns the task of a manager started last in this window, or None."""
        return self._tasks.get((manager, self._last[manager])) if manager in self._last else None

    def now(self) -> float:
        """Returns the time (s since the epoch)."""
        return self._clock()

    def started(self, manager: str, task: int, name: str, since: float) -> None:
        """Adds a task started by this window, unless its progress was received already.

        :param since: when the start was sent. Earlier progress with the same id belongs to an earlier task.
        """
        self._last[manager] = task
        known = self._tasks.get((manager, task))
        if known is None or known.updated < since:
            self._tasks.add(manager, task, name, self._clock())
            self.on_tasks()

    # -- commands ---------------------------------------------------------------------------------------------

    def pause(self, key: Key) -> None:
        """Pauses a task."""
        self._command(key, "pause", "pausing")

    def resume(self, key: Key) -> None:
        """Resumes a paused task."""
        self._command(key, "start", "resuming")

    def step(self, key: Key) -> None:
        """Ticks a paused task once."""
        self._command(key, "tick_once", "ticking")

    def stop(self, key: Key) -> None:
        """Preempts a task."""
        self._command(key, "preempt", "stopping")

    def stop_all(self) -> None:
        """Preempts all tasks of all robots."""
        for manager in self._window.system.managers:
            self._command((manager, -1), "preempt", "stopping")

    def show(self, key: Key) -> None:
        """Shows the task in the tab "Running"."""
        self._window.publish(TaskStarted(*key, to_front=True))

    def clear_ended(self) -> None:
        """Removes the tasks that have ended."""
        self._tasks.clear_ended()
        self.on_tasks()

    def ask_why(self, key: Key | None) -> None:
        """Reads why a task failed into `why`."""
        row = self._tasks.get(key)
        manager = self._window.system.managers.get(key[0]) if key is not None else None
        self.why_of, self.why = key, ()
        self.on_why()
        if row is None or manager is None or key is None or row.state != "failed":
            return
        task = key[1]
        self._window.jobs.run(
            lambda: _failure_lines(manager.why(task)),
            lambda lines: self._answered(key, lines),
            activity=f"asking why task {task} of {key[0]} failed",
            queue=key[0],
        )

    def _answered(self, key: Key, lines: tuple[str, ...]) -> None:
        if key == self.why_of:
            self.why = lines
            self.on_why()

    def _command(self, key: Key, action: str, verb: str) -> None:
        manager = self._window.system.managers.get(key[0])
        activity = f"{verb} {f'task {key[1]}' if key[1] >= 0 else 'all tasks'} of {key[0]}"
        if manager is None:
            self._window.problems.report(activity, "the robot is not running")
            return
        self._window.jobs.run(
            lambda: self._send_command(manager, action, key[1]),
            lambda found: self._update_tasks(key[0], *found),
            activity=activity,
            queue=f"{key[0]}: commands",
            urgent=action == "preempt",
        )

    def _send_command(self, manager: Manager, action: str, task: int) -> tuple[list[Sequence[Any]], float]:
        """Sends a command and reads the task, as a paused task publishes no progress. In a worker."""
        manager.command(action, task)
        stamp = self._clock()
        return (manager.tasks(task) if action in ("pause", "tick_once") else []), stamp

    # -- events ------------------------------------------------------------------------------------------------

    def _progressed(self, event: TaskProgress) -> None:
        if self._tasks.update(event.manager, event.nodes, event.stamp):
            self.on_tasks()
            row = self._tasks.get((event.manager, event.task))
            if row is not None and row.key == self.why_of:
                self.ask_why(row.key)

    def _managers_changed(self) -> None:
        managers = set(self._window.system.managers)
        lost = [self._tasks.mark_lost(name) for name in self._known - managers]
        self._known = managers
        if any(lost):
            self.on_tasks()

    def _update_tasks(self, manager: str, tasks: list[Sequence[Any]], stamp: float) -> None:
        """Updates tasks from a manager's response."""
        new = [self._tasks.update(manager, nodes, stamp) for nodes in tasks]
        if any(new):
            self.on_tasks()


def _failure_lines(answer: object) -> tuple[str, ...]:
    """Returns why a task failed, in lines; the failure that ended it first."""
    explanations = [Explanation.from_dict(data) for data in json.loads(getattr(answer, "json", "") or "[]")]
    if not explanations:
        return tuple(str(getattr(answer, "text", "")).splitlines())
    return tuple(line for explanation in reversed(explanations) for line in explanation.lines())


def _nothing() -> None:
    """The default callback."""
