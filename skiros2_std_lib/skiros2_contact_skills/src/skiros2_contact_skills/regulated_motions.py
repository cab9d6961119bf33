"""Primitives that regulate a force: press, wipe, follow a surface, screw."""

from __future__ import annotations

import math

from skiros2_common.core.abstract_skill import State
from skiros2_contact_skills.contact_primitive import (
    NO_CONTACT,
    NO_PROGRESS,
    NOT_HELD,
    NOT_REACHED,
    axis_of,
    difference,
    dot,
    force_of,
    forces,
    pressed,
)
from skiros2_contact_skills.regulated_descriptions import FollowSurface, Press, Screw, Wipe
from skiros2_contact_skills.regulated_motion import SOFT, RegulatedMotion
from skiros2_motion.core.compliant_arm import ArmState
from skiros2_motion.core.geometry import Pose, multiplied

#: Admittance on slopes (m/(s N)); speed along the tool axis on a surface (m/s).
_QUICK, _SURFACE_SPEED = 0.05, 0.05
#: Acceleration of strokes (m/s2), and time from the contact to the first one (s).
_ACCELERATION, _SETTLING_TIME = 1.0, 0.3
#: Stiffness of a wall that the side of the hand meets (N/m): two faces, stiffer than what a fingertip meets.
_WALL_STIFFNESS = 5e6
#: Speed of a screw per wanted torque (rad/s per Nm): at a stop, spring and inertia add to the torque until a
#: tick ends the motion. Stiffness about its axis (Nm/rad), and the least per wanted torque: errors are 0.5 rad at most.
_TURN_SPEED, _TURNING, _TURNING_PART = 0.4, 8.0, 3.0


class press(RegulatedMotion):
    """Moves to the contact and presses until the force was measured for the duration."""

    def createDescription(self) -> None:
        self.setDescription(Press(), self.__class__.__name__)

    def begin(self, state: ArmState) -> None:
        super().begin(state)
        self.press_with(self.value("Force"), self.contact_speed(), SOFT)
        self._touched_at = self._held_since = math.inf

    def move(self, state: ArmState, dt: float) -> State:
        self.follow(state, self.start.pose, dt)
        self.touches(state)
        if self.advance(state) > self.value("MaxDistance"):
            code = NOT_HELD if self.has_touched else NO_CONTACT
            return self.fail(f"Moved by {1000 * self.advance(state):.1f} mm ({forces(state)})", code)
        if not self.has_touched:
            return self.step(f"Approaching: {1000 * self.advance(state):.1f} mm, {forces(state)}")
        self._touched_at = min(self._touched_at, state.stamp)
        is_pressed = abs(pressed(state) - self.value("Force")) <= self.value("Tolerance")
        self._held_since = min(self._held_since, state.stamp) if is_pressed else math.inf
        if state.stamp - self._held_since >= self.value("Duration"):
            return self.success(f"Pressed for {state.stamp - self._held_since:.1f} s ({forces(state)})")
        if state.stamp - self._touched_at > self.value("Patience"):
            return self.fail(f"{self.value('Force'):g} N are not reached ({forces(state)})", NO_PROGRESS)
        return self.step(f"Pressing: {forces(state)}")


class _Stroke(RegulatedMotion):
    """Moves to the contact, and then across the tool axis."""

    def begin(self, state: ArmState) -> None:
        super().begin(state)
        self.press_with(self.value("Force"), self.contact_speed(), SOFT)
        self._touched_at: float | None = None
        self._gone = self._speed = 0.0
        self._fastest = self.value("Speed")

    def is_on_surface(self, state: ArmState) -> bool:
        """Returns whether the strokes can begin, some time after the contact."""
        if self.touches(state) and self._touched_at is None:
            self._touched_at = state.stamp
        if self._touched_at is None or state.stamp - self._touched_at < _SETTLING_TIME:
            return False
        self.press_with(self.value("Force"), _SURFACE_SPEED, _QUICK)
        return True

    def approach(self, state: ArmState, dt: float) -> State:
        """One tick before the strokes."""
        self.follow(state, self.start.pose, dt)
        if self.advance(state) > self.value("MaxDistance"):
            return self.fail(f"No contact within {1000 * self.advance(state):.1f} mm ({forces(state)})", NO_CONTACT)
        return self.step(f"Approaching: {1000 * self.advance(state):.1f} mm, {forces(state)}")

    def gone(self, dt: float, length: float) -> float:
        """Returns the distance on the way after another `dt` seconds, with limited speed and acceleration (m)."""
        braking = math.sqrt(2.0 * _ACCELERATION * max(0.0, length - self._gone))
        self._speed = min(self._fastest, self._speed + _ACCELERATION * dt, braking)
        self._gone = min(length, self._gone + self._speed * dt)
        if length - self._gone < 1e-4:
            self._gone = length
        return self._gone


class wipe(_Stroke):
    """Wipes to and fro."""

    def createDescription(self) -> None:
        self.setDescription(Wipe(), self.__class__.__name__)

    def begin(self, state: ArmState) -> None:
        super().begin(state)
        self._strokes = 0
        self._is_wiping = False

    def move(self, state: ArmState, dt: float) -> State:
        self._is_wiping = self._is_wiping or self.is_on_surface(state)
        if not self._is_wiping:
            return self.approach(state, dt)
        if abs(self.advance(state)) > self.value("MaxDistance"):
            return self.fail(f"{1000 * self.advance(state):.1f} mm along the tool axis ({forces(state)})", NOT_HELD)
        length = self.value("Distance")
        gone = self.gone(dt, length)
        self.follow(state, self.across(gone if self._strokes % 2 == 0 else length - gone), dt)
        if gone == length:
            self._strokes += 1
            self._gone = self._speed = 0.0
            if self._strokes >= self.value("Strokes"):
                return self.success(f"Wiped {self._strokes} times ({forces(state)})")
        return self.step(f"Wiping: {1000 * gone:.0f} mm, {forces(state)}")


class follow_surface(_Stroke):
    """Moves along the surface to a wall or an edge."""

    def createDescription(self) -> None:
        self.setDescription(FollowSurface(), self.__class__.__name__)

    def begin(self, state: ArmState) -> None:
        super().begin(state)
        self._depth: float | None = None  # of the last contact; None: before the way
        way = difference(self.across(1.0).position, state.pose.position)
        self._fastest = self.permitted(self.value("Speed"), way, stiffness=_WALL_STIFFNESS)

    def move(self, state: ArmState, dt: float) -> State:
        if self._depth is None:
            if not self.is_on_surface(state):
                return self.approach(state, dt)
            self._depth = self.advance(state)
        wanted = self.across(self.gone(dt, self.value("Distance")))
        self.follow(state, wanted, dt)
        if self.touches(state):
            self._depth = self.advance(state)
        across = math.sqrt(max(0.0, force_of(state) ** 2 - pressed(state) ** 2))
        if across >= self.value("WallForce"):
            return self._ended("wall", state)
        if self.advance(state) - self._depth >= self.value("EdgeDepth"):
            return self._ended("edge", state)
        if self._gone == self.value("Distance"):
            return self._ended("distance", state)
        return self.step(f"Following the surface: {1000 * self._gone:.0f} mm, {forces(state)}")

    def _ended(self, end: str, state: ArmState) -> State:
        self.params["End"].values = [end]
        self.params["Surface"].values = list(state.pose.position)
        return self.success(f"Followed the surface for {1000 * self._gone:.0f} mm, to: {end} ({forces(state)})")


class screw(RegulatedMotion):
    """Turns until the torque is measured. A tool has little inertia about its axis: with more stiffness and damping,
    the reference leads it so far that a screw that stops gets several times the torque before the next tick."""

    damping = (2.0, 2.0, 1.0, 2.0, 2.0, 0.2)

    def createDescription(self) -> None:
        self.setDescription(Screw(), self.__class__.__name__)

    def begin(self, state: ArmState) -> None:
        self.turning = max(_TURNING, _TURNING_PART * self.value("Torque"))
        super().begin(state)
        self.press_with(self.value("Force"), self.contact_speed(), SOFT)
        self._turned = 0.0
        self._speed = min(self.value("TurnSpeed"), math.degrees(_TURN_SPEED * self.value("Torque")))

    def move(self, state: ArmState, dt: float) -> State:
        self.touches(state)
        if self.advance(state) > self.value("MaxDistance"):
            code = NOT_HELD if self.has_touched else NO_CONTACT
            return self.fail(f"Moved by {1000 * self.advance(state):.1f} mm ({forces(state)})", code)
        if self.has_touched:
            self._turned = min(abs(self.value("Angle")), self._turned + self._speed * dt)
        way = math.copysign(1.0, self.value("Angle"))
        half = math.radians(way * self._turned) / 2.0
        turn = (0.0, 0.0, math.sin(half), math.cos(half))
        position, orientation = self.start.pose
        self.follow(state, Pose(position, multiplied(orientation, turn)), dt)
        torque = -way * dot(axis_of(state), state.wrench[3:])
        if torque >= self.value("Torque"):
            return self.success(f"Turned by {self._turned:.0f} deg to {torque:.2f} Nm ({forces(state)})")
        if self._turned >= abs(self.value("Angle")):
            return self.fail(f"{torque:.2f} Nm after {self._turned:.0f} deg ({forces(state)})", NOT_REACHED)
        return self.step(f"Screwing: {self._turned:.0f} deg, {torque:.2f} Nm, {forces(state)}")
