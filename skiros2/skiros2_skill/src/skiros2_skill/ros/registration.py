"""The robot of a skill manager and its skills, as the world model has them."""

from __future__ import annotations

import inspect
import logging
import re
from collections.abc import Iterable
from typing import Any

from skiros2_common.core.errors import ConfigurationError, SkirosError
from skiros2_common.core.names import DEFAULT_PREFIX, full_name
from skiros2_common.core.property import Property
from skiros2_common.core.skill_description import DEVICE_IDLE, DEVICE_STATE, SkillDescription
from skiros2_common.core.world_element import Element
from skiros2_skill.core.devices import DEVICE_HOLDER, free_former_devices
from skiros2_skill.core.library import Implementation
from skiros2_skill.core.manager_names import SKILL_MGR, bare_name, runs_on
from skiros2_world_model.core.last_will import CleanupAction

log = logging.getLogger(__name__)

SCENE_ID = "skiros:Scene-0"
SKILL_CHILDREN = ["skiros:hasParam", "skiros:hasPreCondition", "skiros:hasHoldCondition", "skiros:hasPostCondition"]


class Registration:
    """Keeps the world model's picture of one manager: its robot, and its skills under `skiros:hasSkill`.

    :param wmi: the world model.
    :param robot_name: the manager's name without slash; with the prefix, the label of the robot's template.
    :param manager: the manager's node name, with its slash.
    """

    def __init__(self, wmi: Any, prefix: str, robot_name: str, manager: str) -> None:
        self._wmi = wmi
        self._label = f"{prefix or DEFAULT_PREFIX}:{robot_name}"
        self._manager = manager
        self.robot_id = ""
        self._skills: dict[str, tuple[str, str]] | None = None  # all that were added: class and label by id

    @property
    def robot(self) -> Element:
        """The robot as it is now."""
        found: Element = self._wmi.get_element(self.robot_id)
        return found

    def enter(self, implementations: Iterable[Implementation]) -> bool:
        """Enters robot and skills where the world model has not got them, or not any more. Returns whether it had not.

        Before that it leaves what is to be done when the manager is gone; what a former life of it has left is done.

        :raises ConfigurationError: the robot cannot be found or made.
        :raises WmException: the world model refuses, or does not answer.
        """
        self._wmi.set_last_will(self._will())
        self._wmi.catch_up()
        if self.stands():
            return False
        free_former_devices(self._wmi)
        self.register_robot()
        self.register_skills(implementations)
        return True

    def leave(self) -> None:
        """Takes the skills away, and with them the last will.

        :raises WmException: the world model refuses, or does not answer; the will stands then.
        """
        self.remove_skills()
        self._wmi.set_last_will([])

    def register_robot(self) -> None:
        """Finds the robot in the scene, or makes it from its template, and places it.

        :raises ConfigurationError: the scene has no such robot and the ontology no such template.
        """
        found = self._wmi.resolve_elements(Element("cora:Robot", self._label))
        robot = found[0] if found else self._instantiate()
        if len(found) > 1:
            log.warning("%s robots are labelled %s; taking %s", len(found), self._label, robot.id)
        robot.setProperty(SKILL_MGR, bare_name(self._manager))
        self._wmi.update_element_properties(robot)
        self.robot_id = robot.id
        self._place()

    def register_skills(self, implementations: Iterable[Implementation]) -> None:
        """Adds the skills in the place of what an earlier life of the manager left."""
        self.remove_skills()
        self._skills = None
        added = {}
        for implementation in implementations:
            self._declare_classes(implementation)
            element = implementation.declared.toElement()
            element.setProperty("skiros:PythonModule", implementation.module)
            element.setProperty("rdfs:comment", _first_sentences(type(implementation.declared._description)))
            element.addRelation(self.robot_id, "skiros:hasSkill", "-1")
            self._wmi.add_element(element)
            added[element.id] = (element.type, element.label)
        self._skills = added

    def stands(self) -> bool:
        """Whether the world model has the robot, as this manager's, with all the skills that were added."""
        robot = self._wmi.find_element(self.robot_id)
        if robot is None or not runs_on(robot, self._manager):
            return False
        ids = (relation["dst"] for relation in self._wmi.get_relations(self.robot_id, "skiros:hasSkill", ""))
        found = map(self._wmi.find_element, ids)
        return {e.id: (e.type, e.label) for e in found if e is not None} == self._skills

    def remove_skills(self) -> None:
        """Takes away all skills of the robot, with their parameters and conditions."""
        for relation in self._wmi.get_relations(self.robot_id, "skiros:hasSkill", ""):
            skill = self._wmi.find_element(relation["dst"])
            if skill is not None:  # else the last will of an earlier life has just taken it
                self._wmi.remove_element(skill, True, "skiros:skillProperty")

    def _will(self) -> list[CleanupAction]:
        """What is to be done when the manager is gone: its skills go, its devices are free."""
        free = {
            DEVICE_STATE: Property(DEVICE_STATE, DEVICE_IDLE),
            DEVICE_HOLDER: Property(DEVICE_HOLDER, str),
        }
        return [
            CleanupAction(DEVICE_HOLDER, self._manager, properties=free),
            *(
                CleanupAction(SKILL_MGR, name, "skiros:hasSkill", "skiros:skillProperty")
                for name in (bare_name(self._manager), self._manager)  # scenes hold both
            ),
        ]

    def _instantiate(self) -> Element:
        relation = {"src": SCENE_ID, "type": "skiros:contain", "dst": "-1", "state": True, "abstract": False}
        try:
            robot: Element = self._wmi.instanciate(self._label, True, [relation])
        except SkirosError as error:
            raise ConfigurationError(
                f"robot {self._label}: the scene has no cora:Robot with that label, and it cannot be made from a "
                f"template: {error}"
            ) from error
        return robot

    def _place(self) -> None:
        """Puts a robot that is nowhere at its start location, which is made from its template where needed."""
        if self._wmi.get_relations(self.robot_id, "skiros:at", ""):
            return
        for start in self._wmi.get_relations(self.robot_id, "skiros:hasStartLocation", ""):
            location = self._location(start["dst"])
            if location is not None:
                self._wmi.set_relation(self.robot_id, "skiros:at", location, True)
                return
        log.info("%s has no start location; it is placed nowhere", self.robot_id)

    def _location(self, name: str) -> str | None:
        """The id of the scene's element for a start location: an id, or a template."""
        if self._wmi.find_element(name) is not None:
            return name
        found = self._wmi.resolve_elements(Element("sumo:Object", name))
        if found:
            return str(found[0].id)
        relation = {"src": SCENE_ID, "type": "skiros:contain", "dst": "-1", "state": True, "abstract": False}
        try:
            return str(self._wmi.instanciate(name, False, [relation]).id)
        except SkirosError as error:
            log.warning("%s: start location %s cannot be made: %s", self._label, name, error)
            return None

    def _declare_classes(self, implementation: Implementation) -> None:
        """Declares `skiros:Skill` > package > modules > type, where the ontology does not know the type."""
        description = implementation.declared._description
        parent = "skiros:Skill"
        for part in type(description).__module__.split("."):
            name = full_name(_camel_case(part))
            if name != implementation.type:  # a module pick.py with a skill Pick
                self._wmi.add_class(name, parent)
                parent = name
        self._wmi.add_class(implementation.type, parent)


def _first_sentences(described: type) -> str:
    """The first paragraph of what a class says of itself, on one line; not what its bases say."""
    said = described.__doc__ if described is not SkillDescription else ""
    return " ".join(inspect.cleandoc(said or "").partition("\n\n")[0].split())


def _camel_case(name: str) -> str:
    return "".join(part.capitalize() for part in re.split(r"[^0-9A-Za-z]+", name) if part)
