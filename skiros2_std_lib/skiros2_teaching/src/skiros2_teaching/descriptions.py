"""Descriptions of the teaching skills."""

from __future__ import annotations

from skiros2_common.core.abstract_skill import SkillDescription
from skiros2_common.core.params import ParamTypes
from skiros2_common.core.world_element import Element

Optional, Required = ParamTypes.Optional, ParamTypes.Required


class TeachingSkill(SkillDescription):
    """Base: an arm, and elements in parameters."""

    def add_arm(self) -> None:
        """Declares the arm, and keeps the skill out of plans."""
        self.addParam("Arm", Element("rparts:ArmDevice"), Required, description="The compliant arm")
        self.setAvailableForPlanning(False)

    def add_taught(self) -> None:
        """Declares the object, the name, and what happens to an element of this name."""
        self.addParam("Object", Element("sumo:Object"), Required, description="What the taught element belongs to")
        self.addParam("Name", str, Required, description="Of the taught element, unique among those of the object")
        self.addParam("Replace", False, Optional, description="Whether to teach an existing element of this name again")

    def add_number(self, key: str, value: float, unit: str, minimum: float, maximum: float, description: str) -> None:
        """Declares an optional number with limits."""
        self.addParam(key, value, Optional, description=description, unit=unit, minimum=minimum, maximum=maximum)


class TeachRelease(TeachingSkill):
    """Releases an arm for guiding by hand, with its weight compensated. Runs until `teach_end`, or its preemption; then
    the arm holds its pose."""

    def createDescription(self) -> None:
        self.add_arm()
        self.add_number("Stiffness", 20.0, "N/m", 0.0, 200.0, "Brakes the tool, whose reference follows it")
        self.add_number("RotationalStiffness", 1.0, "Nm/rad", 0.0, 20.0, "Brakes rotations of the tool")
        self.add_number("MaxForce", 60.0, "N", 1.0, 200.0, "The arm holds above it")
        self.add_number("MaxTorque", 20.0, "Nm", 0.1, 100.0, "The arm holds above it")


class TeleoperateArm(TeachingSkill):
    """Moves the tool by the twists of a hand-held device, until none comes any more, or `teach_end`; then the arm holds
    its pose. Meanwhile poses and paths can be taught."""

    def createDescription(self) -> None:
        self.add_arm()
        self.addParam("Topic", "", Optional, description="geometry_msgs/TwistStamped; empty: /ROBOT/ARM/teleoperation")
        self.add_number("Speed", 0.1, "m/s", 0.001, 0.3, "Maximum of the reference")
        self.add_number("AngularSpeed", 0.5, "rad/s", 0.01, 2.0, "Maximum of the reference")
        self.add_number("Lead", 0.02, "m", 0.001, 0.1, "Maximum distance of the reference from the tool")
        self.add_number("AngularLead", 0.2, "rad", 0.01, 0.5, "Maximum rotation of the reference from the tool")
        self.add_number("WaitTime", 10.0, "s", 0.1, 600.0, "For the first twist, of wall time")
        self.add_number("Stiffness", 600.0, "N/m", 50.0, 2000.0, "Along the axes of the tool")
        self.add_number("RotationalStiffness", 40.0, "Nm/rad", 5.0, 300.0, "About the axes of the tool")
        self.add_number("MaxForce", 40.0, "N", 1.0, 200.0, "The arm holds above it")
        self.add_number("MaxTorque", 15.0, "Nm", 0.1, 100.0, "The arm holds above it")


class TeachEnd(TeachingSkill):
    """Ends the recording of a path, which is stored, and holds a released arm."""

    def createDescription(self) -> None:
        self.add_arm()
        self.addParam("KeepReleased", False, Optional, description="Whether the arm stays released")


class TeachPose(TeachingSkill):
    """Stores the pose of the tool, in the frame of an object."""

    def createDescription(self) -> None:
        self.add_arm()
        self.add_taught()


class TeachLiftingPose(TeachingSkill):
    """Stores the lifting pose of a taught pose: that of the tool, or one above the taught pose."""

    def createDescription(self) -> None:
        self.add_arm()
        self.addParam("Pose", Element("skiros:TaughtPose"), Required, description="The taught pose")
        self.add_number("Height", 0.0, "m", 0.0, 1.0, "Above the taught pose, vertically in the scene; 0: at the tool")


class TeachPath(TeachingSkill):
    """Records the path of the tool and the commands to its gripper until `teach_end`; stores it in the frame of an
    object."""

    def createDescription(self) -> None:
        self.add_arm()
        self.add_taught()
        self.add_number("MaxDuration", 120.0, "s", 1.0, 3600.0, "The recording fails after it")


class TeachUndo(SkillDescription):
    """Undoes the last edit of taught elements, by whatever client."""

    def createDescription(self) -> None:
        self.setAvailableForPlanning(False)


class MoveGripper(TeachingSkill):
    """Moves the fingers of an arm's gripper."""

    def createDescription(self) -> None:
        self.add_arm()
        self.addParam("Width", float, Required, description="Between the fingers", unit="m", minimum=0.0, maximum=0.5)
        self.add_number("Effort", 0.0, "N", 0.0, 1000.0, "Maximum force; 0: the driver's default")


class TaughtMotion(TeachingSkill):
    """Base: a motion to a taught element."""

    def add_motion(self) -> None:
        """Declares the arm with its stiffness, and the limits of the motion."""
        self.add_arm()
        self.add_number("Speed", 0.1, "m/s", 0.005, 0.3, "Maximum of the tool")
        self.add_number("AngularSpeed", 0.5, "rad/s", 0.01, 2.0, "Maximum of the tool")
        self.add_number("Acceleration", 0.5, "m/s2", 0.05, 5.0, "Maximum of the tool")
        self.add_number("Stiffness", 1500.0, "N/m", 50.0, 2000.0, "Along the axes of the tool")
        self.add_number("RotationalStiffness", 100.0, "Nm/rad", 5.0, 300.0, "About the axes of the tool")
        self.add_number("MaxForce", 40.0, "N", 1.0, 200.0, "The driver stops above it")
        self.add_number("MaxTorque", 15.0, "Nm", 0.1, 100.0, "The driver stops above it")
        self.add_number("Tolerance", 0.003, "m", 0.0005, 0.05, "Distance from the goal at the end")


class MoveToTaughtPose(TaughtMotion):
    """Moves the tool to a taught pose, relative to its object as it is now."""

    def createDescription(self) -> None:
        self.add_motion()
        self.addParam("Pose", Element("skiros:TaughtPose"), Required, description="A taught pose or a lifting pose")
        self.addParam("ViaLifting", True, Optional, description="Whether to move by the lifting pose, if there is one")


class ReplayTaughtPath(TaughtMotion):
    """Moves the tool to the start of a taught path and along it, relative to its object as it is now, with the commands
    to the gripper."""

    def createDescription(self) -> None:
        self.add_motion()
        self.addParam("Path", Element("skiros:TaughtPath"), Required, description="The taught path")
        self.add_number("Scaling", 1.0, "", 0.05, 10.0, "Of the taught speed, within the limits")
        self.addParam("FromHere", False, Optional, description="Whether the path starts where the tool is")
        self.addParam(
            "Goal", Element("skiros:TransformationPose"), Optional, description="Where the path ends; none: as taught"
        )
