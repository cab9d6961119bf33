"""Each tree of the catalogue does in one process what its trace says."""

from __future__ import annotations

import pytest

from catalogue import CASES, Case, conditions
from skiros2_common.core.abstract_skill import State
from skiros2_common.core.world_element import Element
from skiros2_skill.testing import SkillBench

_BUSY = Element("rparts:ArmDevice")
_BUSY.setProperty("skiros:StateProperty", "Busy")


@pytest.mark.parametrize("case", [case for case in CASES if not case.servers], ids=lambda case: case.name)
def test_tree_produces_expected_trace(skill_bench: SkillBench, case: Case) -> None:
    task = case.play(skill_bench)
    assert str(task.trace) == str(case.trace), task.why
    assert task.ended.is_set()


@pytest.mark.parametrize(
    ("case", "ticks"),
    [
        pytest.param(case, ticks, id=f"{case.name}-{ticks}")
        for case in CASES
        if not case.servers and case.tree.__module__ != conditions.__name__  # these are all alike
        for ticks in range(len(case.trace.ticks))
    ],
)
def test_preemption_after_any_tick_ends_running_nodes_only(skill_bench: SkillBench, case: Case, ticks: int) -> None:
    task = case.play(skill_bench, ticks)
    before = {node.child_indices: node for node in case.trace.ticks[ticks - 1]} if ticks else {}
    task.preempt()
    task.tick()
    assert task.ended.is_set(), task.why
    root, *others = task.trace.ticks[-1]
    assert (root.state, root.code) == (State.Failure, -1)
    for node in others:
        was = before.get(node.child_indices)
        if was is None:
            assert node.state is State.Idle, task.why
        elif was.state is State.Running:
            assert node.state in (State.Failure, State.Success), task.why
        else:
            assert (node.state, node.code) == (was.state, was.code), task.why
    assert not skill_bench.wmi.resolve_elements(_BUSY)
    if case.scene is None:
        assert str(case.play(skill_bench).trace) == str(case.trace)


def test_catalogue_has_no_duplicates() -> None:
    names = [case.name for case in CASES]
    assert len(set(names)) == len(names)
