"""Evidence by weight: whether a released part still hangs on the hand."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest

from skiros2_common.core.abstract_skill import State
from skiros2_contact_skills import contact_primitive as codes
from skiros2_contact_skills.arms import provided_arms
from skiros2_contact_skills.weighing import check_release
from skiros2_motion.core.geometry import IDENTITY, Pose, from_euler, inverted
from skiros2_skill.testing import SkillBench
from skiros2_std_reasoners.core.scene_poses import parent_of
from skiros2_std_reasoners.core.spatial_data import pose_of, set_pose
from support.surface_arm import SurfaceArm

#: Of the part (kg), and its grasping pose.
MASS, GRASP = 0.31, Pose((0.0, 0.0, 0.04), (1.0, 0.0, 0.0, 0.0))


class Hand(SurfaceArm):
    """A hand whose sensor was zeroed with the part: when it is gone, the sensor is pushed up.

    :ivar lifted: measured force (N), along the axes of the base.
    """

    lifted = (0.0, 0.0, 0.0)

    def state(self) -> Any:
        state = super().state()
        return state and state._replace(wrench=(*self.lifted, 0.0, 0.0, 0.0))

    def arm(self, *_: Any) -> Hand:
        return self


class Cell:
    def __init__(self, bench: SkillBench, hand: Hand) -> None:
        self.bench, self.hand = bench, hand
        bench.load(check_release)
        self.arm = bench.add("rparts:ArmDevice", "arm", bench.robot, "skiros:hasA")
        self.gripper = bench.add("rparts:GripperEffector", "gripper", self.arm, "skiros:hasA")
        self.block = bench.add("skiros:Product", "block", bench.robot, "skiros:contain")
        self.part = bench.add("skiros:Product", "Piston", self.block, "skiros:contain")
        grasp = bench.add("skiros:GraspingPose", "grasp", self.part, "skiros:hasA")
        for element, pose in (
            (bench.robot, IDENTITY),
            (self.arm, IDENTITY),
            (self.gripper, IDENTITY),
            (self.block, IDENTITY),
            (self.part, IDENTITY),
            (grasp, GRASP),
        ):
            self.place(element, pose)

    def place(self, element: Any, pose: Pose) -> None:
        set_pose(element, pose)
        self.bench.wmi.update_element_properties(element)

    def run(self, mass: float | None = MASS) -> Any:
        if mass is not None:
            self.part.setProperty("skiros:Weight", mass)
            self.bench.wmi.update_element_properties(self.part)
        elements = {"Arm": self.arm, "Part": self.bench.wmi.get_element(self.part.id), "Gripper": self.gripper}
        task = self.bench.command("CheckRelease", **elements)
        for _ in range(100):
            if task.tick() is not State.Running:
                break
            self.hand.step()
        return task

    def holder(self) -> str:
        found = parent_of(self.bench.wmi, self.bench.wmi.get_element(self.part.id))
        assert found is not None
        return found.id


@pytest.fixture
def cell(skill_bench: SkillBench) -> Iterator[Cell]:
    hand = Hand()
    with provided_arms(hand):
        yield Cell(skill_bench, hand)


def evidence(task: Any) -> dict[str, Any]:
    return dict(task.skill.params["Evidence"].value)


def test_part_whose_weight_is_missing_was_released(cell: Cell) -> None:
    cell.hand.lifted = (0.4, 0.0, 2.9)
    task = cell.run()
    assert task.state is State.Success, task.why
    assert "2.9 N of the 3.0 N of Piston are missing" in task.skill.progress_msg
    assert evidence(task) == {
        "judgement": "released",
        "used": ["weight"],
        "weight": pytest.approx(3.04, abs=0.01),
        "missing_weight": pytest.approx(2.9),
    }
    assert cell.holder() == cell.block.id


def test_part_that_still_hangs_on_the_hand_is_in_the_gripper_again(cell: Cell) -> None:
    cell.hand.lifted = (3.0, 0.0, 0.2)  # only what is vertical counts
    task = cell.run()
    assert int(task.skill.progress_code) == codes.NOT_RELEASED
    assert "it still hangs on the hand" in task.skill.progress_msg
    assert cell.holder() == cell.gripper.id
    pose = pose_of(cell.bench.wmi.get_element(cell.part.id))
    assert pose is not None
    assert pose.position == pytest.approx(inverted(GRASP).position)


def test_vertical_is_that_of_the_world_not_of_the_arm(cell: Cell) -> None:
    cell.place(cell.arm, Pose((0.0, 0.0, 1.0), from_euler(0.0, 1.5707963, 0.0)))  # on a wall: its x points down
    cell.hand.lifted = (-2.9, 0.0, 0.0)
    assert cell.run().state is State.Success


@pytest.mark.parametrize(("mass", "text"), [(None, "not known"), (0.06, "0.6 N: too little to be felt")])
def test_weight_that_is_not_known_or_small_is_no_evidence(cell: Cell, mass: float | None, text: str) -> None:
    task = cell.run(mass)
    assert task.state is State.Success
    assert text in task.skill.progress_msg
    assert evidence(task)["used"] == []
