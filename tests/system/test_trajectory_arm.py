"""The adapter of `CompliantArm` to drivers of joint trajectories, with a stand-in of such a driver."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

import pytest
import rospy

from skiros2_common.core.errors import ConfigurationError
from skiros2_contact_skills.ros.profiles import PROFILES
from skiros2_contact_skills.ros.trajectory_arm import TrajectoryArm
from skiros2_motion.core.compliant_arm import ArmState
from skiros2_motion.core.geometry import Pose
from support.ros import Ros, RosMaster, wait_until
from support.stand_in_controllers import JointDriver

pytestmark = pytest.mark.timeout(180)

WAIT = 60.0
NAMES = {"compliant": "", "position": "position", "base_frame": "panda_link0", "tool_frame": "panda_grasptarget"}


@pytest.fixture(scope="module")
def ros(ros_master: RosMaster) -> Iterator[Ros]:
    system = Ros(ros_master)
    yield system
    system.stop()


@pytest.fixture(scope="module")
def driver(ros: Ros) -> Iterator[JointDriver]:
    driver = JointDriver()
    yield driver
    driver.close()


@pytest.fixture
def arm(driver: JointDriver) -> Iterator[TrajectoryArm]:
    wait_until(lambda: rospy.has_param("/robot_description"), WAIT, "the URDF")
    arm = TrajectoryArm(PROFILES["follow_joint_trajectory"], NAMES)
    arm.begin()
    wait_for(arm, lambda s: not s.stopped)
    arm.zero_sensor()
    yield arm
    arm.close()


def wait_for(arm: TrajectoryArm, condition: Callable[[ArmState], object]) -> ArmState:
    """Ticks until the state is as wanted."""

    def state() -> ArmState | None:
        found = arm.state()
        return found if found is not None and condition(found) else None

    return wait_until(state, WAIT, "a state as wanted")


def moved(pose: Pose, x: float = 0.0, z: float = 0.0) -> Pose:
    return Pose((pose.position[0] + x, pose.position[1], pose.position[2] + z), pose.orientation)


def test_tool_follows_the_reference_in_small_steps(driver: JointDriver, arm: TrajectoryArm) -> None:
    target = moved(wait_for(arm, lambda s: True).pose, x=0.02, z=-0.02)
    arm.set_reference(target)
    wait_for(arm, lambda s: math.dist(s.pose.position, target.position) < 0.002)
    assert driver.goals >= 5, "at most 5 mm each"


def test_limit_shortens_the_steps(driver: JointDriver, arm: TrajectoryArm) -> None:
    arm.set_wrench_limits(40.0, 15.0)
    target = moved(wait_for(arm, lambda s: True).pose, x=0.015)
    goals = driver.goals
    arm.set_reference(target)
    wait_for(arm, lambda s: math.dist(s.pose.position, target.position) < 0.001)
    assert driver.goals - goals >= 7, "2 mm that meet 20 kN/m are 40 N"


def test_frozen_sensor_ends_the_steps(driver: JointDriver, arm: TrajectoryArm) -> None:
    start = wait_for(arm, lambda s: True).pose
    arm.set_wrench_limits(40.0, 15.0)
    arm.set_reference(moved(start, z=0.1))
    wait_for(arm, lambda s: s.pose.position[2] > start.position[2] + 0.005)
    driver.distort = lambda wrench: (0.0,) * 6
    goals = driver.goals
    stopped = wait_for(arm, lambda s: s.stopped)
    driver.distort = lambda wrench: wrench
    assert "without a change" in stopped.stopped
    assert driver.goals - goals <= 1


def test_arm_yields_to_a_push_by_force_over_stiffness(driver: JointDriver, arm: TrajectoryArm) -> None:
    arm.set_stiffness((500.0,) * 3, (50.0,) * 3)
    start = wait_for(arm, lambda s: True).pose
    driver.push(10.0, 0.0, 0.0, 100.0)
    wait_for(arm, lambda s: s.pose.position[0] - start.position[0] > 0.8 * 10.0 / 500.0)
    assert wait_for(arm, lambda s: True).pose.position[0] - start.position[0] < 1.5 * 10.0 / 500.0


def test_exceeded_limit_cancels_the_motion_until_limits_are_set_again(driver: JointDriver, arm: TrajectoryArm) -> None:
    start = wait_for(arm, lambda s: True).pose
    arm.set_wrench_limits(15.0, 0.0)
    arm.set_reference(moved(start, x=0.1))
    driver.push(40.0, 0.0, 0.0, 0.5)
    stopped = wait_for(arm, lambda s: s.stopped)
    assert stopped.stopped.endswith("above the limit of 15 N")
    goals = driver.goals
    wait_for(arm, lambda s: s.stamp > stopped.stamp + 1.0)
    assert driver.goals == goals
    arm.set_wrench_limits(60.0, 0.0)
    wait_for(arm, lambda s: not s.stopped and s.pose.position[0] < start.position[0] + 0.09)


def test_links_that_the_model_does_not_have_are_named(driver: JointDriver) -> None:
    with pytest.raises(ConfigurationError, match=r"/robot_description: there is no link 'gone'; there are: .*"):
        TrajectoryArm(PROFILES["follow_joint_trajectory"], NAMES | {"base_frame": "gone"})
