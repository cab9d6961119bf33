"""The base of primitives that regulate a force along the tool axis while they move across it."""

from __future__ import annotations

import logging
import math

from skiros2_common.core.errors import Refused
from skiros2_contact_skills.contact_primitive import ContactPrimitive, axis_of, difference, dot, moved, pressed
from skiros2_contact_skills.core.part_poses import held_frame
from skiros2_contact_skills.core.tick_force import TickForce
from skiros2_motion.core.compliant_arm import ArmState, RegulatesForce
from skiros2_motion.core.force_control import ForceGoal
from skiros2_motion.core.geometry import IDENTITY, Pose, Vector, rotated

log = logging.getLogger(__name__)

#: Lowest rate of a loop for forces (Hz): the tool moves by a part of the surface's unevenness between its updates.
LEAST_RATE = 5.0
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
    #: Stiffness about the tool axis (Nm/rad); None for that of the parameters, at least 30.
    turning: float | None = None

    def begin(self, state: ArmState) -> None:
        self._check_rate()
        self.set_stiffness(_STIFFNESS, self.turning)
        self._tip = IDENTITY.position
        if "Part" in self.params:
            part, feature = self.optional_element("Part"), self.optional_element("Feature")
            self._tip = held_frame(self.wmi, part, feature).position
        self._ticks: TickForce | None = None
        self._has_touched = False

    def _check_rate(self) -> None:
        """Logs at which rate an adapter regulates forces.

        :raises Refused: it is too low.
        """
        rate, arm = self.abilities.force_rate, self.label_of("Arm")
        if rate < LEAST_RATE:
            low = f"forces are not regulated at {rate:.1f} Hz, the rate of its states"
            raise Refused(f"{low}: {LEAST_RATE:g} Hz are needed")
        if not isinstance(self.arm, RegulatesForce):
            log.info("%s of %s: forces are regulated at the ticks", arm, self.label)
        elif rate < math.inf:
            how = "the driver does not regulate forces, its adapter does"
            log.info("%s of %s: %s at %.0f Hz", arm, self.label, how, rate)

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
