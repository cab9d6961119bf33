"""A skill manager as a re-run has it: the robot's skills, as the recording's world model lists them."""

from __future__ import annotations

import importlib
import inspect
import logging
from collections.abc import Iterator
from typing import Any

from skiros2_bags.core.errors import BagError
from skiros2_bags.testing.action_stand_ins import Actions
from skiros2_bags.testing.played_skill import is_played, played
from skiros2_common.core.errors import ConfigurationError
from skiros2_common.core.primitive import PrimitiveBase
from skiros2_common.core.world_element import Element
from skiros2_skill.core.library.library import SkillLibrary
from skiros2_skill.core.manager_names import runs_on
from skiros2_skill.core.tree.compound import SkillBase
from skiros2_world_model.core.local_world_model import LocalWorldModel
from skiros2_world_model.core.world_model import WorldModel

log = logging.getLogger(__name__)


class RerunManager:
    """The skills of one robot.

    :param name: of the manager's node.
    :param played_labels: of primitives that do what was told of them.
    """

    def __init__(self, name: str, model: WorldModel, actions: Actions, played_labels: frozenset[str]) -> None:
        self.name = name
        self.wmi = LocalWorldModel(name, model)
        self.library = SkillLibrary(self.wmi)
        self.actions = actions
        #: The task that is being ticked.
        self.ticked: Any = None
        self._played = played_labels

    @property
    def is_ticking(self) -> bool:
        return self.ticked is not None

    @property
    def robot(self) -> Element:
        """The robot's element as it is now.

        :raises BagError: the scene has none for this manager.
        """
        for robot in self.wmi.resolve_elements(Element("cora:Robot")):
            if runs_on(robot, self.name):
                found: Element = robot
                return found
        raise BagError(f"the recorded scene has no robot of the skill manager {self.name}")

    def load(self) -> None:
        """Loads what the manager has registered.

        :raises ConfigurationError: a skill is not there any more.
        """
        listed = []
        for relation in self.wmi.get_relations(self.robot.id, "skiros:hasSkill", ""):
            skill = self.wmi.get_element(relation["dst"])
            listed.append((skill.getIdNumber(), str(skill.value_of("skiros:PythonModule")), skill.label))
        if not listed:
            raise BagError(f"the recorded scene lists no skills of {self.name}")
        self.library.import_libraries(sorted({module.partition(".")[0] for _, module, _ in listed}))
        for _, module, label in sorted(listed):
            cls = _implementation(module, label)
            self.library.add(played(cls, self) if is_played(cls, label, self._played) else cls)


def _implementation(module: str, label: str) -> type:
    """The class in a module that implements a skill under a label.

    :raises ConfigurationError: there is none.
    """
    try:
        found = importlib.import_module(module)
    except ImportError as error:
        raise ConfigurationError(f"skill {label}: module {module} cannot be imported: {error}") from error
    classes = list(_skills(found))
    for cls in sorted(classes, key=lambda c: c.__name__ != label):
        if cls.__name__ == label or _label_of(cls) == label:
            return cls
    names = ", ".join(c.__name__ for c in classes) or "none"
    raise ConfigurationError(f"skill {label}: module {module} has no implementation of that label; it has: {names}")


def _skills(module: Any) -> Iterator[type]:
    for _, cls in inspect.getmembers(module, inspect.isclass):
        is_own = cls.__module__ == module.__name__
        if is_own and issubclass(cls, SkillBase | PrimitiveBase) and not inspect.isabstract(cls):
            yield cls


def _label_of(cls: type) -> str:
    try:
        skill = cls()
        skill.createDescription()
    except Exception as error:  # code of a library; this one is not it
        log.debug("%s: %s", cls, error)
        return ""
    return str(getattr(skill, "_label", ""))
