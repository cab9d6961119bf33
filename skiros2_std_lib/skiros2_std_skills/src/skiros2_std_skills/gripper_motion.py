"""The base of primitives for grippers."""

from __future__ import annotations

from actionlib_msgs.msg import GoalStatus

from control_msgs.msg import GripperCommandAction, GripperCommandGoal, GripperCommandResult
from skiros2_common.core.params import ParamTypes
from skiros2_std_skills.core.devices import name_of
from skiros2_std_skills.core.driver_names import GRIPPER
from skiros2_std_skills.drivers import DriverAction

#: Progress code: the gripper holds nothing, or another object.
NOT_HELD = -111


class GripperMotion(DriverAction):
    """Base of the primitives that move a gripper by `control_msgs/GripperCommand`, where the position is the width
    between the fingers (m). Parameters: `Robot`, `Gripper`; for `grip`, `Effort`."""

    def address(self) -> tuple[str, type]:
        return name_of(GRIPPER, self.element("Robot"), self.element("Gripper")), GripperCommandAction

    def command(self, width: float, effort: float) -> GripperCommandGoal:
        """Creates a goal: width (m) and force (N)."""
        goal = GripperCommandGoal()
        goal.command.position, goal.command.max_effort = width, effort
        return goal

    def grip(self) -> GripperCommandGoal:
        """Creates a goal that closes the gripper."""
        return self.command(0.0, self.value("Effort"))

    def add_effort(self) -> None:
        """Declares the gripping force."""
        self.addParam("Effort", 40.0, ParamTypes.Optional, description="Gripping force", unit="N", minimum=0)

    def ended_well(self, status: int, msg: GripperCommandResult) -> bool:
        """Whether the driver succeeded; stalled fingers count as success."""
        return status == GoalStatus.SUCCEEDED or bool(getattr(msg, "stalled", False))
