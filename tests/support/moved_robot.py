"""A simulated robot whose motions are run to their end, one after the other."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from skiros2_motion.core.geometry import Pose, Vector
from skiros2_motion.core.motion import Motion, Outcome, State
from skiros2_sim.core.arm_controller import ArmController
from skiros2_sim.core.base_motion import BaseMotion
from skiros2_sim.core.cartesian_motion import CartesianGoal, CartesianMotion
from skiros2_sim.core.drive_path import Pose2D
from skiros2_sim.core.gripper import GripperMotion
from skiros2_sim.core.joint_motion import JointGoal, JointMotion, JointPoint
from skiros2_sim.core.world import World
from support.simulated_cell import ARM, ROBOT

#: The tool points down, its fingers move along y of the map.
DOWN = (1.0, 0.0, 0.0, 0.0)
#: s of simulated time; longer than any motion of a test.
LONGEST = 90.0


class MovedRobot:
    """The robot of a cell, or of a bench."""

    def __init__(self, world: World) -> None:
        self.world = world
        self.robot = world.robots[ROBOT]
        self.arm = world.arms[ARM]
        assert self.arm.gripper is not None
        self.gripper = self.arm.gripper
        self.controller = ArmController(world, self.robot, self.arm)

    @property
    def joints(self) -> tuple[str, ...]:
        """Named as drivers of one arm do."""
        return tuple(joint.name.removeprefix("arm/") for joint in self.arm.joints)

    def run(self, motion: Motion, after_step: Callable[[], None] = lambda: None) -> Outcome:
        """Steps until the motion has ended."""
        end = self.world.time + LONGEST
        self.world.motions.add(motion)
        while motion.outcome is None:
            assert self.world.time < end, "the motion does not end"
            self.world.step()
            after_step()
        return motion.outcome

    def trajectory(self, positions: Sequence[float], time: float = 2.0) -> JointMotion:
        """To these positions, in that time."""
        return JointMotion(self.controller, JointGoal(self.joints, (JointPoint(time, tuple(positions)),)))

    def line(self, position: Vector, **more: object) -> CartesianMotion:
        """The tool to that position in the map, pointing down."""
        return CartesianMotion(self.controller, CartesianGoal(Pose(position, DOWN), **more))  # type: ignore[arg-type]

    def grip(self, width: float, effort: float = 0.0) -> GripperMotion:
        return GripperMotion(self.gripper, width, effort)

    def drive(self, x: float, y: float, yaw: float = 0.0) -> BaseMotion:
        return BaseMotion(self.world, self.robot, Pose2D(x, y, yaw))


def succeeded(outcome: Outcome) -> None:
    """Fails with the reason unless that is how it ended."""
    assert outcome.state is State.SUCCEEDED, outcome.text
