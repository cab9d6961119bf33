"""Each tree of the catalogue does in one process what its trace says."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from catalogue import CASES, PREEMPT, Case
from skiros2_skill.testing import SkillBench


@pytest.fixture
def world() -> Iterator[SkillBench]:
    with SkillBench() as bench:
        yield bench.import_libraries("catalogue")


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_a_tree_does_what_its_trace_says(world: SkillBench, case: Case) -> None:
    for description in ("Act", "Check", "Lift", "Job", "Hear", "Remove", "Forget"):
        world.library.candidates(description, "")
    case.scene(world)
    task = world.command(case.type, case.name, **case.params(world))
    for tick in range(1, len(case.trace.ticks) + 1):
        event = case.events.get(tick)
        if event == PREEMPT:
            task.preempt()
        elif event is not None:
            event(world)
        task.tick()
    assert str(task.trace) == str(case.trace), task.why
    assert task.ended.is_set()


def test_no_case_is_there_twice() -> None:
    names = [case.name for case in CASES]
    assert len(set(names)) == len(names)
