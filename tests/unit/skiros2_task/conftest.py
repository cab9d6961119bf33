"""A planner that tests share: its process is loaded once."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import pytest

from skiros2_task.core.engine_processes import EngineProcesses
from skiros2_task.core.planner import Limits
from skiros2_task.core.task_planner import PlanningResult, TaskPlanner
from skiros2_task.core.up_planner import UpPlanner
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
    """Plans a goal in a world."""

    def make(world: PlanningWorld, goal: str) -> PlanningResult:
        return TaskPlanner(world.wm, UpPlanner(processes), Limits(seconds=30.0)).plan(goal)

    return make
