"""Primitives of motions in contact: until contact, spiral search, insertion."""

from __future__ import annotations

import math

from skiros2_common.core.abstract_skill import State
from skiros2_contact_skills.contact_primitive import (
    NO_CONTACT,
    NO_PROGRESS,
    NOT_FOUND,
    ContactPrimitive,
    axis_of,
    difference,
    dot,
    forces,
    moved,
    pressed,
)
from skiros2_contact_skills.descriptions import InsertPart, MoveUntilContact, SpiralSearch
from skiros2_contact_skills.pose_errors import position_deviation
from skiros2_motion.core.compliant_arm import ArmState
from skiros2_motion.core.geometry import Pose, Quaternion, multiplied
from skiros2_motion.core.spiral import SpiralGoal

#: Stiffness along the tool axis of motions until contact (N/m).
_APPROACH_STIFFNESS = 800.0
#: Stiffness along the tool axis of a search (N/m): it only damps, as the reference follows the tool.
_FOLLOWING_STIFFNESS = 300.0
#: A search ends after that many passes between the centre and the radius, and the time until the part is pressed (s).
_PASSES, _PRESSING_TIME = 2.0, 2.0
#: Radius of a search for a bore with an estimated pose: standard deviations, and errors of grasp and arm (m).
_DEVIATIONS, _OTHER_ERRORS = 3.0, 0.002
#: Stiffness along the tool axis of insertions (N/m).
_INSERTION_STIFFNESS = 2000.0
#: An insertion brakes within this time before its end (s), down to this speed (m/s).
_BRAKING_TIME, _SLOWEST = 0.4, 0.005
#: Maximum distance of the reference beyond the wanted depth (m).
_BEYOND = 0.005
#: Depth that counts as progress of an insertion (m).
_PROGRESS = 0.0005
#: Time constant with which the reference follows the tool across the axis during an insertion (s).
_FOLLOW_TIME = 0.3


class move_until_contact(ContactPrimitive):
    """Moves the reference along the tool axis at a constant speed until the measured force has grown enough."""

    def createDescription(self) -> None:
        self.setDescription(MoveUntilContact(), self.__class__.__name__)

    def begin(self, state: ArmState) -> None:
        self.set_stiffness(_APPROACH_STIFFNESS)
        self._speed = self.permitted(self.value("Speed"), axis_of(state), self.value("ContactForce"))
        self._travelled = 0.0

    def move(self, state: ArmState, dt: float) -> State:
        force = pressed(state) - pressed(self.start)
        if force >= self.value("ContactForce"):
            self.params["Surface"].values = list(state.pose.position)
            return self.success(f"Contact with {forces(state)} after {1000 * self._travelled:.1f} mm")
        if self._travelled > self.value("MaxDistance"):
            text = f"No contact within {1000 * self._travelled:.1f} mm ({forces(state)})"
            return self.fail(text, NO_CONTACT) if self.value("NeedsContact") else self.success(text)
        self._travelled += self._speed * dt
        position = moved(self.start.pose.position, axis_of(self.start), self._travelled)
        self.arm.set_reference(Pose(position, self.start.pose.orientation))
        return self.step(f"Moving until contact: {1000 * self._travelled:.1f} mm, {forces(state)}")


class spiral_search(ContactPrimitive):
    """Presses and lets the driver add a spiral to the reference, which follows the tool along its axis only."""

    def createDescription(self) -> None:
        self.setDescription(SpiralSearch(), self.__class__.__name__)

    def begin(self, state: ArmState) -> None:
        self.set_stiffness(_FOLLOWING_STIFFNESS)
        distance, velocity = self.value("PathDistance"), self.value("PathVelocity")
        self._radius = min(self.value("Radius"), self._largest_error())
        self._before = self.number("Searched", 0.0)
        self._time = min(self.value("SearchTime"), self.value("TotalTime") - self._before)
        if self._radius and distance and velocity:  # a driver refuses a spiral of a point
            self.arm.start_spiral(SpiralGoal(self._radius, distance, velocity, allow_decrease=True))
            self._time = min(self._time, _PASSES * math.pi * self._radius**2 / distance / velocity + _PRESSING_TIME)

    def _largest_error(self) -> float:
        """Returns the largest expected error of the position of the opening (m); inf if its pose was not estimated."""
        bore = self.optional_element("Bore")
        deviation = None if bore is None else position_deviation(self.wmi, bore)
        return math.inf if deviation is None else _DEVIATIONS * deviation + _OTHER_ERRORS

    def move(self, state: ArmState, dt: float) -> State:
        self.arm.set_wrench((0.0, 0.0, self.value("Force")))
        depth = self.depth(state)
        if depth >= self.value("DropDepth"):
            self.params["Searched"].values = [0.0]
            return self.success(f"The opening is found, {1000 * depth:.1f} mm deep ({forces(state)})")
        passed = state.stamp - self.start.stamp
        self.params["Searched"].values = [self._before + passed]
        if passed > self._time:
            text = f"No opening within {1000 * self._radius:.1f} mm in {passed:.1f} s ({forces(state)})"
            return self.fail(text, NOT_FOUND)
        axis = axis_of(self.start)
        along = dot(axis, difference(state.pose.position, self.start.pose.position))
        position = moved(self.start.pose.position, axis, along)
        self.arm.set_reference(Pose(position, self.start.pose.orientation))
        return self.step(f"Searching for the opening: {passed:.1f} s, {1000 * depth:.2f} mm deep, {forces(state)}")


class insert_part(ContactPrimitive):
    """Pushes with a force profile. The tool yields across its axis, its reference follows it slowly, and its axis
    wobbles on a cone, which frees a jammed part."""

    # with the default damping a soft tool would hardly wobble
    damping = (2.0, 2.0, 2.0, 0.5, 0.5, 0.5)

    def createDescription(self) -> None:
        self.setDescription(InsertPart(), self.__class__.__name__)

    def begin(self, state: ArmState) -> None:
        self.set_stiffness(_INSERTION_STIFFNESS)
        self._best = self._target = self.depth(state)
        self._best_at = state.stamp
        self._centre = state.pose.position

    def move(self, state: ArmState, dt: float) -> State:
        depth, wanted = self.depth(state), self.value("Depth")
        if depth > self._best + _PROGRESS:
            self._best, self._best_at = depth, state.stamp
        is_deep = depth >= wanted - self.value("Tolerance")
        is_stuck = state.stamp - self._best_at > self.value("Patience")
        # a part that has slipped in the hand is not as deep as the tool: the floor is felt
        if is_deep and (is_stuck or pressed(state) >= self.value("SeatForce")):
            return self.success(f"Inserted {1000 * depth:.1f} mm deep ({forces(state)})")
        if is_stuck:
            return self.fail(f"Jammed {1000 * depth:.1f} of {1000 * wanted:.1f} mm deep ({forces(state)})", NO_PROGRESS)
        force = self.value("EntryForce") if depth < self.value("EntryDepth") else self.value("Force")
        speed = min(self.value("Speed"), max(_SLOWEST, (wanted - depth) / _BRAKING_TIME))
        # the spring along the axis is stretched until it pulls with that force
        self._target = min(self._target + speed * dt, depth + force / _INSERTION_STIFFNESS, wanted + _BEYOND)
        self.arm.set_reference(self._reference(state, dt, self._target - depth))
        return self.step(f"Inserting: {1000 * depth:.1f} of {1000 * wanted:.1f} mm, {forces(state)}")

    def _reference(self, state: ArmState, dt: float, ahead: float) -> Pose:
        """Returns the reference, some distance ahead of the tool along the axis (m)."""
        part = 1.0 - math.exp(-dt / _FOLLOW_TIME)
        off = difference(state.pose.position, self._centre)
        axis = axis_of(self.start)
        along = dot(axis, off)
        across = difference(off, moved((0.0, 0.0, 0.0), axis, along))
        self._centre = moved(moved(self._centre, across, part), axis, along)
        passed = state.stamp - self.start.stamp
        angle = math.radians(self.value("TiltAngle")) * min(1.0, passed)
        phase = 2.0 * math.pi * self.value("TiltFrequency") * passed
        ahead_of_tool = moved(self._centre, axis, ahead)
        return Pose(ahead_of_tool, multiplied(self.start.pose.orientation, _tilt(angle, phase)))


def _tilt(angle: float, direction: float) -> Quaternion:
    """Returns a rotation by an angle about an axis across z in a direction (rad)."""
    sine = math.sin(angle / 2.0)
    return sine * math.cos(direction), sine * math.sin(direction), 0.0, math.cos(angle / 2.0)
