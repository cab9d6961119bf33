"""Descriptions of motions in contact: what they do, their parameters with units and limits."""

from __future__ import annotations

from skiros2_common.core.abstract_skill import SkillDescription
from skiros2_common.core.params import ParamTypes
from skiros2_common.core.skill_description import ParamOptions
from skiros2_common.core.world_element import Element

Optional, Required, Inferred = ParamTypes.Optional, ParamTypes.Required, ParamTypes.Inferred


def add_axis_limits(description: SkillDescription) -> None:
    """Declares the limits along and about single axes of the tool: of a motion, or of all motions of a compound."""
    along = "Three limits: {} x, y, z of the tool; 0: none"
    description.addParam("MaxForceAxes", [float], Optional, description=along.format("along"), unit="N", minimum=0)
    description.addParam("MaxTorqueAxes", [float], Optional, description=along.format("about"), unit="Nm", minimum=0)


class ContactMotion(SkillDescription):
    """Base: an arm, its stiffness, and the limits of the wrench at which its driver stops."""

    def add_arm(self, stiffness: float, rotational_stiffness: float) -> None:
        """Declares the arm, its stiffness (N/m, Nm/rad) and the limits."""
        self.addParam("Arm", Element("rparts:ArmDevice"), Required, description="The compliant arm")
        self.addParam(
            "Stiffness", stiffness, Optional, description="Across the tool axis", unit="N/m", minimum=0, maximum=2000
        )
        self.addParam(
            "RotationalStiffness",
            rotational_stiffness,
            Optional,
            description="About axes across the tool axis",
            unit="Nm/rad",
            minimum=0,
            maximum=300,
        )
        # without defaults: a compound gives all its motions the same ones
        self.addParam("MaxForce", float, Optional, description="The driver stops above it (40)", unit="N", minimum=1)
        self.addParam(
            "MaxTorque", float, Optional, description="The driver stops above it (15)", unit="Nm", minimum=0.1
        )
        add_axis_limits(self)
        self.addParam("PeakForce", [float], Optional, description="Result: the largest measured force", unit="N")

    def add_number(self, key: str, value: float, unit: str, minimum: float, maximum: float, description: str) -> None:
        """Declares an optional number with limits."""
        self.addParam(key, value, Optional, description=description, unit=unit, minimum=minimum, maximum=maximum)

    def add_fitted(self, key: str, unit: str, minimum: float, maximum: float, description: str) -> None:
        """Declares an optional number without a default: the world model has it, see `fit.py`."""
        self.addParam(key, float, Optional, description=description, unit=unit, minimum=minimum, maximum=maximum)

    def add_fit(self) -> None:
        """Declares the part and the bore from which such numbers come."""
        self.addParam("Part", Element("skiros:Manipulatable"), Optional, description="The held part")
        self.addParam("Bore", Element("skiros:Bore"), Optional, description="Where it goes")

    def add_surface(self, description: str) -> None:
        """Declares the point of contact, which motions until contact report and searches and insertions use."""
        self.addParam("Surface", [float], Optional, description=description)


class CompliantLine(ContactMotion):
    """Base of compliant motions on a straight line."""

    def add_line(self, height: float, description: str) -> None:
        """Declares height (m), speed and tolerance."""
        self.add_arm(1000.0, 60.0)
        self.add_number("Height", height, "m", -0.1, 0.5, description)
        self.add_number("Speed", 0.1, "m/s", 0.005, 0.3, "Of the tool")
        self.add_number("Tolerance", 0.004, "m", 0.0005, 0.05, "Of the position at the end")
        self.addParam("ZeroSensor", False, Optional, description="At the end, where the hand is free of contact")


class ApproachGrasp(CompliantLine):
    """Moves the tool to a grasping pose of a part, or above it."""

    def createDescription(self) -> None:
        self.add_line(0.0, "Above the grasping pose, back along the tool axis")
        self.addParam("Grasp", Element("skiros:GraspingPose"), Required, description="Pose of the tool on the part")


class RetractTool(CompliantLine):
    """Moves the tool back along its axis; yields to what holds it."""

    def createDescription(self) -> None:
        self.add_line(0.12, "Distance")


class RetractAfterFailure(CompliantLine):
    """Moves the tool back along its axis, and fails: for the end of a selector."""

    def createDescription(self) -> None:
        self.is_reaction = True
        self.add_line(0.08, "Distance")


class HoldPose(ContactMotion):
    """Holds the pose of the tool with a stiffness, and presses; until it is preempted, or for a duration."""

    def createDescription(self) -> None:
        self.add_arm(1000.0, 60.0)
        self.add_number("Force", 0.0, "N", 0.0, 30.0, "Exerted along the tool axis")
        self.add_number("Duration", 0.0, "s", 0.0, 3600.0, "0: until it is preempted")
        self.add_number("MaxDistance", 0.01, "m", 0.001, 0.2, "From the held pose, at which the motion fails")


class ApplyForce(ContactMotion):
    """Exerts a force along the tool axis until it was measured for some time."""

    def createDescription(self) -> None:
        self.add_arm(1000.0, 60.0)
        self.add_number("Force", 10.0, "N", 1.0, 30.0, "Exerted along the tool axis")
        self.add_number("Tolerance", 2.0, "N", 0.1, 10.0, "Of the measured force")
        self.add_number("Duration", 0.5, "s", 0.1, 600.0, "For which the force must be measured")
        self.add_number("MaxDistance", 0.02, "m", 0.001, 0.2, "From the start, at which the motion fails")


class PullTest(ContactMotion):
    """Pulls a part back along the tool axis; succeeds if it holds."""

    def createDescription(self) -> None:
        self.add_arm(1000.0, 60.0)
        self.add_number("Force", 10.0, "N", 1.0, 30.0, "With which it is pulled")
        self.add_number("Duration", 0.5, "s", 0.1, 60.0, "For which the part must withstand the force")
        self.add_number("MaxDistance", 0.003, "m", 0.0005, 0.05, "At which the part does not hold")


class IdentifyPayload(ContactMotion):
    """Identifies mass and centre of mass of what the hand holds: turns the tool about its origin, free of contact."""

    def createDescription(self) -> None:
        self.add_arm(1000.0, 100.0)
        self.add_number("Angle", 25.0, "deg", 10.0, 60.0, "Of the turns about x and y of the tool, to both sides")
        self.addParam(
            "Part", Element("skiros:Manipulatable"), Optional, description="The held part, whose skiros:Weight is set"
        )
        self.addParam("Mass", [float], Optional, description="Result", unit="kg")
        self.addParam("CentreOfMass", [float], Optional, description="Result: in the tool frame (m)")


class ApproachTarget(CompliantLine):
    """Moves a held part, or the tool, above a target and aligns their axes; yields to what is in the way."""

    def createDescription(self) -> None:
        self.add_line(0.01, "Above the target, of the lower end of the part")
        self.addParam("Target", Element("skiros:TransformationPose"), Required, description="A bore or another pose")
        self.addParam("Part", Element("skiros:Manipulatable"), Optional, description="The held part; none: the tool")
        self.addParam(
            "Feature",
            Element("skiros:TransformationPose"),
            Optional,
            description="Frame of the part that goes there; none: its lower end",
        )
        self.add_surface("Result: position of the tool with the part at the target, in the arm's base frame (m)")


class MoveUntilContact(ContactMotion):
    """Moves the tool along its axis until it touches something."""

    def createDescription(self) -> None:
        self.add_arm(1000.0, 60.0)
        self.add_number("Speed", 0.015, "m/s", 0.001, 0.1, "Of the tool")
        self.add_number("ContactForce", 4.0, "N", 0.5, 30.0, "Ends the motion, along the tool axis")
        self.add_number("MaxDistance", 0.05, "m", 0.001, 0.3, "The motion fails without contact after it")
        self.addParam(
            "NeedsContact", True, Optional, description="Whether the motion fails without contact; else it ends there"
        )
        self.add_surface("Result: position of the tool at the contact, in the arm's base frame (m)")


class SpiralSearch(ContactMotion):
    """Presses a part on a surface and moves it on a spiral until it drops into an opening."""

    def createDescription(self) -> None:
        self.add_arm(700.0, 60.0)
        self.add_surface("Position of the tool at the contact, in the arm's base frame (m)")
        self.add_number("Force", 5.0, "N", 0.0, 30.0, "Pressed on the surface")
        self.add_fit()
        self.add_fitted("Radius", "m", 0.0, 0.07, "Of the spiral; 0: the search presses only")
        self.add_number("PathDistance", 0.0006, "m", 0.0, 0.03, "Between turns; 0: the search presses only")
        self.add_number("PathVelocity", 0.012, "m/s", 0.0, 0.3, "Along the spiral; 0: the search presses only")
        self.add_fitted("DropDepth", "m", 0.0002, 0.02, "Below the surface, at which the opening is found")
        self.add_number("SearchTime", 15.0, "s", 0.5, 120.0, "The search fails after it")
        self.add_number("TotalTime", 30.0, "s", 0.5, 600.0, "Of all attempts of a task to find the opening")
        self.addParam(
            "Searched", [float], Optional, description="Result: time of attempts without an opening", unit="s"
        )


class InsertPart(ContactMotion):
    """Pushes a part into its bore: yielding across the axis and wobbling, with a force that grows with the depth."""

    def createDescription(self) -> None:
        self.add_arm(300.0, 20.0)
        self.add_surface("Position of the tool at the contact, in the arm's base frame (m)")
        self.add_fit()
        self.add_fitted("Depth", "m", 0.001, 0.3, "Below the surface, at which the part is inserted")
        self.add_number("Tolerance", 0.0005, "m", 0.0001, 0.01, "Of the depth")
        self.add_number("EntryForce", 8.0, "N", 1.0, 30.0, "Up to the entry depth")
        self.add_number("EntryDepth", 0.008, "m", 0.0, 0.3, "Below the surface")
        self.add_number("Force", 18.0, "N", 1.0, 30.0, "From the entry depth on")
        self.add_number("SeatForce", 6.0, "N", 0.0, 30.0, "Measured on the floor of the bore: the part is seated")
        self.add_number("Speed", 0.04, "m/s", 0.001, 0.2, "Of the part")
        self.add_number("TiltAngle", 3.0, "deg", 0.0, 10.0, "Of the wobble about the tool axis")
        self.add_number("TiltFrequency", 0.7, "Hz", 0.05, 2.0, "Of the wobble")
        self.add_number("Patience", 1.5, "s", 0.2, 30.0, "Without progress, after which the insertion fails")
        self.addParam("Evidence", dict, Optional, [ParamOptions.Output], description="Result: see docs/contact.md")
