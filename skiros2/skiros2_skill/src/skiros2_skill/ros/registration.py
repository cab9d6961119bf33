"""Registers the robot of a skill manager and its skills in the world model."""

from __future__ import annotations

import inspect
import logging
import re
from collections.abc import Callable, Iterable, Sequence

from skiros2_common.core.element_content import relation_dict
from skiros2_common.core.errors import ConfigurationError, SkirosError
from skiros2_common.core.manager_names import SKILL_MGR, bare_name, runs_on
from skiros2_common.core.names import DEFAULT_PREFIX, full_name
from skiros2_common.core.operations import CleanupAction, Remove
from skiros2_common.core.property import Property
from skiros2_common.core.skill_description import DEVICE_IDLE, DEVICE_STATE, SkillDescription
from skiros2_common.core.world_element import Element
from skiros2_common.core.world_model_port import WorldModelPort
from skiros2_skill.core.engine.devices import DEVICE_HOLDER, release_stale_devices
from skiros2_skill.core.library.library import Implementation

log = logging.getLogger(__name__)

#: The private parameter of a manager's node with the id of the robot that it has registered.
ROBOT_PARAMETER = "robot_id"

SCENE_ID = "skiros:Scene-0"
SKILL_CHILDREN = ["skiros:hasParam", "skiros:hasPreCondition", "skiros:hasHoldCondition", "skiros:hasPostCondition"]


class Registration:
    """Registers one manager: its robot, and its skills under `skiros:hasSkill`.

    :param robot_name: the manager's name without slash; with the prefix, the label of the robot's template.
    :param manager: the manager's node name, with its slash.
    :param on_robot: called with the id of the robot after each registration.
    :param on_skills: called with the skills after each registration of them.
    """

    def __init__(
        self,
        wmi: WorldModelPort,
        prefix: str,
        robot_name: str,
        manager: str,
        on_robot: Callable[[str], None] = lambda _: None,
        on_skills: Callable[[Sequence[Implementation]], None] = lambda _: None,
    ) -> None:
        self._wmi = wmi
        self._on_robot = on_robot
        self._on_skills = on_skills
        self._label = f"{prefix or DEFAULT_PREFIX}:{robot_name}"
        self._manager = manager
        self.robot_id = ""
        self._skills: dict[str, tuple[str, str]] | None = None  # registered skills: class and label by id

    @property
    def robot(self) -> Element:
        """The element of the robot in its present state."""
        found: Element = self._wmi.get_element(self.robot_id)
        return found

    def register(self, implementations: Iterable[Implementation]) -> bool:
        """Registers robot and skills if the world model does not have them. Returns whether it did.

        Also leaves the last will of the manager, and releases devices that a former process has left locked.

        :raises ConfigurationError: the robot can be neither found nor instantiated.
        :raises WmException: the world model refuses, or does not answer.
        """
        self._wmi.set_last_will(self._will())
        self._wmi.catch_up()
        if self.is_registered():
            return False
        release_stale_devices(self._wmi)
        self.register_robot()
        self.register_skills(implementations)
        self._on_robot(self.robot_id)
        return True

    def unregister(self) -> None:
        """Removes the skills and the last will.

        :raises WmException: the world model refuses, or does not answer; it executes the last will then.
        """
        self.remove_skills()
        self._wmi.set_last_will([])

    def register_robot(self) -> None:
        """Finds the robot in the scene or instantiates its template, and places it at its start location.

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
        """Registers the skills, all at once; those of a former process are replaced."""
        self.remove_skills()
        self._skills = None
        elements, implementations = [], list(implementations)
        for implementation in implementations:
            self._declare_classes(implementation)
            element = implementation.declared.toElement()
            element.setProperty("skiros:PythonModule", implementation.module)
            element.setProperty("rdfs:comment", purpose_of(type(implementation.declared.skill_description)))
            element.addRelation(self.robot_id, "skiros:hasSkill", "-1")
            elements.append(element)
        self._wmi.add_elements(elements)
        self._skills = {element.id: (element.type, element.label) for element in elements}
        self._on_skills(implementations)

    def is_registered(self) -> bool:
        """Whether the world model has the robot with this manager and all registered skills."""
        robot = self._wmi.find_element(self.robot_id)
        if robot is None or not runs_on(robot, self._manager):
            return False
        ids = (relation["dst"] for relation in self._wmi.get_relations(self.robot_id, "skiros:hasSkill", ""))
        found = map(self._wmi.find_element, ids)
        return {e.id: (e.type, e.label) for e in found if e is not None} == self._skills

    def remove_skills(self) -> None:
        """Removes all skills of the robot at once, with their parameters and conditions."""
        relations = self._wmi.get_relations(self.robot_id, "skiros:hasSkill", "")
        # The last will of a former process may have just removed some.
        ids = [r["dst"] for r in relations if self._wmi.find_element(r["dst"]) is not None]
        if ids:
            self._wmi.transact([Remove(eid, True, "skiros:skillProperty") for eid in ids])

    def _will(self) -> list[CleanupAction]:
        """The last will: removes the skills and releases the devices of the manager."""
        free = {
            DEVICE_STATE: Property(DEVICE_STATE, DEVICE_IDLE),
            DEVICE_HOLDER: Property(DEVICE_HOLDER, str),
        }
        return [
            CleanupAction(DEVICE_HOLDER, self._manager, properties=free),
            *(
                CleanupAction(SKILL_MGR, name, "skiros:hasSkill", "skiros:skillProperty")
                for name in (bare_name(self._manager), self._manager)  # scenes have both forms
            ),
        ]

    def _instantiate(self) -> Element:
        relation = relation_dict(SCENE_ID, "skiros:contain", "-1")
        try:
            robot: Element = self._wmi.instanciate(self._label, True, [relation])
        except SkirosError as error:
            raise ConfigurationError(
                f"robot {self._label}: the scene has no cora:Robot with that label, and it cannot be made from a "
                f"template: {error}"
            ) from error
        return robot

    def _place(self) -> None:
        """Places a robot without location at its start location, which is instantiated if needed."""
        if self._wmi.get_relations(self.robot_id, "skiros:at", ""):
            return
        for start in self._wmi.get_relations(self.robot_id, "skiros:hasStartLocation", ""):
            location = self._location(start["dst"])
            if location is not None:
                self._wmi.set_relation(self.robot_id, "skiros:at", location, True)
                return
        log.info("%s has no start location and is not placed", self.robot_id)

    def _location(self, name: str) -> str | None:
        """The id of the element of a start location, which is given by id or template; None when it cannot be found."""
        if self._wmi.find_element(name) is not None:
            return name
        found = self._wmi.resolve_elements(Element("sumo:Object", name))
        if found:
            return str(found[0].id)
        relation = relation_dict(SCENE_ID, "skiros:contain", "-1")
        try:
            return str(self._wmi.instanciate(name, False, [relation]).id)
        except SkirosError as error:
            log.warning("%s: start location %s cannot be made: %s", self._label, name, error)
            return None

    def _declare_classes(self, implementation: Implementation) -> None:
        """Adds the classes `skiros:Skill` > package > modules > type to the ontology."""
        description = implementation.declared.skill_description
        parent = "skiros:Skill"
        for part in type(description).__module__.split("."):
            name = full_name(_camel_case(part))
            if name != implementation.type:  # a module pick.py with a skill Pick
                self._wmi.add_class(name, parent)
                parent = name
        self._wmi.add_class(implementation.type, parent)


def purpose_of(described: type) -> str:
    """The first paragraph of the class's own docstring, on one line."""
    doc = described.__doc__ if described is not SkillDescription else ""
    return " ".join(inspect.cleandoc(doc or "").partition("\n\n")[0].split())


def _camel_case(name: str) -> str:
    return "".join(part.capitalize() for part in re.split(r"[^0-9A-Za-z]+", name) if part)
