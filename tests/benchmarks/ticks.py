"""Ticks of trees whose leaves all run, beside py_trees on the same shape."""

from __future__ import annotations

import sys
from collections.abc import Iterator

import py_trees

from benchmarks.measurement import Measurement, paired, seconds_per_call
from skiros2_common.core.abstract_skill import SkillDescription
from skiros2_common.core.params import ParamTypes
from skiros2_common.core.primitive import PrimitiveBase
from skiros2_common.core.world_element import Element
from skiros2_skill.core.library import SkillLibrary
from skiros2_skill.core.skill import ParallelFf, Skill, SkillWrapper
from skiros2_skill.core.task import Task
from skiros2_skill.core.ticker import RECURSION_LIMIT
from skiros2_world_model.core.local_world_model import LocalWorldModel

RUNS = 9


class Run(SkillDescription):
    def createDescription(self) -> None:
        self.addParam("Speed", 1.0, ParamTypes.Required)
        self.addParam("Target", Element("sumo:Object"), ParamTypes.Optional)


class run_on(PrimitiveBase):
    def createDescription(self) -> None:
        self.setDescription(Run(), "run_on")

    def execute(self) -> object:
        return self.step("")


class RunOn(py_trees.behaviour.Behaviour):
    def update(self) -> py_trees.common.Status:
        return py_trees.common.Status.RUNNING


def measure() -> Iterator[Measurement]:
    sys.setrecursionlimit(RECURSION_LIMIT)
    library = SkillLibrary(LocalWorldModel("bench"))
    library.add(run_on)
    for leaves in (10, 100, 1000):
        ticks = 20_000 // leaves
        ours = _our_tree(library, leaves)
        peer = _peer_tree(leaves)
        yield paired(
            f"tick of {leaves} running leaves",
            lambda tick=ours.tick, n=ticks: 1e6 * seconds_per_call(tick, n),  # type: ignore[misc]
            "py_trees, the same shape",
            lambda tick=peer.tick, n=ticks: 1e6 * seconds_per_call(tick, n),  # type: ignore[misc]
            unit="µs",
            runs=RUNS,
        )


def _our_tree(library: SkillLibrary, leaves: int) -> Task:
    task = Task(0, library.wmi)
    task.root(Skill("", ParallelFf())(*(SkillWrapper("Run", "run_on", library) for _ in range(leaves))))
    task.tick()
    return task


def _peer_tree(leaves: int) -> py_trees.trees.BehaviourTree:
    parallel = py_trees.composites.Parallel("all", policy=py_trees.common.ParallelPolicy.SuccessOnAll())
    parallel.add_children([RunOn(str(number)) for number in range(leaves)])
    tree = py_trees.trees.BehaviourTree(parallel)
    tree.tick()
    return tree
