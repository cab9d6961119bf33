"""Random programs on the engine and on a reference model of the rules by which values reach skills: the same element is
seen by each skill at each look, and the same is in the world model at the end."""

from __future__ import annotations

import os
import random
from typing import Any

import pytest

from compatibility.test_blackboard import describe
from skiros2_common.core.params import Param, ParamHandler, ParamTypes
from skiros2_common.core.primitive import PrimitiveBase
from skiros2_common.core.world_element import Element
from skiros2_skill.core.skill import SkillBase
from skiros2_skill.testing import SkillBench
from skiros2_world_model.core.local_world_model import LocalWorldModel
from support.value_model import Model, Node, World, random_program

WEIGHT, NOTE = "skiros:Weight", "skiros:CadModel"


class Machine:
    """A world model with elements, on which programs run."""

    def __init__(self, weights: list[float]) -> None:
        self.bench = SkillBench()
        self.outside = LocalWorldModel("somebody", self.bench.wmi.model)
        self.ids = [self.bench.add("skiros:Product", f"p{i}", Weight=w, CadModel="").id for i, w in enumerate(weights)]
        self.log: dict[str, list[tuple[str, str, Any]]] = {}

    def task(self, program: list[Node]) -> Any:
        log: list[tuple[str, str, Any]] = []
        task = self.bench.task(*(self._node(node, log) for node in program))
        self.log[program[0].name] = log
        return task

    def seen(self, elements: list[Element]) -> list[tuple[int, float, str]]:
        return [(self.ids.index(e.id), e.value_of(WEIGHT), e.value_of(NOTE)) for e in elements if e.id]

    def _node(self, node: Node, log: list[Any]) -> Any:
        def wants(own: str) -> Any:
            return lambda d: d.getPropCond(f"Weight{own}", WEIGHT, own, "=", node.weights[own], True)

        params = [(own, Element("skiros:Product"), ParamTypes[kind]) for own, kind in node.kinds.items()]
        described = describe(node.name, *params, pre=[wants(own) for own in node.weights])
        members = {"createDescription": lambda skill: skill.setDescription(described(), node.name)}
        if node.children:
            members["expand"] = lambda skill, root: root(*(self._node(child, log) for child in node.children))
            self.bench.load(type(node.name, (SkillBase,), members))
        else:
            members["execute"] = self._leaf(node, log)
            self.bench.load(type(node.name, (PrimitiveBase,), members))
        made = self.bench.node(node.name, remap=node.names)
        for own, number in node.fixed.items():
            made.specifyParamDefault(node.names[own], self.stale[number])
        planned = {
            node.names[own]: Param(node.names[own], "", self.stale[number], ParamTypes.Inferred)
            for own, number in node.suggested.items()
        }
        made.specifyParamsDefault(ParamHandler(planned))
        return made

    def _leaf(self, node: Node, log: list[Any]) -> Any:
        def execute(skill: Any) -> Any:
            for own in node.kinds:
                log.append((node.name, own, self.seen(skill.params[own].current)))
            if not skill.progress_code:
                return skill.step("looked")
            for act in node.acts:
                self._act(skill, node.name, *act)
            return skill.success()

        return execute

    def _act(self, skill: Any, name: str, what: str, where: Any, number: int) -> None:
        if what in ("reweigh", "remove"):
            element = self.outside.find_element(self.ids[where])
            if element is None:
                return
            if what == "remove":
                self.outside.remove_element(element.id)
            else:
                element.setProperty(WEIGHT, float(number))
                self.outside.update_element(element)
            return
        param = skill.params[where]
        if what == "note":
            element = param.value
            if element is not None and element.id and self.outside.find_element(element.id) is not None:
                element.setProperty(NOTE, f"{name} {number}")
                param.value = element
        elif what == "unset":
            param.unset()
        elif self.outside.find_element(self.ids[number]) is not None:
            element = self.outside.get_element(self.ids[number])
            if what == "in place" and param.is_bound():
                param.value = element
            else:
                param.values = [element]

    @property
    def stale(self) -> list[Element]:
        """The elements as they were in the beginning, without a version."""
        if not hasattr(self, "_stale"):
            self._stale = []
            for eid in self.ids:
                element = Element("skiros:Product", "", eid)
                element.setProperty(WEIGHT, -1.0)
                self._stale.append(element)
        return self._stale

    def world(self) -> dict[int, tuple[float, str]]:
        return {
            number: (element.value_of(WEIGHT), element.value_of(NOTE))
            for number, eid in enumerate(self.ids)
            if (element := self.outside.find_element(eid)) is not None
        }


def _compare(seed: int, tasks: int) -> int:
    """Runs random programs side by side, tick by tick. Returns how many looks were compared."""
    rng = random.Random(seed)
    weights = [float(rng.randrange(2)) for _ in range(4)]
    programs = [random_program(rng, prefix, len(weights)) for prefix in "ST"[:tasks]]
    machine, world = Machine(weights), World(weights)
    models = [Model(program, world) for program in programs]
    steps = [model.run() for model in models]
    running = [machine.task(program) for program in programs]
    for _ in range(100):
        for step, task in zip(steps, running, strict=True):
            next(step, None)
            task.tick()
        if all(task.ended.is_set() for task in running):
            break
    for program, model, task in zip(programs, models, running, strict=True):
        about = "\n".join([f"seed {seed}", *map(repr, program), task.why])
        assert machine.log[program[0].name] == model.log, about
        assert (task.state.name == "Failure") == bool(model.failed), f"{model.failed}\n{about}"
    assert machine.world() == {n: (world.weight[n], world.note[n]) for n in world.weight}, f"seed {seed}"
    machine.bench.close()
    return sum(len(model.log) for model in models)


@pytest.mark.parametrize("tasks", [1, 2])
def test_engine_and_reference_model_agree(tasks):
    first = 0 if "FUZZ" not in os.environ else random.randrange(10**6)
    runs = 50 * int(os.environ.get("FUZZ", 1))
    looks = sum(_compare(seed, tasks) for seed in range(first, first + runs))
    assert looks > 8 * runs
