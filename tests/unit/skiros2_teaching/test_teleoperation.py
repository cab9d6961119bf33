"""Teleoperation: twists of a hand-held device move the tool, with limits; without twists the arm holds."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path

import pytest

from skiros2_common.core.abstract_skill import State
from skiros2_common.core.errors import WrongValue
from skiros2_common.core.world_element import Element
from skiros2_motion.core.geometry import Pose, angle_between, from_euler
from skiros2_skill.testing import FakeClock
from skiros2_teaching.core import taught_elements as taught
from skiros2_teaching.core.teleoperation import TIMEOUT, Limits, Twist, TwistInput, next_reference
from skiros2_teaching.teleoperate import NO_TWIST, teleoperate_arm
from skiros2_teaching.twists import provided_twists
from support.teaching_cell import TeachingCell

DOWN = Pose((0.5, 0.0, 0.3), (1.0, 0.0, 0.0, 0.0))
LIMITS = Limits(speed=0.1, angular_speed=0.5, lead=0.02, angular_lead=0.2)
REST = (0.0, 0.0, 0.0)


def test_twist_in_the_tool_frame_moves_along_its_axes_and_one_in_the_base_frame_along_those_of_the_base() -> None:
    twist = Twist((0.0, 0.0, 0.05), REST)
    assert next_reference(DOWN, DOWN, twist, LIMITS, 0.1).position == pytest.approx((0.5, 0.0, 0.295))
    assert next_reference(DOWN, DOWN, twist._replace(in_tool=False), LIMITS, 0.1).position[2] == pytest.approx(0.305)


def test_speed_and_lead_are_limited() -> None:
    fast = Twist((3.0, 4.0, 0.0), (0.0, 0.0, 9.0), in_tool=False)
    moved = next_reference(DOWN, DOWN, fast, LIMITS, 0.04)
    assert math.dist(moved.position, DOWN.position) == pytest.approx(0.1 * 0.04)
    assert angle_between(moved.orientation, DOWN.orientation) == pytest.approx(0.5 * 0.04)
    for _ in range(100):  # the tool is blocked
        moved = next_reference(moved, DOWN, fast, LIMITS, 0.04)
    assert math.dist(moved.position, DOWN.position) == pytest.approx(0.02)
    assert angle_between(moved.orientation, DOWN.orientation) == pytest.approx(0.2)


def test_angular_twist_turns_about_the_axes_of_the_base_or_of_the_tool() -> None:
    about_z = Twist(REST, (0.0, 0.0, 0.1), in_tool=False)
    turned = next_reference(DOWN, DOWN, about_z, LIMITS, 1.0)
    assert angle_between(turned.orientation, from_euler(math.pi, 0.0, 0.1)) == pytest.approx(0.0, abs=1e-6)
    in_tool = next_reference(DOWN, DOWN, about_z._replace(in_tool=True), LIMITS, 1.0)
    assert angle_between(in_tool.orientation, from_euler(math.pi, 0.0, -0.1)) == pytest.approx(0.0, abs=1e-6)


def test_twist_ends_after_its_timeout_and_with_a_number_that_is_not_finite() -> None:
    now = [10.0]
    twists, twist = TwistInput(lambda: now[0]), Twist((0.1, 0.0, 0.0), REST)
    assert twists.twist() is None
    twists.put(twist)
    now[0] += TIMEOUT
    assert twists.twist() == twist
    now[0] += 0.001
    assert twists.twist() is None
    twists.put(twist)
    with pytest.raises(WrongValue, match=r"nan.*expected finite numbers"):
        twists.put(Twist(REST, (math.nan, 0.0, 0.0)))
    assert twists.twist() is None


class Device(TwistInput):
    """A device that sends a twist until it is let go, by a clock that does not run."""

    def __init__(self) -> None:
        self.now = 0.0
        super().__init__(lambda: self.now)

    def twists(self, arm: Element) -> TwistInput:
        return self

    def let_go(self) -> None:
        self.now += 2.0 * TIMEOUT


@pytest.fixture
def device() -> Iterator[Device]:
    device = Device()
    with provided_twists(device):
        yield device


@pytest.fixture
def cell(tmp_path: Path, fake_clock: FakeClock) -> Iterator[TeachingCell]:
    cell = TeachingCell(tmp_path, fake_clock)
    cell.load(teleoperate_arm)
    yield cell
    cell.close()


def test_tool_moves_with_the_twist_and_is_at_rest_when_none_comes(cell: TeachingCell, device: Device) -> None:
    task = cell.start("TeleoperateArm")
    cell.advance(0.3)
    assert task.state is State.Running, task.why
    start = cell.driver.state().pose.position
    device.put(Twist((0.0, 0.05, 0.0), REST, in_tool=False))
    cell.advance(2.0)
    moved = cell.driver.state().pose.position
    assert moved[1] - start[1] == pytest.approx(0.1, abs=0.015), "0.05 m/s for 2 s"
    device.let_go()
    cell.advance(0.3)
    assert task.state is State.Success, task.why
    stopped = cell.driver.state().pose.position
    cell.advance(0.5)
    assert math.dist(cell.driver.state().pose.position, stopped) < 0.003
    assert math.dist(stopped, moved) < 0.02


def test_poses_are_taught_while_the_arm_is_teleoperated_and_teach_end_ends_it(
    cell: TeachingCell, device: Device
) -> None:
    task = cell.start("TeleoperateArm")
    device.put(Twist((0.0, 0.0, -0.02), REST))
    cell.advance(0.5)
    cell.taught("TeachPose", Object=cell.block, Name="seen")
    cell.taught("TeachEnd")
    cell.advance(0.1)
    assert task.state is State.Success, task.why
    assert taught.find_taught(cell.wmi, cell.block, "seen") is not None


def test_recorded_path_goes_on_when_the_device_is_let_go_for_a_moment(cell: TeachingCell, device: Device) -> None:
    cell.start("TeleoperateArm")
    device.put(Twist((0.0, 0.05, 0.0), REST))
    cell.advance(0.5)
    recording = cell.start("TeachPath", Object=cell.block, Name="sweep")
    cell.advance(1.0)
    device.let_go()
    cell.advance(0.5)
    device.put(Twist((0.0, 0.05, 0.0), REST))
    cell.advance(1.0)
    cell.taught("TeachEnd")
    assert recording.state is State.Success, recording.why


def test_arm_without_a_device_is_a_failure(cell: TeachingCell, device: Device) -> None:
    task = cell.done("TeleoperateArm", WaitTime=0.1)
    assert task.state is State.Failure
    assert task.skill.progress_code == NO_TWIST
