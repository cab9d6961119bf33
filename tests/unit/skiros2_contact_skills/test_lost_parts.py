"""A part that is not between the fingers any more: the world model does not have it in the gripper."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest

from control_msgs.msg import GripperCommandResult
from skiros2_common.core.abstract_skill import State
from skiros2_common.core.failure_kind import FailureKind
from skiros2_contact_skills.arms import provided_arms
from skiros2_contact_skills.contact_motions import insert_part
from skiros2_contact_skills.gripping import check_grip
from skiros2_motion.core.geometry import IDENTITY, Pose
from skiros2_skill.testing import SkillBench
from skiros2_std_reasoners.core.scene_poses import parent_of, pose_in_scene
from skiros2_std_reasoners.core.spatial_data import set_pose
from support.surface_arm import SurfaceArm

IN_HAND = Pose((0.0, 0.0, 0.04), IDENTITY.orientation)
HAND = Pose((0.5, 0.1, 0.7), IDENTITY.orientation)


class Cell:
    """An arm that holds a piston.

    :ivar fingers: their distance (m).
    """

    def __init__(self, bench: SkillBench) -> None:
        self.bench, self.wmi = bench, bench.wmi
        self.robot_arm, self.fingers = SurfaceArm(), 0.02
        bench.load(insert_part, check_grip)
        self.arm_element = bench.add("rparts:ArmDevice", "arm", bench.robot, "skiros:hasA")
        self.gripper = bench.add("rparts:GripperEffector", "gripper", self.arm_element, "skiros:hasA")
        self.part = bench.add("skiros:Product", "piston", self.gripper, "skiros:contain")
        for element, pose in (
            (bench.robot, IDENTITY),
            (self.arm_element, IDENTITY),
            (self.gripper, HAND),
            (self.part, IN_HAND),
        ):
            set_pose(element, pose)
            self.wmi.update_element_properties(element)

    def arm(self, *_: Any) -> SurfaceArm:
        return self.robot_arm

    def width(self, *_: Any) -> float:
        return self.fingers

    def insert(self, fingers: float) -> Any:
        """Inserts; the fingers move to this distance meanwhile."""
        task = self.bench.command("InsertPart", Arm=self.arm_element, Part=self.part, Depth=0.05)
        task.tick(2)
        self.robot_arm.step()
        self.fingers = fingers
        while task.tick() is State.Running:
            self.robot_arm.step()
        return task

    def holder(self) -> str:
        found = parent_of(self.wmi, self.wmi.get_element(self.part.id))
        assert found is not None
        return str(found.id)


@pytest.fixture
def cell() -> Iterator[Cell]:
    with SkillBench() as bench:
        cell = Cell(bench)
        with provided_arms(cell):
            yield cell


@pytest.mark.parametrize("fingers", [0.0005, 0.08], ids=["closed", "open"])
def test_part_that_is_lost_during_an_insertion_is_where_it_was_last_known(cell: Cell, fingers: float) -> None:
    task = cell.insert(fingers)
    assert task.cause().failure_kind is FailureKind.LOST
    assert cell.holder() != cell.gripper.id
    assert "piston is in " in task.why
    assert pose_in_scene(cell.wmi, cell.wmi.get_element(cell.part.id))[1].position == pytest.approx((0.5, 0.1, 0.74))


def test_part_that_has_turned_between_the_fingers_is_still_there(cell: Cell) -> None:
    task = cell.insert(0.026)
    assert task.cause().failure_kind is FailureKind.LOST
    assert cell.holder() == cell.gripper.id


@pytest.mark.parametrize(("width", "is_held"), [(0.0, False), (0.02, True)])
def test_check_of_the_grip_that_finds_nothing_takes_the_part_out_of_the_gripper(
    cell: Cell, width: float, is_held: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    result = GripperCommandResult(position=width, stalled=is_held, reached_goal=not is_held)
    monkeypatch.setattr(check_grip, "onStart", lambda skill: True)
    monkeypatch.setattr(check_grip, "execute", lambda skill: skill.onDone(3, result))
    task = cell.bench.command("CheckGrip", Gripper=cell.gripper, Part=cell.part)
    task.tick(2)
    assert (task.state is State.Success) is is_held, task.why
    assert (cell.holder() == cell.gripper.id) is is_held
