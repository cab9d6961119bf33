"""Runs skills of whole libraries on a world model in this process, as a skill manager does, tick by tick."""

from __future__ import annotations

from typing import Any

from skiros2_common.core.abstract_skill import State
from skiros2_common.core.params import Param, ParamTypes
from skiros2_common.core.world_element import Element
from skiros2_skill.core.library import SkillLibrary
from skiros2_skill.core.request import SkillRequest, make_nodes
from skiros2_skill.core.task import Task


class SkillBench:
    """A robot with skills.

    :param wmi: the world model.
    :param robot: the robot's element.
    :param packages: the libraries. Skills are loaded when they are first asked for, or by `library.load`.
    """

    def __init__(self, wmi: Any, robot: Element, *packages: str) -> None:
        self.wmi = wmi
        self.robot = robot
        self.library = SkillLibrary(wmi)
        self.library.import_libraries(packages)

    def task(self, *skills: tuple[str, dict[str, Any]]) -> Task:
        """A task of skills, each a type and its parameters."""
        requests = [
            SkillRequest(stype, "", {k: Param(k, "", v, ParamTypes.Required) for k, v in params.items()})
            for stype, params in skills
        ]
        task = Task(0, self.wmi, "test")
        task.root.params.addParam("Robot", self.robot, ParamTypes.Inferred)
        task.root(*make_nodes(requests, self.library, self.wmi))
        return task

    def run(self, stype: str, ticks: int = 1000, **params: Any) -> Any:
        """Ticks a task of one skill until it ends, at most so often. Returns the skill's node."""
        task = self.task((stype, params))
        for _ in range(ticks):
            if task.tick() is not State.Running:
                break
        return task.root.children[0]

    def element(self, label: str) -> Element:
        """The element with that label, as it is now."""
        (found,) = (e for e in self.wmi.get_scene() if e.label == label)
        return found

    def holder(self, label: str) -> str:
        """The label of what contains the element with that label."""
        (relation,) = self.element(label).getRelations("", ["skiros:contain", "skiros:hasA"], "-1")
        return str(self.wmi.get_element(relation["src"]).label)
