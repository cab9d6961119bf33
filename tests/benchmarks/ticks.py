"""Ticks of trees, beside py_trees on the same shape: many leaves that run on, and many that succeed at once.

Our leaves have parameters and a condition on a relation between two of them; those of the peer have neither. The
figures are CPU time: one thread does it all.
"""

from __future__ import annotations

import gc
import itertools
import sys
import time
from collections.abc import Callable, Iterator
from typing import Any

import py_trees

from benchmarks.measurement import Measurement, paired
from skiros2_common.core.abstract_skill import SkillDescription
from skiros2_common.core.params import ParamTypes
from skiros2_common.core.primitive import PrimitiveBase
from skiros2_common.core.world_element import Element
from skiros2_skill.core.library.library import SkillLibrary
from skiros2_skill.core.runtime.scheduler import RECURSION_LIMIT
from skiros2_skill.core.runtime.task import Task
from skiros2_skill.core.skill import ParallelFf, Sequential, Skill, SkillBase, SkillWrapper, State
from skiros2_skill.core.tree.node import SkillInterface
from skiros2_world_model.core.local_world_model import LocalWorldModel

RUNS = 9
TICKS = 20
#: The leaves of the large tree: under a parallel node of 333 parallel nodes, which makes 1334.
LARGE = 1000
STEPS = 1000
DEPTH = 20
#: For each skill of a sequence, from its start to its end (µs).
MOST_FOR_A_SKILL = 50.0


_RUNNING = State.Running


class InPlace(SkillDescription):
    def createDescription(self) -> None:
        self.addParam("Container", Element("skiros:Container"), ParamTypes.Required)
        self.addParam("Object", Element("skiros:Product"), ParamTypes.Required)


class Hold(InPlace):
    def createDescription(self) -> None:
        super().createDescription()
        self.addHoldCondition(self.getRelationCond("In", "skiros:contain", "Container", "Object", True))


class HoldAndTell(Hold):
    pass


class Check(InPlace):
    def createDescription(self) -> None:
        super().createDescription()
        self.addPreCondition(self.getRelationCond("In", "skiros:contain", "Container", "Object", True))


class hold(PrimitiveBase):
    def createDescription(self) -> None:
        self.setDescription(Hold(), "hold")

    def execute(self) -> State:
        return _RUNNING


class hold_and_tell(PrimitiveBase):
    """Reports progress at each tick."""

    def createDescription(self) -> None:
        self.setDescription(HoldAndTell(), "hold_and_tell")

    def execute(self) -> State:
        return self.step("")


class check(PrimitiveBase):
    def createDescription(self) -> None:
        self.setDescription(Check(), "check")

    def execute(self) -> State:
        return self.success("")


class Count(SkillDescription):
    def createDescription(self) -> None:
        self.addParam("Note", 0, ParamTypes.Required)


class count(PrimitiveBase):
    def createDescription(self) -> None:
        self.setDescription(Count(), "count")

    def execute(self) -> State:
        self.params["Note"].value += 1
        return self.step("")


class Nested(SkillDescription):
    pass


class RunOn(py_trees.behaviour.Behaviour):
    def update(self) -> py_trees.common.Status:
        return py_trees.common.Status.RUNNING


def measure() -> Iterator[Measurement]:
    sys.setrecursionlimit(RECURSION_LIMIT)
    scene = _Scene()
    for leaves in (10, 100):
        ours, peer = scene.holding(leaves), _peer_tree(leaves)
        yield _ticks(f"tick of {leaves} running leaves, nothing changed", ours.tick, peer.tick, None)
    ours, peer = scene.holding(LARGE, groups_of=3), _peer_tree(LARGE, groups_of=3)
    nodes = sum(1 for _ in ours.nodes()) - 1  # without the root, which the peer has not
    yield _ticks(f"tick of {nodes} nodes, nothing changed", ours.tick, peer.tick, 0.06)
    telling = scene.holding(LARGE, groups_of=3, skill="HoldAndTell")
    yield _ticks(f"tick of {nodes} nodes, each leaf reports progress", telling.tick, peer.tick, None)
    yield _ticks(f"tick of {nodes} nodes, an element changed", ours.tick, peer.tick, 0.08, scene.change_of_another)
    counting = scene.holding(LARGE, groups_of=3, counting=True)
    yield _ticks(f"tick of {nodes} nodes, a parameter changed", counting.tick, peer.tick, 0.08)
    yield _ticks(f"tick of {DEPTH} nested compounds", scene.nested().tick, _peer_chain().tick, 0.3)
    yield paired(
        f"one of {STEPS} skills in a sequence, all in one tick",
        lambda: 1e6 * _seconds_of(_collected(scene.checking(STEPS)).tick, State.Success) / STEPS,
        "a leaf of py_trees",
        lambda: 1e6 * _seconds_of(_collected(_peer_sequence(STEPS)).tick) / STEPS,
        unit="µs",
        runs=RUNS,
        limit=MOST_FOR_A_SKILL,
    )


def _ticks(
    name: str,
    ours: Callable[[], object],
    peer: Callable[[], object],
    target: float | None,
    before: Callable[[], object] | None = None,
) -> Measurement:
    """A tick beside another.

    :param before: called before each of ours; it is not measured.
    """

    def seconds() -> float:
        spent = 0.0
        for _ in range(TICKS):
            if before is not None:
                before()
            spent += _seconds_of(ours)
        return spent / TICKS

    return paired(
        name,
        lambda: 1e6 * seconds(),
        "py_trees, the same shape",
        lambda: 1e6 * sum(_seconds_of(peer) for _ in range(TICKS)) / TICKS,
        unit="µs",
        runs=RUNS,
        target=target,
    )


def _collected(tree: Any) -> Any:
    """The tree. Those that were measured before are cleared away, not in the middle of its tick."""
    gc.collect()
    return tree


def _seconds_of(tick: Callable[[], object], expected: State = State.Running) -> float:
    """The CPU time of one call. A task has to answer as expected, or what was measured is something else."""
    start = time.thread_time()
    answer = tick()
    took = time.thread_time() - start
    if isinstance(answer, State) and answer is not expected:
        raise RuntimeError(f"the tick ended as {answer}, expected {expected}")
    return took


class _Scene:
    """A robot, a box with many products, and trees of skills on them."""

    def __init__(self) -> None:
        self.wmi = LocalWorldModel("bench")
        self.robot = self._add("cora:Robot", "robot", "skiros:Scene-0")
        self.box = self._add("skiros:LargeBox", "box", "skiros:Scene-0")
        self.products = [self._add("skiros:Product", f"product {n}", self.box.id) for n in range(max(LARGE, STEPS))]
        self.another = self._add("skiros:Product", "another", "skiros:Scene-0")
        self.library = SkillLibrary(self.wmi)
        for skill in (hold, hold_and_tell, check, count):
            self.library.add(skill)
        self._weights = itertools.count()

    def holding(self, leaves: int, groups_of: int = 0, skill: str = "Hold", counting: bool = False) -> Task:
        """A task whose leaves all run, in one parallel node or in groups under it.

        :param counting: the first leaf changes a parameter of the task at each tick.
        """
        nodes = [self._node(skill, n) for n in range(leaves)]
        if counting:
            nodes[0] = SkillWrapper("Count", "", self.library)
        task = self._task(_shape(nodes, groups_of, _parallel))
        if task.tick() is not State.Running or not all(node.state is State.Running for node in task.nodes()):
            raise RuntimeError(f"not all nodes run: {task.explanations()}")
        return task

    def nested(self) -> Task:
        """A task of compounds, each in the one before it, with a leaf that runs."""
        node: SkillInterface = self._node("Hold", 0)
        for number in range(DEPTH):
            self.library.add(_compound(f"compound_{number}", node))
            node = SkillWrapper("Nested", f"compound_{number}", self.library)
        task = self._task(node)
        if task.tick() is not State.Running:
            raise RuntimeError(f"it does not run: {task.explanations()}")
        return task

    def checking(self, steps: int) -> Task:
        """A task of as many skills one after the other."""
        return self._task(Skill("", Sequential())(*(self._node("Check", n) for n in range(steps))))

    def change_of_another(self) -> None:
        """Changes an element that no skill has."""
        self.another.setProperty("skiros:Weight", float(next(self._weights)))
        self.wmi.update_element(self.another)

    def _task(self, tree: Skill) -> Task:
        task = Task(0, self.wmi)
        task.root.params.addParam("Robot", self.robot, ParamTypes.Inferred)
        task.root(tree)
        return task

    def _node(self, name: str, number: int) -> SkillWrapper:
        node = SkillWrapper(name, "", self.library)
        node.specifyParamDefault("Container", self.box)
        node.specifyParamDefault("Object", self.products[number])
        return node

    def _add(self, etype: str, label: str, container: str) -> Element:
        element = Element(etype, label)
        element.addRelation(container, "skiros:contain", "-1")
        self.wmi.add_element(element)
        return element


def _compound(label: str, child: SkillInterface) -> type[SkillBase]:
    """A compound of one child."""

    class Compound(SkillBase):
        def createDescription(self) -> None:
            self.setDescription(Nested(), label)

        def expand(self, skill: SkillInterface) -> None:
            skill(child)

    return Compound


def _shape(leaves: list[Any], groups_of: int, parallel: Callable[[list[Any]], Any]) -> Any:
    """All leaves in one parallel node, or in groups under one; the last group takes what is left."""
    if not groups_of:
        return parallel(leaves)
    starts = range(0, len(leaves) - groups_of, groups_of)
    return parallel([parallel(leaves[s : s + groups_of if s != starts[-1] else None]) for s in starts])


def _parallel(children: list[Any]) -> Skill:
    node = Skill("", ParallelFf())
    node(*children)
    return node


def _peer_parallel(children: list[Any]) -> py_trees.composites.Parallel:
    parallel = py_trees.composites.Parallel("all", policy=py_trees.common.ParallelPolicy.SuccessOnAll())
    parallel.add_children(children)
    return parallel


def _peer_tree(leaves: int, groups_of: int = 0) -> py_trees.trees.BehaviourTree:
    tree = py_trees.trees.BehaviourTree(_shape([RunOn(str(n)) for n in range(leaves)], groups_of, _peer_parallel))
    tree.tick()
    return tree


def _peer_chain() -> py_trees.trees.BehaviourTree:
    node: py_trees.behaviour.Behaviour = RunOn("leaf")
    for number in range(DEPTH):
        sequence = py_trees.composites.Sequence(str(number), memory=True)
        sequence.add_child(node)
        node = sequence
    tree = py_trees.trees.BehaviourTree(node)
    tree.tick()
    return tree


def _peer_sequence(steps: int) -> py_trees.trees.BehaviourTree:
    sequence = py_trees.composites.Sequence("all", memory=True)
    sequence.add_children([py_trees.behaviours.Success(str(n)) for n in range(steps)])
    return py_trees.trees.BehaviourTree(sequence)
