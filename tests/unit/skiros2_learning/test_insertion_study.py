"""Insertions by the skills in physics, in this process."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path

import pytest

from skiros2_common.core.errors import UnknownName
from skiros2_learning.local.insertion_study import BORES, InsertionRun, InsertionStudy
from support.insertion_cells import write_cell

pytestmark = pytest.mark.timeout(180)


@pytest.fixture(scope="module")
def study() -> Iterator[InsertionStudy]:
    with InsertionStudy() as study:
        yield study


def run_with_error(study: InsertionStudy) -> InsertionRun:
    return study.run(seed=8, position_error=0.002, angle_error=math.radians(1.0))


@pytest.fixture(scope="module")
def run(study: InsertionStudy) -> InsertionRun:
    return run_with_error(study)


def test_piston_is_inserted_in_spite_of_an_error_of_the_estimated_pose(run: InsertionRun) -> None:
    assert run.success, run.why
    assert run.depth == pytest.approx(0.06, abs=0.001)
    assert run.tilt < math.radians(1.0)
    assert run.max_force < 48.0


@pytest.mark.long
def test_run_is_the_same_bit_by_bit_each_time(study: InsertionStudy, run: InsertionRun) -> None:
    assert run_with_error(study) == run


@pytest.mark.long
def test_blind_insertion_fails_with_an_error_of_two_millimetres(study: InsertionStudy) -> None:
    run = study.run(seed=2, position_error=0.002, skill="insert_blindly")
    assert not run.success
    assert run.depth < 0.005


def test_exceeded_force_limit_ends_the_insertion_within_a_tick_and_leaves_the_arm_compliant_and_at_rest(
    study: InsertionStudy,
) -> None:
    run = study.run(seed=2, position_error=0.002, parameters={"insert_into_bore": {"MaxForce": 6.0}})
    assert not run.success
    assert "above" in run.why and "6 N" in run.why
    (arm,) = study.world.arms.values()
    study.world.step(1000)
    assert max(map(abs, arm.velocities())) < 0.02


def test_parameters_of_an_unknown_skill_are_refused(study: InsertionStudy) -> None:
    with pytest.raises(UnknownName, match="insert_prat: the skills are insert_into_bore"):
        study.run(seed=0, parameters={"insert_prat": {}})


@pytest.mark.long
@pytest.mark.parametrize(
    ("arm", "bore", "error", "angle"),
    [("iiwa", BORES[2], 0.002, 1.0), ("iiwa", BORES[0], 0.002, 2.0), ("xarm6", BORES[2], 0.001, 2.0)],
    ids=["hit the rim with 54 N", "a hand that turns is lighter", "jammed"],
)
def test_rigid_gripper_inserts_within_the_limit(
    arm: str, bore: str, error: float, angle: float, tmp_path: Path
) -> None:
    with InsertionStudy(write_cell(tmp_path / "cell", arm, 0.00005), bore=bore) as study:
        run = study.run(seed=1, position_error=error, angle_error=math.radians(angle))
    assert run.success, run.why
    assert run.max_force < 40.0
