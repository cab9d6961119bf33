"""Shared fixtures: a planner whose plans and PDDL are checked."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from skiros2_task.core.engines import EngineProcesses, Limits
from skiros2_task.core.planners import engine_planner
from skiros2_task.core.planning import PlanningResult, TaskPlanner, Verdict
from skiros2_task.core.preview import preview
from skiros2_world_model.core.preview_copy import PreviewCopy
from support.plan_checks import CheckedPlanner, carry_out, is_known
from support.planning_world import PlanningWorld

Plan = Callable[[PlanningWorld, str], PlanningResult]


@pytest.fixture(scope="session")
def processes() -> Iterator[EngineProcesses]:
    """Where engines run, for the whole session."""
    processes = EngineProcesses()
    yield processes
    processes.close()


@pytest.fixture
def plan(processes: EngineProcesses) -> Plan:
    """Plans a goal in a world, and carries the plan out on a copy of it: the goal has to hold then."""
    planner = CheckedPlanner(engine_planner(processes))

    def make(world: PlanningWorld, goal: str) -> PlanningResult:
        result = TaskPlanner(world.wm, planner, Limits(seconds=30.0)).plan(goal)
        if result.verdict is Verdict.PLANNED and is_known(world, result.calls):
            after = carry_out(world, result.calls)
            assert TaskPlanner(after.wm, planner, Limits()).plan(goal).verdict is Verdict.NOTHING_TO_DO
        if result.verdict is Verdict.PLANNED:
            assert result.plan is not None
            tried = preview(PreviewCopy(world.wm), result.plan)
            assert tried.works, str(tried)
        return result

    return make


@pytest.fixture
def own_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The test's working folder, and the one for temporary files."""
    (tmp_path / "work").mkdir()
    (tmp_path / "tmp").mkdir()
    monkeypatch.chdir(tmp_path / "work")
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "tmp"))
    return tmp_path
