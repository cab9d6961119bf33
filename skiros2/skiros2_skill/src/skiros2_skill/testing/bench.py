"""A robot's skills on a world model in this process."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from contextlib import ExitStack
from pathlib import Path
from types import TracebackType
from typing import Any

from skiros2_common.core.errors import UnknownName, WrongValue
from skiros2_common.core.params import Param, ParamTypes
from skiros2_common.core.world_element import Element
from skiros2_skill.core.library.library import SkillLibrary
from skiros2_skill.core.runtime.request import SkillRequest, make_nodes
from skiros2_skill.core.tree.skill_node import SkillWrapper
from skiros2_skill.testing.bench_task import BenchTask
from skiros2_skill.testing.fake_clock import FakeClock
from skiros2_skill.testing.faults import inject, refusing
from skiros2_skill.testing.stand_in import stand_in

SCENE = "skiros:Scene-0"


class SkillBench:
    """A scene, a robot, and the skills that it has; a context manager, which takes injected failures back.

    :param scene: Turtle, as text or as a file; "" is a blank scene. Its folder is the workspace: the ontologies in it
        (`*.owl*`) are loaded.
    :param wmi: the world model, instead of a new one.
    :param robot: the robot's element; None: the scene's first `cora:Robot` by id, or a new one `skiros:robot`.
    :param clock: a period of it passes with each tick.
    :param period: of the ticks (s).
    """

    def __init__(
        self,
        scene: str | Path = "",
        *,
        wmi: Any = None,
        robot: Element | None = None,
        clock: FakeClock | None = None,
        period: float = 0.04,
    ) -> None:
        self._exit = ExitStack()
        self.clock = clock
        self.period = period
        self.wmi = wmi if wmi is not None else self._world_model(scene)
        self.library = SkillLibrary(self.wmi)
        robots = sorted(self.wmi.resolve_elements(Element("cora:Robot")), key=lambda e: e.getIdNumber())
        self.robot: Element = robot or (robots[0] if robots else self.add("cora:Robot", "skiros:robot"))

    def __enter__(self) -> SkillBench:
        return self

    def __exit__(self, kind: type | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()

    def close(self) -> None:
        """Takes all injected failures back."""
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

        :param container: what it belongs to; None: the scene.
        :param relation: how.
        :param properties: by name, without the prefix `skiros:`.
        """
        element = Element(etype, label)
        for key, value in properties.items():
            element.setProperty(f"skiros:{key}", value)
        element.addRelation(container.id if container is not None else SCENE, relation, "-1")
        self.wmi.add_element(element)
        return element

    def element(self, label: str) -> Element:
        """The element of the scene with that label, as it is now.

        :raises UnknownName: there is none.
        :raises WrongValue: there are several.
        """
        found = self.wmi.resolve_elements(Element("", label))
        if not found:
            there = ", ".join(repr(e) for e in self.wmi.get_scene_elements())
            raise UnknownName(f"no element is labelled {label!r}; there are: {there}")
        if len(found) > 1:
            raise WrongValue(f"several elements are labelled {label!r}: {found!r}")
        return found[0]  # type: ignore[no-any-return]

    def related(self, label: str, relation: str) -> list[str]:
        """The labels of what an element is related to so, or by a relation under that one, sorted."""
        names = [relation, *self.wmi.get_sub_properties(relation)]
        relations = self.element(label).getRelations("-1", names, "")
        return sorted(self.wmi.get_element(r["dst"]).label for r in relations)

    def holder(self, label: str) -> str:
        """The label of what contains an element, or has it as a part."""
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
        """Python packages that skills are taken from when they are first asked for, by type, as in a manager."""
        self.library.import_libraries(packages)
        return self

    def stand_in(self, description: Any, outcomes: Any = "S", label: str = "", **hooks: Any) -> Any:
        """Loads a skill whose ticks end as a script says, and returns its class; see `stand_in`."""
        made = stand_in(description, outcomes, label, **hooks)
        self.load(made)
        return made

    # -- failures ----------------------------------------------------------------------------------------------

    def inject(self, skill: type, hook: str, **fault: Any) -> None:
        """A hook of a skill fails, until the bench is closed; see `inject`."""
        self._exit.enter_context(inject(skill, hook, **fault))

    def refuse(self, reason: str, *, changes: bool = True, reads: bool = False) -> None:
        """The world model refuses what it is asked for, until the bench is closed; see `refusing`."""
        self._exit.enter_context(refusing(self.wmi, reason, changes=changes, reads=reads))

    # -- tasks -------------------------------------------------------------------------------------------------

    def node(self, skill: str, label: str = "", remap: Mapping[str, str] | None = None, **specify: Any) -> SkillWrapper:
        """A node for a tree.

        :param skill: the label of an implementation that is loaded, or a type: `Type`, `:Type`, `skiros:Type`.
        :param label: of the implementation, where `skill` is a type; "": any.
        :param remap: key of the skill -> key above.
        :param specify: fixed parameters.
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
        """A task of these nodes, which has not been ticked; `blackboard` holds values by key."""
        task = BenchTask(self.wmi, self.clock, self.period)
        task.root.params.addParam("Robot", self.robot, ParamTypes.Inferred)
        for key, value in blackboard.items():
            task.root.params.addParam(key, value, ParamTypes.Optional)
        task.root(*nodes)
        return task

    def run(self, *nodes: Any, ticks: int = 1000, **blackboard: Any) -> BenchTask:
        """A task of these nodes, ticked until it ends, at most so often."""
        return self.task(*nodes, **blackboard).run(ticks)

    def command(self, skill: str, label: str = "", **params: Any) -> BenchTask:
        """A task of one skill, checked as a manager checks what it is told to start; it has not been ticked.

        :param skill: its type.
        :param label: of the implementation; "": any.
        :raises SkirosError: a manager would refuse it.
        """
        return self.commands((skill, label, params))

    def commands(self, *skills: tuple[str, str, Mapping[str, Any]]) -> BenchTask:
        """Likewise, of several skills, each a type, a label and parameters, one after the other."""
        requests = [
            SkillRequest(stype, label, {k: Param(k, "", v, ParamTypes.Required) for k, v in params.items()})
            for stype, label, params in skills
        ]
        return self.task(*make_nodes(requests, self.library, self.wmi))

    # -- inside ------------------------------------------------------------------------------------------------

    def _world_model(self, scene: str | Path) -> Any:
        # Here, because Debian's own Python has no rdflib.
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
