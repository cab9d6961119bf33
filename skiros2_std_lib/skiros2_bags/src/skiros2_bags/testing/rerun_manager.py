"""The skill manager of a re-run: loads the skills that the recorded world model lists for a robot."""

from __future__ import annotations

import importlib
import inspect
import logging
import sys
from collections.abc import Iterator
from typing import Any

from skiros2_bags.core.errors import BagError
from skiros2_bags.testing.fake_action_clients import RecordedActions
from skiros2_bags.testing.recorded_world import change_operations
from skiros2_common.core.abstract_skill import State
from skiros2_common.core.errors import ConfigurationError
from skiros2_common.core.manager_names import runs_on
from skiros2_common.core.primitive import PrimitiveBase
from skiros2_common.core.world_element import Element
from skiros2_runs.core.frame import NodeProgress
from skiros2_runs.core.states import FAILURE, RUNNING, SUCCESS
from skiros2_skill.core.library.library import SkillLibrary
from skiros2_skill.core.tree.compound import SkillBase
from skiros2_world_model.core.local_world_model import LocalWorldModel
from skiros2_world_model.core.world_model import WorldModel

log = logging.getLogger(__name__)


class RerunManager:
    """The skills of one robot.

    :param name: of the manager's node.
    :param replaced_labels: labels of primitives that are replaced by their recorded progress.
    """

    def __init__(self, name: str, model: WorldModel, actions: RecordedActions, replaced_labels: frozenset[str]) -> None:
        self.name = name
        self.wmi = LocalWorldModel(name, model)
        self.library = SkillLibrary(self.wmi)
        self.actions = actions
        #: The task that is currently ticked.
        self.ticked: Any = None
        self._replaced_labels = replaced_labels

    @property
    def is_ticking(self) -> bool:
        return self.ticked is not None

    @property
    def robot(self) -> Element:
        """The current element of the robot.

        :raises BagError: the scene has no robot of this manager.
        """
        for robot in self.wmi.resolve_elements(Element("cora:Robot")):
            if runs_on(robot, self.name):
                found: Element = robot
                return found
        raise BagError(f"the recorded scene has no robot of the skill manager {self.name}")

    def load(self) -> None:
        """Loads the registered skills.

        :raises ConfigurationError: a skill does not exist.
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
            self.library.add(replay_primitive(cls, self) if is_replaced(cls, label, self._replaced_labels) else cls)


def _implementation(module: str, label: str) -> type:
    """Returns the class in a module that implements a skill with a label.

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
    except Exception as error:  # library code; then the class is not the wanted one
        log.debug("%s: %s", cls, error)
        return ""
    return str(getattr(skill, "_label", ""))


_STATES: dict[int, State] = {RUNNING: State.Running, SUCCESS: State.Success, FAILURE: State.Failure}


def is_replaced(cls: type, label: str, labels: frozenset[str]) -> bool:
    """Whether a primitive is replaced by its recorded progress: by its label, or because it calls a service."""
    return issubclass(cls, PrimitiveBase) and (label in labels or _calls_service(cls))


def replay_primitive(cls: type, manager: Any) -> type:
    """Returns a subclass of a primitive with the same description, whose hooks report the recorded progress.

    :param manager: the `RerunManager`.
    """

    def recorded_node(skill: Any) -> NodeProgress | None:
        recorded: NodeProgress | None = manager.ticked.recorded_node(skill) if manager.ticked is not None else None
        return recorded

    def on_start(self: Any) -> bool:
        return True

    def execute(self: Any) -> State:
        recorded = recorded_node(self)
        if recorded is None or recorded.state not in _STATES:
            return self.step()  # type: ignore[no-any-return]
        if recorded.state != RUNNING:
            for change in manager.ticked.take_due_changes():
                manager.wmi.transact(change_operations(change, manager.wmi.model.scene()))
        self._setProgress(recorded.message, recorded.code)
        return _STATES[recorded.state]

    def on_preempt(self: Any) -> State:
        recorded = recorded_node(self)
        if recorded is not None:
            self._setProgress(recorded.message, recorded.code)
        return State.Failure

    def on_end(self: Any) -> bool:
        return True

    hooks = {"onInit": on_start, "onStart": on_start, "execute": execute, "onPreempt": on_preempt, "onEnd": on_end}
    return type(cls.__name__, (cls,), {**hooks, "__module__": cls.__module__, "__abstractmethods__": frozenset()})


def _calls_service(cls: type) -> bool:
    module = sys.modules.get("skiros2_std_skills.service_client_primitive")
    return module is not None and issubclass(cls, module.PrimitiveServiceClient)
