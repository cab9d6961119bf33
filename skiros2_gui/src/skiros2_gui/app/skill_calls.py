"""Starts skills for buttons of the window, and follows their tasks."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from skiros2_common.core.names import local_name
from skiros2_gui.app.events import ManagersChanged, TaskStarted
from skiros2_gui.app.problems import error_text
from skiros2_gui.app.system import Manager
from skiros2_gui.app.window import Window
from skiros2_runs.core.states import TaskState
from skiros2_runs.core.task_run import TaskRun
from skiros2_skill.client.description import Skill, Step


class SkillCalls:
    """One call at a time for each skill of a manager. Used in the window's thread.

    :param on_change: called when offered skills became known, and when a start was accepted or refused.
    """

    def __init__(self, window: Window, on_change: Callable[[], None]) -> None:
        self._window = window
        self._on_change = on_change
        self._skills: dict[str, Sequence[Skill] | None] = {}
        self._starting: set[tuple[str, str]] = set()
        # of a manager and skill type: the task id, and when it was started (s since the epoch)
        self._called: dict[tuple[str, str], tuple[int, float]] = {}
        self._refused: dict[tuple[str, str], str] = {}
        window.subscribe(ManagersChanged, lambda _: self._forget())

    def skill(self, manager: str, skill_type: str) -> Skill | None:
        """Returns an implementation that a manager offers; None if it offers none, or its skills are being read."""
        if manager not in self._skills:
            self._read(manager)
        return next((s for s in self._skills.get(manager) or () if s.type == skill_type), None)

    def obstacle(self, manager: str, skill_type: str) -> str:
        """Describes why a skill cannot be started; "" if it can."""
        if manager not in self._window.system.managers:
            return f"{manager} is not running" if manager else "No robot is running"
        name = local_name(skill_type)
        if self.skill(manager, skill_type) is not None:
            return f"{manager} is running {name}" if self.is_running(manager, skill_type) else ""
        if self._skills.get(manager) is None:
            return f"The skills of {manager} are being read"
        return f"{manager} does not offer the skill {name}; add it to its skill list"

    def start(self, manager: str, skill_type: str, values: Mapping[str, Any]) -> None:
        """Starts a skill; does nothing while there is an obstacle.

        :param values: in JSON form, by parameter; the others keep their defaults.
        """
        client, skill = self._window.system.managers.get(manager), self.skill(manager, skill_type)
        key = manager, skill_type
        if client is None or skill is None or self.obstacle(manager, skill_type):
            return
        params = [skill.parameters[name].wire([value]) for name, value in values.items()]
        self._starting.add(key)
        self._refused.pop(key, None)
        self._called.pop(key, None)
        self._window.jobs.run(
            lambda: _start(client, Step(skill.type, skill.label, params)),
            lambda answer: self._started(key, *answer),
            lambda error: self._fail(key, error),
            activity=f"starting {skill.label} of {manager}",
        )
        self._on_change()

    def task(self, manager: str, skill_type: str) -> TaskRun | None:
        """Returns the task of the last call of a skill; None if there is none."""
        called = self._called.get((manager, skill_type))
        return self._window.tasks.find(manager, called[0]) if called is not None else None

    def running(self, manager: str, skill_type: str) -> TaskRun | None:
        """Returns a running task of a manager that has started with a skill, by whatever client; None for none."""
        return next(
            (
                run
                for run in reversed(list(self._window.tasks.runs))
                if run.robot == manager
                and not run.is_finished
                and len(run.latest.shape) > 1
                and run.latest.shape.type(1) == skill_type
            ),
            None,
        )

    def is_running(self, manager: str, skill_type: str) -> bool:
        """Returns whether a skill is being started or running."""
        return (manager, skill_type) in self._starting or self.running(manager, skill_type) is not None

    def is_recent(self, skill_type: str, seconds: float) -> bool:
        """Returns whether a call of a skill is running, or has ended within a time (s)."""
        if any(kind == skill_type for _, kind in self._starting):
            return True
        now = time.time()
        for key, (_, started) in self._called.items():
            run = self.task(*key)  # None before its first progress was received
            is_running = run is not None and not run.is_finished
            if key[1] == skill_type and (is_running or now - (run.latest.time if run else started) < seconds):
                return True
        return False

    def failure(self, manager: str, skill_type: str) -> str:
        """Describes why the last call of a skill failed; "" if it has not."""
        run = self.task(manager, skill_type)
        if run is not None and run.state in (TaskState.FAILED, TaskState.LOST):
            return self._window.tasks.message(run)
        return self._refused.get((manager, skill_type), "")

    def _forget(self) -> None:
        self._skills.clear()  # a manager may have restarted with other skills
        self._on_change()

    def _read(self, manager: str) -> None:
        client = self._window.system.managers.get(manager)
        if client is None:
            return
        self._skills[manager] = None
        self._window.jobs.run(
            client.read_skills,
            lambda skills: self._take(manager, skills),
            lambda error: self._read_failed(manager, error),
        )

    def _take(self, manager: str, skills: Sequence[Skill]) -> None:
        self._skills[manager] = skills
        self._on_change()

    def _read_failed(self, manager: str, error: Exception) -> None:
        self._skills.pop(manager, None)  # read again at the next question
        self._window.problems.report(f"reading the skills of {manager}", error)

    def _started(self, key: tuple[str, str], task_id: int, nodes: Sequence[Any], stamp: float) -> None:
        self._starting.discard(key)
        self._called[key] = task_id, stamp
        self._window.tasks.started(key[0], task_id, nodes, stamp)
        self._window.publish(TaskStarted(key[0], task_id))
        self._on_change()

    def _fail(self, key: tuple[str, str], error: Exception) -> None:
        self._starting.discard(key)
        self._refused[key] = error_text(error)
        self._on_change()


def _start(manager: Manager, step: Step) -> tuple[int, Sequence[Any], float]:
    """Starts a task and reads it; in a worker."""
    task_id = manager.command("start", -1, [step])
    stamp = time.time()
    return task_id, next(iter(manager.read_tasks(task_id)), ()), stamp
