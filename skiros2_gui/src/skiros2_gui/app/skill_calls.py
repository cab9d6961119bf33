"""Starts skills for buttons of the window, and follows their tasks."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from skiros2_gui.app.events import ManagersChanged, TaskStarted
from skiros2_gui.app.problems import error_text
from skiros2_gui.app.system import Manager
from skiros2_gui.app.tasks import message_text
from skiros2_gui.app.window import Window
from skiros2_runs.core.states import TaskState
from skiros2_runs.core.task_run import TaskRun
from skiros2_skill.client.description import Skill, Step


class SkillCalls:
    """One call at a time for each manager. Used in the window's thread.

    :param on_change: called when offered skills became known, and when a start was refused.
    """

    def __init__(self, window: Window, on_change: Callable[[], None]) -> None:
        self._window = window
        self._on_change = on_change
        self._skills: dict[str, Sequence[Skill] | None] = {}
        self._starting: dict[str, str] = {}  # manager -> activity
        self._called: dict[str, tuple[str, int]] = {}  # manager -> activity and task id
        self._refused: dict[str, str] = {}
        window.subscribe(ManagersChanged, lambda _: self._forget())

    def skill(self, manager: str, skill_type: str) -> Skill | None:
        """Returns an implementation that a manager offers; None if it offers none, or its skills are being read."""
        if manager not in self._skills:
            self._read(manager)
        return next((s for s in self._skills.get(manager) or () if s.type == skill_type), None)

    def missing(self, manager: str, skill_type: str) -> str:
        """Describes why a skill cannot be started; "" if it can."""
        if manager not in self._window.system.managers:
            return f"{manager} is not running" if manager else "No robot is running"
        if self.skill(manager, skill_type) is not None:
            running = self.activity(manager)
            return f"{manager} is {running}" if running else ""
        if self._skills.get(manager) is None:
            return f"The skills of {manager} are being read"
        return f"{manager} does not offer the skill {skill_type}; add it to its skill list"

    def start(self, manager: str, skill: Skill, values: Mapping[str, Any], activity: str) -> None:
        """Starts a skill.

        :param values: in JSON form, by parameter; the others keep their defaults.
        :param activity: describes the call: "recovering".
        """
        client = self._window.system.managers.get(manager)
        if client is None:
            self._refused[manager] = f"{manager} is not running"
            self._on_change()
            return
        params = [skill.parameters[key].wire([value]) for key, value in values.items()]
        self._starting[manager] = activity
        self._refused.pop(manager, None)
        self._window.jobs.run(
            lambda: _start(client, Step(skill.type, skill.label, params)),
            lambda answer: self._started(manager, activity, *answer),
            lambda error: self._fail(manager, error),
            activity=f"{activity}: {manager}",
        )
        self._on_change()

    def activity(self, manager: str) -> str:
        """Describes the running call of a manager; "" if none is running."""
        run = self.task(manager)
        if manager in self._starting:
            return self._starting[manager]
        return self._called[manager][0] if run is not None and not run.is_finished else ""

    def task(self, manager: str) -> TaskRun | None:
        """Returns the task of the last call of a manager; None if there is none."""
        called = self._called.get(manager)
        return self._window.tasks.find(manager, called[1]) if called is not None else None

    def failure(self, manager: str) -> str:
        """Describes why the last call of a manager failed; "" if it has not."""
        if manager in self._refused:
            return self._refused[manager]
        run = self.task(manager)
        return message_text(run) if run is not None and run.state in (TaskState.FAILED, TaskState.LOST) else ""

    def _forget(self) -> None:
        self._skills.clear()  # a manager may have restarted with other skills
        self._on_change()

    def _read(self, manager: str) -> None:
        client = self._window.system.managers.get(manager)
        if client is None:
            return
        self._skills[manager] = None
        self._window.jobs.run(
            client.read_skills, lambda skills: self._take(manager, skills), lambda error: self._fail(manager, error)
        )

    def _take(self, manager: str, skills: Sequence[Skill]) -> None:
        self._skills[manager] = skills
        self._on_change()

    def _started(self, manager: str, activity: str, task_id: int, nodes: Sequence[Any], stamp: float) -> None:
        self._starting.pop(manager, None)
        self._called[manager] = activity, task_id
        self._window.tasks.started(manager, task_id, nodes, stamp)
        self._window.publish(TaskStarted(manager, task_id))
        self._on_change()

    def _fail(self, manager: str, error: Exception) -> None:
        self._starting.pop(manager, None)
        self._refused[manager] = error_text(error)
        self._on_change()


def _start(manager: Manager, step: Step) -> tuple[int, Sequence[Any], float]:
    """Starts a task and reads it; in a worker."""
    task_id = manager.command("start", -1, [step])
    stamp = time.time()
    return task_id, next(iter(manager.read_tasks(task_id)), ()), stamp
