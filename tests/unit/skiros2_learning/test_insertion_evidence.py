"""Insertions in physics that go wrong: the task's report against the true pose of the part."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator
from pathlib import Path

import pybullet
import pytest

from skiros2_learning.local.insertion_study import PISTON, SCENE, InsertionStudy
from skiros2_motion.core.geometry import IDENTITY, Pose, composed
from skiros2_sim.core.bullet import Bullet

pytestmark = pytest.mark.timeout(300)

Act = Callable[[InsertionStudy], None]


@pytest.fixture(scope="module")
def study() -> Iterator[InsertionStudy]:
    with InsertionStudy() as study:
        yield study


def once_deep(depth: float, act: Act) -> Callable[[InsertionStudy, float], None]:
    """Acts once, when the part is so deep (m)."""
    done = []

    def disturb(study: InsertionStudy, time: float) -> None:
        if not done and study.part_in_bore()[0] > depth:
            done.append(time)
            act(study)

    return disturb


def open_gripper(study: InsertionStudy) -> None:
    (gripper,) = study.world.grippers.values()
    gripper.drive(0.08)


def stop_joints(study: InsertionStudy) -> None:
    """Each joint is at its limit."""
    (arm,) = study.world.arms.values()
    (robot,) = study.world.robots.values()
    physics = study.world.physics
    assert isinstance(physics, Bullet)
    for joint, at in zip(arm.joints, arm.positions(), strict=True):
        limits = {"jointLowerLimit": at - 1e-4, "jointUpperLimit": at + 1e-4}
        pybullet.changeDynamics(robot.body, joint.index, **limits, physicsClientId=physics.id)


def slip(distance: float) -> Act:
    """The part slips into the hand (m)."""

    def act(study: InsertionStudy) -> None:
        part = study.world.pose_of(PISTON)
        study.world.set_pose(PISTON, composed(part, Pose((0.0, 0.0, distance), IDENTITY.orientation)))

    return act


ONCE = {"insert_into_bore": {"Attempts": 1}}


def test_good_insertion_names_fingers_and_floor_as_its_evidence(study: InsertionStudy) -> None:
    run = study.run(seed=3)
    assert run.success, run.why
    assert run.evidence["judgement"] == "inserted"
    assert run.evidence["used"] == ["tool", "fingers", "force"]
    assert run.evidence["held"] is True
    assert run.evidence["floor_force"] > 12.0


@pytest.mark.parametrize("depth", [-1.0, pytest.param(0.03, marks=pytest.mark.long)])
def test_insertion_with_an_open_gripper_fails(study: InsertionStudy, depth: float) -> None:
    run = study.run(seed=3, disturb=once_deep(depth, open_gripper))
    assert not run.reported
    assert run.time < 8.0, "an empty hand is not tried again"
    assert "a part was lost" in run.why
    assert run.evidence["judgement"] == "not held"
    assert run.evidence["width_after"] > run.evidence["part_width"] + 0.003


@pytest.mark.long
def test_part_that_slips_in_the_fingers_is_still_pushed_to_the_floor(study: InsertionStudy) -> None:
    run = study.run(seed=3, disturb=once_deep(0.03, slip(0.004)))
    assert run.success, run.why
    assert run.evidence["tool_depth"] == pytest.approx(0.064, abs=0.0005)
    assert run.depth == pytest.approx(0.06, abs=0.0005)


@pytest.mark.long
def test_part_that_slips_too_far_fails(study: InsertionStudy) -> None:
    run = study.run(seed=3, parameters=ONCE, disturb=once_deep(0.02, slip(0.008)))
    assert not run.reported
    assert run.evidence["judgement"] == "slipped"
    assert run.depth < 0.0
    assert "it is pulled out" in run.why


@pytest.mark.parametrize("depth", [pytest.param(0.0575, marks=pytest.mark.long), 0.0592])
def test_joint_at_its_limit_is_no_floor(study: InsertionStudy, depth: float) -> None:
    run = study.run(seed=3, parameters=ONCE, disturb=once_deep(depth, stop_joints))
    assert run.depth < 0.05995, "short of the floor"
    assert not run.reported  # the force of the spring is not measured, or no floor is felt


@pytest.mark.long
def test_depth_is_that_of_the_bore(tmp_path: Path) -> None:
    scene = changed_scene(tmp_path, {'skiros:Depth "0.06"': 'skiros:Depth "0.04"'})
    with InsertionStudy(scene) as study:
        run = study.run(seed=3, position_error=0.001)
    assert run.success, run.why
    assert run.depth == pytest.approx(0.04, abs=0.0005)
    assert run.max_force < 40.0


@pytest.mark.long
def test_part_that_does_not_find_the_bore_is_lifted_off_its_rim(tmp_path: Path) -> None:
    narrow = {'skiros:Diameter "0.0402"': 'skiros:Clearance "0.0002" ; skiros:Diameter "0.0397"'}
    parameters = {"insert_into_bore": {"Attempts": 2}, "spiral_search": {"SearchTime": 1.0}}
    with InsertionStudy(changed_scene(tmp_path, narrow)) as study:
        run = study.run(seed=3, parameters=parameters)
    assert not run.reported
    assert run.depth < -0.003
    assert "it is lifted" in run.why


def test_part_that_is_wider_than_the_bore_is_refused_before_it_moves(tmp_path: Path) -> None:
    scene = changed_scene(tmp_path, {'skiros:Diameter "0.0402"': 'skiros:Diameter "0.0397"'})
    with InsertionStudy(scene) as study:
        run = study.run(seed=3)
    assert "Piston does not fit into Bore 2: it is 0.30 mm too wide" in run.why
    assert run.max_force < 2.0


def changed_scene(folder: Path, changes: dict[str, str]) -> Path:
    """Returns a copy of the scene with other texts."""
    shutil.copytree(SCENE.parent, folder / "scene")
    scene = folder / "scene" / SCENE.name
    text = scene.read_text()
    for old, new in changes.items():
        assert old in text
        text = text.replace(old, new)
    scene.write_text(text)
    return scene
