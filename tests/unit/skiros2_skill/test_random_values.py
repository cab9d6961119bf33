"""Random programs on the engine and on a reference model of the rules by which values reach skills: the same element is
seen by each skill at each look, and the same is in the world model at the end."""

from __future__ import annotations

import random
from itertools import count, zip_longest
from typing import Any

import pytest

from compatibility.test_blackboard import describe
from skiros2_common.core.params import Param, ParamHandler, ParamTypes
from skiros2_common.core.primitive import PrimitiveBase
from skiros2_common.core.world_element import Element
from skiros2_skill.core.skill import ParallelFf, RetryOnFail, Sequential, SkillBase
from skiros2_skill.testing import SkillBench
from skiros2_world_model.core.local_world_model import LocalWorldModel
from support.fuzz import FUZZ, examples
from support.value_model import PARALLEL, RETRY, SEQUENCE, Item, Model, Node, World, random_program

WEIGHT, NOTE = "skiros:Weight", "skiros:CadModel"
PROCESSORS = {SEQUENCE: Sequential, RETRY: lambda: RetryOnFail(1), PARALLEL: ParallelFf}


class _Memory:
    """What the skills of a task have seen, and what else they know."""

    def __init__(self) -> None:
        self.log: list[tuple[str, str, Any]] = []
        self.ended: set[str] = set()
        self.notes = count(1)


class Machine:
    """A world model with elements, on which programs run."""

    def __init__(self, weights: list[float]) -> None:
        self.bench = SkillBench()
        self.outside = LocalWorldModel("somebody", self.bench.wmi.model)
        self.places = [self.bench.add("skiros:Location", f"place{i}") for i in range(2)]
        self.ids = [
            self.bench.add("skiros:Product", f"p{i}", self.places[0], Weight=w, CadModel="").id
            for i, w in enumerate(weights)
        ]
        #: As no world model has them: every other one without a version, or read and then changed.
        self.stale = [
            self.outside.get_element(eid) if number % 2 else Element("skiros:Product", "", eid)
            for number, eid in enumerate(self.ids)
        ]
        for element in self.stale:
            element.setProperty(WEIGHT, -1.0)
        self.log: dict[str, list[tuple[str, str, Any]]] = {}
        self._loaded: set[str] = set()

    def task(self, program: list[Node]) -> Any:
        memory = _Memory()
        task = self.bench.task(*(self._node(node, memory) for node in program))
        self.log[program[0].name] = memory.log
        return task

    def seen(self, elements: list[Element]) -> list[tuple[int, float, int, str]]:
        return [(self.ids.index(e.id), e.value_of(WEIGHT), self._place(e), e.value_of(NOTE)) for e in elements if e.id]

    def _place(self, element: Element) -> int:
        (relation,) = element.getRelations("", "skiros:contain", "-1")
        return [place.id for place in self.places].index(relation["src"])

    def _node(self, node: Node, memory: _Memory) -> Any:
        if node.name not in self._loaded:
            self._loaded.add(node.name)
            self._load(node, memory)
        made = self.bench.node(node.name, remap=node.names)
        for own, number in node.fixed.items():
            made.specifyParamDefault(node.names[own], self.stale[number])
        planned = {
            node.names[own]: Param(node.names[own], "", self.stale[number], ParamTypes.Inferred)
            for own, number in node.suggested.items()
        }
        made.specifyParamsDefault(ParamHandler(planned))
        return made

    def _load(self, node: Node, memory: _Memory) -> None:
        def wants(own: str) -> Any:
            return lambda d: d.getPropCond(f"Weight{own}", WEIGHT, own, "=", node.weights[own], True)

        params = [(own, Element("skiros:Product"), ParamTypes[kind]) for own, kind in node.kinds.items()]
        described = describe(node.name, *params, pre=[wants(own) for own in node.weights])
        members = {"createDescription": lambda skill: skill.setDescription(described(), node.name)}
        if node.children:

            def expand(_: Any, root: Any) -> None:
                root.setProcessor(PROCESSORS[node.processor]())
                root(*(self._node(child, memory) for child in node.children))

            self.bench.load(type(node.name, (SkillBase,), {**members, "expand": expand}))
        else:
            members["execute"] = self._leaf(node, memory)
            self.bench.load(type(node.name, (PrimitiveBase,), members))

    def _leaf(self, node: Node, memory: _Memory) -> Any:
        def execute(skill: Any) -> Any:
            for own in node.kinds:
                memory.log.append((node.name, own, self.seen(skill.params[own].current)))
            if not skill.progress_code:
                return skill.step("looked")
            is_first = node.name not in memory.ended
            memory.ended.add(node.name)
            for act in node.acts:
                self._act(skill, node.name, memory, *act)
            return skill.fail("the first time", -1) if node.fails and is_first else skill.success()

        return execute

    def _act(self, skill: Any, name: str, memory: _Memory, what: str, where: Any, number: int) -> None:
        if what in ("reweigh", "move", "remove"):
            self._act_of_others(what, self.ids[where], number)
            return
        param = skill.params[where]
        is_bound = param.is_bound()
        if what in ("note", "change"):
            if is_bound:
                element = param.value
                element.setProperty(NOTE, f"{name} {next(memory.notes)}")
                if what == "note":
                    param.value = element
        elif what == "pop":
            if is_bound:
                param.values.pop(0)
        elif what == "unset":
            param.unset()
        elif self.outside.find_element(self.ids[number]) is not None:
            element = self.outside.get_element(self.ids[number])
            if what == "add" and is_bound:
                param.addValue(element)
            elif what == "in place" and is_bound:
                param.value = element
            else:
                param.values = [element]

    def _act_of_others(self, what: str, eid: str, value: int) -> None:
        element = self.outside.find_element(eid)
        if element is None:
            return
        if what == "remove":
            self.outside.remove_element(eid)
        elif what == "move":
            self.outside.set_relation(self.places[self._place(element)].id, "skiros:contain", eid, False)
            self.outside.set_relation(self.places[value].id, "skiros:contain", eid)
        else:
            element.setProperty(WEIGHT, float(value))
            self.outside.update_element(element)

    def world(self) -> list[tuple[int, float, int, str]]:
        return self.seen([e for eid in self.ids if (e := self.outside.find_element(eid)) is not None])


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
        seen = machine.log[program[0].name]
        different = next((pair for pair in zip_longest(seen, model.log) if pair[0] != pair[1]), "")
        about = "\n".join([f"seed {seed}, engine and model: {different}", *map(repr, program), task.why])
        assert not different, about
        assert (task.state.name == "Failure") == bool(model.failed), f"{model.failed}\n{about}"
    assert machine.world() == world.seen([Item(number) for number in world.weight]), f"seed {seed}"
    machine.bench.close()
    return sum(len(model.log) for model in models)


@pytest.mark.parametrize("tasks", [1, 2])
def test_engine_and_reference_model_agree(tasks):
    first, runs = random.randrange(10**6) if FUZZ else 0, examples(50)
    looks = sum(_compare(seed, tasks) for seed in range(first, first + runs))
    assert looks > 8 * runs
