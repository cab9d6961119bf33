"""A scene of a package of skills, with the robots and their skills as skill managers would enter them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path

from skiros2_skill.core.library.library import SkillLibrary
from skiros2_skill.ros.registration import Registration
from skiros2_task.core.engines import EngineProcesses, Limits
from skiros2_task.core.planners import engine_planner
from skiros2_task.core.planning import TaskPlanner, Verdict
from skiros2_world_model.core.local_world_model import LocalWorldModel
from skiros2_world_model.core.world_model import WorldModel
from support.ros import ROOT


def scene_with_skills(package: str, scene: Path, robots: Mapping[str, Sequence[str]]) -> LocalWorldModel:
    """Loads the scene and enters the robots.

    :param package: with the skills.
    :param robots: the skills of each, by class; they are of the package, or standard ones.
    """
    model = WorldModel(ROOT / "ontologies", scene.parent)
    model.load_initial(scene.name)
    wmi = LocalWorldModel("test", model)
    for robot, skills in robots.items():
        library = SkillLibrary(wmi)
        library.import_libraries(["skiros2_std_skills", package])
        library.load(skills)
        registration = Registration(wmi, "demo", robot, f"/{robot}")
        registration.register_robot()
        registration.register_skills(library.implementations())
    return wmi


@contextmanager
def planner_of(wmi: LocalWorldModel) -> Iterator[TaskPlanner]:
    """Plans for the robots of the scene."""
    processes = EngineProcesses()
    try:
        yield TaskPlanner(wmi, engine_planner(processes), Limits(30.0))
    finally:
        processes.close()


def steps(planner: TaskPlanner, goal: str) -> list[str]:
    """The labels of the skills in the plan for a goal; that there is one is asserted."""
    result = planner.plan(goal)
    assert result.verdict is Verdict.PLANNED, result.message
    return [call.label for call in result.calls]
