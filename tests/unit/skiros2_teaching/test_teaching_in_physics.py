"""The teaching skills in physics, in one process: a scripted hand guides the arm."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from skiros2_common.core.abstract_skill import State
from skiros2_common.core.failure_kind import FailureKind
from skiros2_motion.core.arm_kinematics import distances
from skiros2_motion.core.geometry import Pose, composed, from_euler, multiplied
from skiros2_motion.core.gripper import GripperEvent
from skiros2_skill.testing import FakeClock
from skiros2_std_reasoners.core import spatial_data as space
from skiros2_teaching.core import taught_elements as taught
from skiros2_teaching.core.taught_path import Sample, TaughtPath
from support.teaching_cell import BLOCK, GRIPPER, TeachingCell, deviation

DOWN = (1.0, 0.0, 0.0, 0.0)
#: Where the block is moved to: by 5 cm and 20 degrees.
SHIFT = Pose((0.03, 0.04, 0.0), from_euler(0.0, 0.0, math.radians(20.0)))
#: Of the block, in the map.
START = Pose((0.5, 0.0, 0.05), (0.0, 0.0, 0.13052, 0.99144))
ABOVE_BLOCK = Pose((-0.08, 0.0, 0.2), DOWN)


@pytest.fixture
def cell(tmp_path: Path, fake_clock: FakeClock) -> Iterator[TeachingCell]:
    cell = TeachingCell(tmp_path, fake_clock)
    yield cell
    cell.close()


def on_curve(t: float) -> Pose:
    """A pose in the map: on a curve of 0.3 m above the block in 5 s, after 1 s of rest."""
    s = min(max((t - 1.0) / 5.0, 0.0), 1.0)
    s = s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
    position = (-0.08 + 0.16 * s, 0.06 * math.sin(2.0 * math.pi * s), 0.2 - 0.08 * math.sin(math.pi * s))
    return composed(START, Pose(position, multiplied(from_euler(0.0, 0.0, 0.5 * s), DOWN)))


def move_block(cell: TeachingCell) -> None:
    x, y, z = START.position
    dx, dy, _ = SHIFT.position
    cell.move_block(Pose((x + dx, y + dy, z), multiplied(SHIFT.orientation, START.orientation)))


def add_path(cell: TeachingCell, name: str = "sweep", *events: GripperEvent) -> Any:
    """Stores a straight path of 0.1 m above the block."""
    ends = (ABOVE_BLOCK, Pose((0.02, 0.0, 0.2), DOWN))
    path = TaughtPath.from_samples([Sample(2.0 * i, pose) for i, pose in enumerate(ends)], events)
    cell.wmi.transact(taught.new_path(cell.wmi, cell.block, name, path))
    return taught.find_taught(cell.wmi, cell.block, name)


def add_pose(cell: TeachingCell, name: str = "there", pose: Pose = ABOVE_BLOCK) -> Any:
    cell.wmi.transact(taught.new_pose(cell.wmi, cell.block, name, pose))
    return taught.find_taught(cell.wmi, cell.block, name)


def release(cell: TeachingCell) -> Any:
    task = cell.start("TeachRelease")
    cell.advance(0.2)
    assert task.state is State.Running, task.why
    return task


def test_guided_path_is_reproduced_after_the_block_was_moved(cell: TeachingCell) -> None:
    release(cell)
    cell.guide(lambda t: on_curve(min(t, 1.0)), 2.0)
    recording = cell.start("TeachPath", Object=cell.block, Name="sweep")
    shown = cell.guide(lambda t: on_curve(t), 3.0)
    cell.start("MoveGripper", Width=0.02)
    shown += cell.guide(lambda t: on_curve(t + 3.0), 4.0)
    cell.taught("TeachEnd")
    assert recording.state is State.Success, recording.why
    path = taught.find_taught(cell.wmi, cell.block, "sweep")
    move_block(cell)
    cell.taught("MoveGripper", Width=0.08)

    followed: list[tuple[Pose, float]] = []
    width = cell.world.grippers[GRIPPER].width
    cell.taught("ReplayTaughtPath", lambda: followed.append((cell.tool_on_block(), width())), Path=path)
    poses = [pose for pose, _ in followed]
    assert deviation(shown, poses) < 0.003
    off, turned = distances(poses[-1], shown[-1])
    assert off < 0.003
    assert turned < 0.02
    closing = next(pose for pose, opening in followed if opening < 0.075)
    (event,) = taught.path_of(path).events
    start = space.pose_of(path)
    assert start is not None
    assert distances(closing, composed(start, taught.path_of(path).pose(event.time)))[0] < 0.003
    assert followed[-1][1] == pytest.approx(0.02, abs=0.002)


@pytest.mark.long
def test_path_is_adapted_to_another_goal_and_to_the_start_of_the_tool(cell: TeachingCell) -> None:
    path = add_path(cell)
    goal = add_pose(cell, "goal", Pose((0.0, 0.06, 0.15), DOWN))
    cell.taught("ReplayTaughtPath", Path=path, Goal=goal)
    assert distances(cell.tool_on_block(), Pose((0.0, 0.06, 0.15), DOWN))[0] < 0.003
    cell.taught("ReplayTaughtPath", Path=path, FromHere=True)
    assert distances(cell.tool_on_block(), Pose((0.02, 0.0, 0.2), DOWN))[0] < 0.003


def test_taught_pose_moves_with_the_block_and_is_approached_by_its_lifting_pose(cell: TeachingCell) -> None:
    release(cell)
    shown = cell.guide(lambda t: composed(START, Pose((0.0, 0.02, 0.12), DOWN)), 3.0)[-1]
    cell.taught("TeachPose", Object=cell.block, Name="there")
    cell.taught("TeachEnd")
    pose = taught.find_taught(cell.wmi, cell.block, "there")
    cell.taught("TeachLiftingPose", Pose=pose, Height=0.1)
    move_block(cell)
    passed: list[Pose] = []
    cell.taught("MoveToTaughtPose", lambda: passed.append(cell.tool_on_block()), Pose=pose)
    off, turned = distances(cell.tool_on_block(), shown)
    assert off < 0.003
    assert turned < 0.02
    x, y, z = shown.position
    lifted = Pose((x, y, z + 0.1), shown.orientation)
    assert min(distances(pose, lifted)[0] for pose in passed) < 0.005


def test_lifting_pose_is_that_of_the_tool_without_a_height(cell: TeachingCell) -> None:
    pose = add_pose(cell)
    cell.taught("TeachLiftingPose", Pose=pose)
    lifting = taught.lifting_pose_of(cell.wmi, pose)
    assert lifting is not None
    below = space.pose_of(lifting)
    assert below is not None
    assert distances(composed(ABOVE_BLOCK, below), cell.tool_on_block())[0] < 0.001


def test_released_arm_follows_a_push_and_does_not_drift(cell: TeachingCell) -> None:
    task = release(cell)
    before = cell.world.pose_of(GRIPPER)
    cell.advance(3.0)
    assert distances(cell.world.pose_of(GRIPPER), before)[0] < 0.001
    cell.world.push(GRIPPER, (6.0, 0.0, 0.0), duration=0.5)
    cell.advance(3.0)
    assert distances(cell.world.pose_of(GRIPPER), before)[0] > 0.05
    assert max(map(abs, cell.world.velocity_of(GRIPPER)[0])) < 0.005
    cell.end(task)
    held = cell.world.pose_of(GRIPPER)
    cell.world.push(GRIPPER, (6.0, 0.0, 0.0), duration=0.5)
    cell.advance(2.0)
    assert distances(cell.world.pose_of(GRIPPER), held)[0] < 0.002


def test_end_of_a_recording_keeps_the_arm_released_if_wanted(cell: TeachingCell) -> None:
    task = release(cell)
    cell.start("TeachPath", Object=cell.block, Name="sweep")
    cell.guide(lambda t: on_curve(t), 4.0)
    assert cell.taught("TeachEnd", KeepReleased=True) == "Arm is still released"
    assert taught.find_taught(cell.wmi, cell.block, "sweep").type == taught.PATH
    assert task.state is State.Running
    assert cell.taught("TeachEnd") == "Arm holds its pose"
    assert task.state is State.Success
    assert cell.taught("TeachEnd") == "Nothing was being taught with Arm"


def test_taught_elements_are_taught_again_only_if_wanted(cell: TeachingCell) -> None:
    pose = add_pose(cell)
    said = cell.refused("TeachPose", Object=cell.block, Name="there")
    assert "'Block' has a taught element 'there': skiros:TaughtPose-" in said
    assert space.pose_of(cell.wmi.get_element(pose.id)) == ABOVE_BLOCK
    cell.taught("TeachPose", Object=cell.block, Name="there", Replace=True)
    again = space.pose_of(cell.wmi.get_element(pose.id))
    assert again is not None
    assert distances(again, cell.tool_on_block())[0] < 0.001
    said = cell.refused("TeachPath", Object=cell.block, Name="there", Replace=True)
    assert "is a skiros:TaughtPose: expected a skiros:TaughtPath" in said


@pytest.mark.parametrize("name", ["", " ", "a\tb"])
def test_unusable_name_is_refused(cell: TeachingCell, name: str) -> None:
    assert "name" in cell.refused("TeachPose", Object=cell.block, Name=name)
    assert taught.taught_elements(cell.wmi, cell.block) == []


def test_path_of_a_resting_tool_is_refused(cell: TeachingCell) -> None:
    release(cell)
    task = cell.start("TeachPath", Object=cell.block, Name="sweep")
    cell.advance(1.0)
    cell.taught("TeachEnd")
    assert task.state is State.Failure
    assert "expected at least 2 mm or 0.02 rad" in task.skill.progress_msg
    assert taught.taught_elements(cell.wmi, cell.block) == []


def test_path_with_one_sample_is_refused(cell: TeachingCell, monkeypatch: pytest.MonkeyPatch) -> None:
    state = cell.driver.state()
    monkeypatch.setattr(cell.driver, "state", lambda: state)
    task = cell.start("TeachPath", Object=cell.block, Name="sweep")
    cell.advance(0.2)
    cell.taught("TeachEnd")
    assert task.state is State.Failure
    assert "a path needs at least 2 samples, got 1" in task.skill.progress_msg


def test_path_with_a_sample_that_is_no_number_is_refused(cell: TeachingCell, monkeypatch: pytest.MonkeyPatch) -> None:
    measured = cell.driver.state
    task = cell.start("TeachPath", Object=cell.block, Name="sweep")
    cell.advance(0.4)
    broken = measured()._replace(pose=Pose((math.nan, 0.0, 0.0), DOWN), stamp=cell.world.time)
    monkeypatch.setattr(cell.driver, "state", lambda: broken)
    cell.advance(0.04)
    monkeypatch.undo()
    cell.advance(0.4)
    cell.taught("TeachEnd")
    assert task.state is State.Failure
    assert "sample 10: expected finite numbers" in task.skill.progress_msg
    assert taught.taught_elements(cell.wmi, cell.block) == []


def test_arm_without_states_is_reported(cell: TeachingCell, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cell.driver, "state", lambda: None)
    assert "has sent no state for 5" in cell.refused("TeachPose", Object=cell.block, Name="there")
    assert "has sent no state for 5" in cell.refused("TeachPath", Object=cell.block, Name="sweep")


def test_state_that_the_adapter_reports_as_out_of_date_is_not_taught(
    cell: TeachingCell, monkeypatch: pytest.MonkeyPatch
) -> None:
    last = cell.driver.state()._replace(stopped="no state for 2.3 s", kind=FailureKind.SENSOR)
    monkeypatch.setattr(cell.driver, "state", lambda: last._replace(stamp=cell.world.time))
    assert "no state for 2.3 s" in cell.refused("TeachPose", Object=cell.block, Name="there")
    assert "no state for 2.3 s" in cell.refused("TeachPath", Object=cell.block, Name="sweep")
    assert taught.taught_elements(cell.wmi, cell.block) == []


def test_path_is_discarded_when_the_arm_is_not_released_any_more(cell: TeachingCell) -> None:
    released = release(cell)
    task = cell.start("TeachPath", Object=cell.block, Name="sweep")
    cell.advance(1.0)
    cell.end(released)
    cell.advance(0.2)
    assert task.state is State.Failure
    assert "Arm is no longer released: the path is discarded" in task.skill.progress_msg


def test_second_recording_with_an_arm_is_refused(cell: TeachingCell) -> None:
    cell.start("TeachPath", Object=cell.block, Name="one")
    cell.advance(0.2)
    assert "a path is being recorded with arm Arm" in cell.refused("TeachPath", Object=cell.block, Name="two")


def test_released_arm_is_not_moved_by_another_skill(cell: TeachingCell) -> None:
    path = add_path(cell)
    released = release(cell)
    assert "arm Arm is used by another skill: teach_release" in cell.refused("ReplayTaughtPath", Path=path)
    assert released.state is State.Running


@pytest.mark.parametrize("recursive", [True, False])
def test_taught_pose_whose_object_is_gone_is_refused(cell: TeachingCell, recursive: bool) -> None:
    pose, path = add_pose(cell), add_path(cell)
    tasks = [cell.start("MoveToTaughtPose", Pose=pose), cell.start("ReplayTaughtPath", Path=path)]
    cell.wmi.remove_element(BLOCK, recursive=recursive)
    before = cell.world.pose_of(GRIPPER)
    cell.advance(1.0)
    for task, name in zip(tasks, ("there", "sweep"), strict=True):
        assert task.state is State.Failure
        wanted = "is not in the scene" if recursive else f"the object of {name!r} is gone"
        assert wanted in task.why
    assert distances(cell.world.pose_of(GRIPPER), before)[0] < 0.001


def test_motion_ends_when_the_object_moves_or_is_removed(cell: TeachingCell) -> None:
    path = add_path(cell)
    task = cell.start("ReplayTaughtPath", Path=path)
    cell.advance(1.0)
    move_block(cell)
    cell.advance(0.2)
    assert task.state is State.Failure
    assert "'Block' has moved by 50 mm and 0.35 rad during the motion" in task.skill.progress_msg
    task = cell.start("ReplayTaughtPath", Path=path)
    cell.advance(1.0)
    cell.wmi.remove_element(BLOCK)
    cell.advance(0.2)
    assert task.state is State.Failure
    cell.advance(1.0)
    assert max(map(abs, cell.world.velocity_of(GRIPPER)[0])) < 0.002


def test_motion_stops_at_its_force_limit_and_the_arm_rests(cell: TeachingCell) -> None:
    task = cell.start("ReplayTaughtPath", Path=add_path(cell), MaxForce=10.0)
    cell.advance(1.0)
    cell.world.push(GRIPPER, (0.0, 25.0, 0.0), duration=0.3)
    cell.advance(0.6)
    assert task.state is State.Failure
    assert "above the limit of 10 N" in task.skill.progress_msg
    cell.advance(1.0)
    assert max(map(abs, cell.world.velocity_of(GRIPPER)[0])) < 0.002


@pytest.mark.long
def test_unreachable_path_ends_with_the_distance(cell: TeachingCell) -> None:
    pose = add_pose(cell, "far", Pose((1.0, 0.0, 0.3), DOWN))
    said = cell.refused("MoveToTaughtPose", Pose=pose)
    # a stretched arm does not exert the commanded force, which its driver may notice before the skill sees the distance
    assert "from its reference: expected up to" in said or "difference of measured and commanded force" in said


def test_preempted_motion_leaves_the_arm_at_rest(cell: TeachingCell) -> None:
    task = cell.start("ReplayTaughtPath", Path=add_path(cell))
    cell.advance(1.0)
    cell.end(task)
    cell.advance(1.0)
    rests = cell.world.pose_of(GRIPPER)
    cell.advance(1.0)
    assert distances(cell.world.pose_of(GRIPPER), rests)[0] < 0.001


@pytest.mark.long
def test_failed_gripper_ends_the_replay(cell: TeachingCell) -> None:
    path = add_path(cell, "sweep", GripperEvent(0.0, 0.3))
    assert "gripper failed to move to 0.3 m: width 0.3 m: gripper gripper opens" in cell.refused(
        "ReplayTaughtPath", Path=path
    )


def test_undone_edits_are_restored(cell: TeachingCell) -> None:
    add_pose(cell)
    cell.taught("TeachPose", Object=cell.block, Name="there", Replace=True)
    assert cell.taught("TeachUndo") == "Undone: the edit of there by teacher"
    assert space.pose_of(taught.find_taught(cell.wmi, cell.block, "there")) == ABOVE_BLOCK
    cell.taught("TeachUndo")
    assert taught.taught_elements(cell.wmi, cell.block) == []
    assert "nothing to undo" in cell.refused("TeachUndo")


def test_pose_is_stored_relative_to_the_object(cell: TeachingCell) -> None:
    cell.taught("TeachPose", Object=cell.block, Name="there")
    stored = space.pose_of(taught.find_taught(cell.wmi, cell.block, "there"))
    assert stored is not None
    off, turned = distances(stored, cell.tool_on_block())
    assert off < 0.001
    assert turned < 0.002
