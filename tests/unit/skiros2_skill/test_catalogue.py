"""Each tree of the catalogue does in one process what its trace says."""

from __future__ import annotations

import pytest

from catalogue import CASES, Case
from skiros2_skill.testing import SkillBench


@pytest.mark.parametrize("case", [case for case in CASES if not case.servers], ids=lambda case: case.name)
def test_a_tree_does_what_its_trace_says(skill_bench: SkillBench, case: Case) -> None:
    task = case.play(skill_bench)
    assert str(task.trace) == str(case.trace), task.why
    assert task.ended.is_set()


def test_no_case_is_there_twice() -> None:
    names = [case.name for case in CASES]
    assert len(set(names)) == len(names)
