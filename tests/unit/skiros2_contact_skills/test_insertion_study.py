"""Insertions by the skills in physics, in this process."""

from __future__ import annotations

import math
from collections.abc import Iterator

import pytest

from skiros2_common.core.errors import UnknownName
from skiros2_contact_skills.insertion_study import InsertionStudy

pytestmark = pytest.mark.timeout(180)


@pytest.fixture(scope="module")
def study() -> Iterator[InsertionStudy]:
    with InsertionStudy() as study:
        yield study


def test_piston_is_inserted_in_spite_of_an_error_of_the_estimated_pose(study: InsertionStudy) -> None:
    run = study.run(seed=2, position_error=0.002, angle_error=math.radians(1.0))
    assert run.success, run.why
    assert run.depth == pytest.approx(0.06, abs=0.001)
    assert run.tilt < math.radians(1.0)
    assert run.max_force < 48.0


def test_run_is_the_same_bit_by_bit_each_time(study: InsertionStudy) -> None:
    first, second = (study.run(seed=4, position_error=0.001) for _ in range(2))
    assert first == second


def test_blind_insertion_fails_with_an_error_of_a_millimetre(study: InsertionStudy) -> None:
    run = study.run(seed=1, position_error=0.001, skill="insert_blindly")
    assert not run.success
    assert run.depth < 0.005


def test_parameters_of_an_unknown_skill_are_refused(study: InsertionStudy) -> None:
    with pytest.raises(UnknownName, match="insert_prat: the skills are insert_into_bore"):
        study.run(seed=0, parameters={"insert_prat": {}})
