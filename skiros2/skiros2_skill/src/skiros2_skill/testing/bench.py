"""The test bench: a robot's skills on a world model in this process."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from contextlib import ExitStack
from pathlib import Path
from types import TracebackType
from typing import Any

from skiros2_common.core.errors import UnknownName, WrongValue
from skiros2_common.core.params import Param, ParamTypes
from skiros2_common.core.signals import LocalSignals
from skiros2_common.core.world_element import Element
from skiros2_common.core.world_model_port import WorldModelPort
from skiros2_skill.core.library.library import SkillLibrary
from skiros2_skill.core.lint.linter import log_findings
from skiros2_skill.core.runtime.request import SkillRequest, make_nodes
from skiros2_skill.core.tree.skill_node import SkillWrapper
from skiros2_skill.testing.bench_task import BenchTask
from skiros2_skill.testing.fake_clock import FakeClock
from skiros2_skill.testing.faults import inject, refusing
from skiros2_skill.testing.stand_in import stand_in

SCENE = "skiros:Scene-0"


class SkillBench:
    """A scene, a robot and its skills. A context manager that reverts injected failures.

    :param scene: Turtle text or a file; "": a blank scene. The ontologies (`*.owl*`) in the file's folder are loaded.
    :param wmi: the world model; None: a new one.
    :param robot: the robot's element; None: the scene's first `cora:Robot` by id, or a new one `skiros:robot`.
    :param clock: advances by one period per tick.
    :param period: of the ticks (s).
    """

    def __init__(
        self,
        scene: str | Path = "",
        *,
        wmi: WorldModelPort | None = None,
        robot: Element | None = None,
        clock: FakeClock | None = None,
        period: float = 0.04,
    ) -> None:
        self._exit = ExitStack()
        self.clock = clock
        self.period = period
        self.wmi = wmi if wmi is not None else self._world_model(scene)
        self.library = SkillLibrary(self.wmi, log_findings)
        #: The signals of the robot; a test publishes their messages.
        self.signals = LocalSignals()
        #: The goal of which new tasks are steps; "": none.
        self.goal = ""
        robots = sorted(self.wmi.resolve_elements(Element("cora:Robot")), key=lambda e: e.getIdNumber())
        self.robot: Element = robot or (robots[0] if robots else self.add("cora:Robot", "skiros:robot"))

    def __enter__(self) -> SkillBench:
        return self

    def __exit__(self, kind: type | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()

    def close(self) -> None:
        """Reverts all injected failures."""
        self._exit.close()

    # -- the scene ---------------------------------------------------------------------------------------------

    def add(
        self,
        etype: str,
        label: str,
        container: Element | None = None,
        relation: str = "skiros:contain",
        **properties: Any,
    ) -> Element:
        """Adds an element to the scene.

        :param container: the subject of the relation; None: the scene.
        :param relation: from the container to the element.
        :param properties: by name, without the prefix `skiros:`.
        """
        element = Element(etype, label)
        for key, value in properties.items():
            element.setProperty(f"skiros:{key}", value)
        element.addRelation(container.id if container is not None else SCENE, relation, "-1")
        self.wmi.add_element(element)
        return element

    def element(self, label: str) -> Element:
        """The element with a label in its present state.

        :raises UnknownName: there is none.
        :raises WrongValue: there are several.
        """
        found = self.wmi.resolve_elements(Element("", label))
        if not found:
            existing = ", ".join(repr(e) for e in self.wmi.get_scene_elements())
            raise UnknownName(f"no element is labelled {label!r}; there are: {existing}")
        if len(found) > 1:
            raise WrongValue(f"several elements are labelled {label!r}: {found!r}")
        return found[0]

    def related(self, label: str, relation: str) -> list[str]:
        """The sorted labels of the objects of a relation or its subproperties."""
        names = [relation, *self.wmi.get_sub_properties(relation)]
        relations = self.element(label).getRelations("-1", names, "")
        return sorted(self.wmi.get_element(r["dst"]).label for r in relations)

    def holder(self, label: str) -> str:
        """The label of the element that contains an element, or has it as a part."""
        (relation,) = self.element(label).getRelations("", ["skiros:contain", "skiros:hasA"], "-1")
        return str(self.wmi.get_element(relation["src"]).label)

    # -- skills ------------------------------------------------------------------------------------------------

    def load(self, *skills: type | str) -> SkillBench:
        """Loads implementations: classes, or names of classes in the libraries (see `import_libraries`).

        :raises ConfigurationError: one cannot be loaded.
        """
        for skill in skills:
            self.library.add(skill if isinstance(skill, type) else self.library.find(skill))
        return self

    def import_libraries(self, *packages: str) -> SkillBench:
        """Imports Python packages; their skills are loaded by type when first needed, as in a manager."""
        self.library.import_libraries(packages)
        return self

    def stand_in(self, description: Any, outcomes: Any = "S", label: str = "", **hooks: Any) -> Any:
        """Loads a scripted skill and returns its class; see `stand_in`."""
        cls = stand_in(description, outcomes, label, **hooks)
        self.load(cls)
        return cls

    # -- failures ----------------------------------------------------------------------------------------------

    def inject(self, skill: type, hook: str, **fault: Any) -> None:
        """Makes a hook of a skill fail until the bench is closed; see `inject`."""
        self._exit.enter_context(inject(skill, hook, **fault))

    def refuse(self, reason: str, *, changes: bool = True, reads: bool = False) -> None:
        """Makes the world model refuse requests until the bench is closed; see `refusing`."""
        self._exit.enter_context(refusing(self.wmi, reason, changes=changes, reads=reads))

    # -- tasks -------------------------------------------------------------------------------------------------

    def node(self, skill: str, label: str = "", remap: Mapping[str, str] | None = None, **specify: Any) -> SkillWrapper:
        """Creates a node for a tree.

        :param skill: the label of a loaded implementation, or a type: `Type`, `:Type`, `skiros:Type`.
        :param label: of the implementation, if `skill` is a type; "": any.
        :param remap: key of the skill -> key of the parent.
        :param specify: specified parameters.
        """
        labelled = [i for i in self.library.implementations() if i.label == skill]
        if labelled and not label:
            skill, label = labelled[0].type, skill
        node = SkillWrapper(skill, label, self.library)
        for child_key, key in (remap or {}).items():
            node.remap(child_key, key)
        for key, values in specify.items():
            node.specifyParamDefault(key, values)
        return node

    def task(self, *nodes: Any, **blackboard: Any) -> BenchTask:
        """Creates a task of nodes, not ticked yet.

        :param blackboard: values by key.
        """
        task = BenchTask(self.wmi, self.clock, self.period, self.signals, self.goal)
        task.root.params.addParam("Robot", self.robot, ParamTypes.Inferred)
        for key, value in blackboard.items():
            task.root.params.addParam(key, value, ParamTypes.Optional)
        task.root(*nodes)
        return task

    def run(self, *nodes: Any, ticks: int = 1000, **blackboard: Any) -> BenchTask:
        """Creates a task of nodes and ticks it until it ends.

        :param ticks: maximum number of ticks.
        """
        return self.task(*nodes, **blackboard).run(ticks)

    def command(self, skill: str, label: str = "", **params: Any) -> BenchTask:
        """Creates a task of one skill, checked as by a manager, not ticked yet.

        :param skill: its type.
        :param label: of the implementation; "": any.
        :raises SkirosError: a manager would refuse it.
        """
        return self.commands((skill, label, params))

    def commands(self, *skills: tuple[str, str, Mapping[str, Any]]) -> BenchTask:
        """Same as `command`, for a sequence of skills, each given by type, label and parameters."""
        requests = [
            SkillRequest(stype, label, {k: Param(k, "", v, ParamTypes.Required) for k, v in params.items()})
            for stype, label, params in skills
        ]
        return self.task(*make_nodes(requests, self.library, self.wmi))

    # -- internal ----------------------------------------------------------------------------------------------

    def _world_model(self, scene: str | Path) -> Any:
        # Imported here, because Debian's Python has no rdflib.
        from skiros2_world_model.core.local_world_model import LocalWorldModel, source_ontologies
        from skiros2_world_model.core.world_model import WorldModel

        file = Path(scene) if isinstance(scene, Path) else None
        if file is None and scene:
            folder = self._exit.enter_context(tempfile.TemporaryDirectory())
            file = Path(folder) / "scene.ttl"
            file.write_text(str(scene))
        model = WorldModel(source_ontologies(), file.parent if file is not None else None)
        if file is not None:
            model.load_initial(file.name)
        return LocalWorldModel("test", model)
