"""The base of primitives that regulate a force along the tool axis while they move across it."""

from __future__ import annotations

import math

from skiros2_contact_skills.contact_primitive import ContactPrimitive, axis_of, difference, dot, moved, pressed
from skiros2_contact_skills.core.part_poses import held_frame
from skiros2_contact_skills.core.tick_force import TickForce
from skiros2_motion.core.compliant_arm import ArmState, RegulatesForce
from skiros2_motion.core.force_control import ForceGoal
from skiros2_motion.core.geometry import IDENTITY, Pose, Vector, rotated

#: Stiffness along the tool axis, whose reference the loop leads (N/m).
_STIFFNESS = 2000.0
#: Admittance of a contact at speed (m/(s N)).
SOFT = 0.005
#: Force from which on the tool touches something (N).
TOUCHING = 1.0


class RegulatedMotion(ContactPrimitive):
    """Presses along the tool axis with a regulated force. The compliance frame is at the tip of the held part, with the
    axes of the tool. The driver regulates, or else the ticks."""

    damping = (2.0, 2.0, 1.0, 2.0, 2.0, 2.0)

    def begin(self, state: ArmState) -> None:
        self.set_stiffness(_STIFFNESS)
        self._tip = IDENTITY.position
        if "Part" in self.params:
            part, feature = self.optional_element("Part"), self.optional_element("Feature")
            self._tip = held_frame(self.wmi, part, feature).position
        self._ticks: TickForce | None = None
        self._has_touched = False

    def press_with(self, force: float, speed: float, admittance: float) -> None:
        """Regulates the force along the tool axis from now on.

        :param force: N.
        :param speed: maximum speed along the axis (m/s).
        :param admittance: see `ForceGoal` (m/(s N)).
        """
        goal = ForceGoal((0.0, 0.0, force), speed=speed, admittance=admittance, tip=self._tip)
        if isinstance(self.arm, RegulatesForce):
            self.arm.set_force_control(goal)
        elif self._ticks is None:
            self._ticks = TickForce(goal)
        else:
            self._ticks.change(goal)

    def follow(self, state: ArmState, wanted: Pose, dt: float) -> None:
        """Sets the reference of the tool across its axis, and its orientation."""
        if self._ticks is not None:
            across = self.value("Stiffness")
            wanted = self._ticks.reference(state, wanted, (across, across, _STIFFNESS), dt)
        self.arm.set_reference(wanted)

    def touches(self, state: ArmState) -> bool:
        """Returns whether the tool touches something now; `has_touched` is true from then on."""
        touching = pressed(state) >= TOUCHING
        self._has_touched = self._has_touched or touching
        return touching

    @property
    def has_touched(self) -> bool:
        """Whether the tool has touched something since the start."""
        return self._has_touched

    def contact_speed(self) -> float:
        """Returns the speed with which the tool moves to the surface (m/s)."""
        stiffness = self.number("ContactStiffness", 0.0) or None
        return self.permitted(self.value("ContactSpeed"), axis_of(self.start), stiffness=stiffness)

    def advance(self, state: ArmState) -> float:
        """Returns how far the tool has moved along its axis since the start (m)."""
        return dot(axis_of(self.start), difference(state.pose.position, self.start.pose.position))

    def across(self, distance: float) -> Pose:
        """Returns the pose of the start, moved in the parameter `Direction` across the tool axis (m)."""
        angle = math.radians(self.value("Direction"))
        way: Vector = rotated(self.start.pose.orientation, (math.cos(angle), math.sin(angle), 0.0))
        return Pose(moved(self.start.pose.position, way, distance), self.start.pose.orientation)
