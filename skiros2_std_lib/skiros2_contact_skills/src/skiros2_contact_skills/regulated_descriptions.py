"""Descriptions of motions that regulate a force."""

from __future__ import annotations

from skiros2_common.core.params import ParamTypes
from skiros2_common.core.world_element import Element
from skiros2_contact_skills.descriptions import ContactMotion

Optional = ParamTypes.Optional


class RegulatedContact(ContactMotion):
    """Base: a force along the tool axis, at the tip of a held part."""

    def add_force(self, force: float, stiffness: float = 1000.0) -> None:
        """Declares the arm, the force (N), the part and the speed before the contact.

        :param stiffness: across the tool axis (N/m).
        """
        self.add_arm(stiffness, 100.0)
        self.add_number("Force", force, "N", 0.5, 30.0, "Regulated along the tool axis")
        self.add_number("ContactSpeed", 0.015, "m/s", 0.001, 0.1, "To the surface")
        self.add_number("MaxDistance", 0.05, "m", 0.001, 0.3, "Along the tool axis, at which the motion fails")
        self.addParam("ContactStiffness", float, Optional, description="If known: permits a higher speed", unit="N/m")
        self.addParam("Part", Element("skiros:Manipulatable"), Optional, description="The held part; none: the tool")
        self.addParam(
            "Feature", Element("skiros:TransformationPose"), Optional, description="Its tip; none: its lower end"
        )

    def add_way(self, distance: float, speed: float, description: str) -> None:
        """Declares direction, distance (m) and speed (m/s) across the tool axis."""
        self.add_number("Direction", 0.0, "deg", -360.0, 360.0, "Across the tool axis, from x of the tool")
        self.add_number("Distance", distance, "m", 0.001, 1.0, description)
        self.add_number("Speed", speed, "m/s", 0.001, 0.3, "Across the tool axis")


class Press(RegulatedContact):
    """Presses something, as a button, until the force was measured for some time."""

    def createDescription(self) -> None:
        self.add_force(8.0)
        self.add_number("Tolerance", 1.0, "N", 0.1, 10.0, "Of the measured force")
        self.add_number("Duration", 0.3, "s", 0.05, 600.0, "For which the force must be measured")
        self.add_number("Patience", 5.0, "s", 0.2, 600.0, "For the force, after the contact")


class Wipe(RegulatedContact):
    """Moves to and fro on a surface of unknown height and slope, with a force."""

    def createDescription(self) -> None:
        self.add_force(5.0, stiffness=400.0)
        self.add_way(0.1, 0.1, "Of a stroke")
        self.add_number("Strokes", 1.0, "", 1.0, 1000.0, "To and fro, each of the distance")


class FollowSurface(RegulatedContact):
    """Moves along a surface until it meets a wall or leaves an edge, or for a distance."""

    def createDescription(self) -> None:
        self.add_force(5.0, stiffness=400.0)
        self.add_way(0.1, 0.03, "At which the motion ends without wall and edge")
        self.add_number("WallForce", 8.0, "N", 1.0, 30.0, "Against the motion: it meets a wall")
        self.add_number("EdgeDepth", 0.003, "m", 0.0005, 0.1, "Without contact: it leaves an edge")
        self.addParam("End", str, Optional, description="Result: wall, edge or distance")
        self.add_surface("Result: position of the tool at the end, in the arm's base frame (m)")


class Screw(RegulatedContact):
    """Turns the tool about its axis, with a force along it, until a torque is measured."""

    def createDescription(self) -> None:
        self.add_force(5.0)
        self.add_number("Torque", 1.0, "Nm", 0.05, 10.0, "About the tool axis, which ends the motion")
        self.add_number("Angle", 90.0, "deg", -360.0, 360.0, "At which the motion fails; its sign is the direction")
        self.add_number("TurnSpeed", 45.0, "deg/s", 1.0, 180.0, "About the tool axis")
