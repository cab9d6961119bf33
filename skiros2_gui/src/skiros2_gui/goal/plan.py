"""Checks and plans goals in worker threads."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from skiros2_gui.goal.completion import Vocabulary, read_vocabulary
from skiros2_task.core.actions import condition_predicates
from skiros2_task.core.archive import Archive
from skiros2_task.core.durations import Durations
from skiros2_task.core.engine_processes import EngineProcesses
from skiros2_task.core.explain_plan import explain_plan
from skiros2_task.core.goal_reader import GoalReader
from skiros2_task.core.goal_text import GoalError, parse_goals
from skiros2_task.core.plan import PlanRow, plan_head, plan_rows
from skiros2_task.core.planner import Limits
from skiros2_task.core.planners import planner_named
from skiros2_task.core.planning import TaskPlanner, Verdict
from skiros2_task.core.preview import preview
from skiros2_task.core.world import WorldView
from skiros2_world_model.core.preview_copy import PreviewCopy

#: The folder of request archives and measured durations.
FOLDER = Path("~/.skiros/planner")
_DURATIONS = "durations.json"

#: The time limit of planning (s).
SECONDS = 60.0


@dataclass(frozen=True)
class Diagnostic:
    """Why a goal cannot be read.

    :param line, column: the position, from 1.
    """

    line: int
    column: int
    reason: str

    def position(self, text: str) -> int:
        """Returns the position as an offset in the text."""
        before = text.split("\n")[: self.line - 1]
        return min(sum(len(line) + 1 for line in before) + self.column - 1, len(text))


def check_syntax(text: str) -> Diagnostic | None:
    """Returns the first syntax error of a goal, or None. Does not block."""
    try:
        parse_goals(text)
    except GoalError as error:
        return Diagnostic(error.line, error.column, error.reason)
    return None


class GoalChecker:
    """Checks goals against a snapshot of the world. For one worker at a time.

    :raises WmException: the world model does not answer.
    """

    def __init__(self, wm: Any) -> None:
        world = WorldView(wm)
        self.vocabulary: Vocabulary = read_vocabulary(world)
        self._reader = GoalReader(world, condition_predicates(world.robots))

    def check(self, text: str) -> Diagnostic | None:
        """Returns the first error of a goal, unknown names included, or None."""
        try:
            self._reader.read(text)
        except GoalError as error:
            return Diagnostic(error.line, error.column, error.reason)
        return None


@dataclass(frozen=True)
class GoalPlan:
    """The result of planning.

    :param verdict: the value of a `Verdict`, such as `planned`.
    :param head: one line.
    :param rows: the steps.
    :param changes: the effects of each step, in lines.
    :param why: the purpose of each step, or why there is no plan, in lines.
    :param works: whether the plan works in its simulation.
    """

    goal: str
    verdict: str
    head: str
    rows: tuple[PlanRow, ...] = ()
    changes: tuple[str, ...] = ()
    why: tuple[str, ...] = ()
    works: bool = True


class GoalPlanner:
    """Plans in this process, as the task manager does. `plan` is for workers; `close` ends the engine processes.

    :param folder: for request archives and measured durations.
    """

    def __init__(self, folder: Path = FOLDER) -> None:
        self._folder = folder.expanduser()
        self._lock = threading.Lock()
        self._processes: EngineProcesses | None = None
        self._is_closed = False

    def plan(self, goal: str, wm: Any, cancelled: threading.Event, on_activity: Callable[[str], None]) -> GoalPlan:
        """Plans a goal and simulates the plan on a copy of the scene.

        :param on_activity: called in this thread with the current activity.
        :raises WmException: the world model does not answer.
        """
        durations = Durations(self._folder / _DURATIONS)
        planner = planner_named(self._engines(), durations=durations)
        tasks = TaskPlanner(wm, planner, Limits(SECONDS), Archive(self._folder), durations)
        result = tasks.plan(goal, cancelled, on_activity)
        if result.verdict is not Verdict.PLANNED or result.task is None or result.schedule is None:
            head, _, rest = result.message.partition("\n")
            notes = ["What planning could not use:", *(f"  {note}" for note in result.notes)] if result.notes else []
            return GoalPlan(goal, result.verdict.value, head, why=(*rest.splitlines(), *notes))
        on_activity("simulating the plan")
        simulation = preview(PreviewCopy(wm), result.task, result.steps, result.calls)
        return GoalPlan(
            goal,
            result.verdict.value,
            plan_head(result.schedule, result.calls),
            tuple(plan_rows(result.schedule, result.calls)),
            tuple(simulation.lines()),
            tuple(explain_plan(result.task, result.schedule.order, result.calls).lines()),
            simulation.works,
        )

    def close(self) -> None:
        """Ends the engine processes and aborts planning."""
        with self._lock:
            self._is_closed = True
            processes, self._processes = self._processes, None
        if processes is not None:
            processes.close()

    def _engines(self) -> EngineProcesses:
        with self._lock:
            if self._processes is None and not self._is_closed:
                self._processes = EngineProcesses()
            if self._processes is None:
                raise RuntimeError("the window is closed")
            return self._processes
