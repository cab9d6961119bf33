"""Primitives that hold a pose or exert a force."""

from __future__ import annotations

import math

from skiros2_common.core.abstract_skill import State
from skiros2_contact_skills.contact_primitive import (
    NOT_HELD,
    ContactPrimitive,
    axis_of,
    difference,
    dot,
    forces,
    moved,
    pressed,
)
from skiros2_contact_skills.descriptions import ApplyForce, HoldPose, PullTest
from skiros2_motion.core.compliant_arm import ArmState
from skiros2_motion.core.geometry import Pose

#: Stiffness along the tool axis (N/m).
_STIFFNESS = 600.0
#: Maximum speed of a tool that a force accelerates before it touches something (m/s).
_FREE_SPEED = 0.02


class _Force(ContactPrimitive):
    """Exerts a force along the tool axis at a held pose. Before the contact the speed is limited: the force exceeds
    the measured one, and that of the spring, only as far as the damping takes up at the permitted speed."""

    #: 1 to press, -1 to pull.
    direction = 1.0

    def begin(self, state: ArmState) -> None:
        self.set_stiffness(_STIFFNESS)
        self._held_since: float | None = None
        x, y, z = (self.direction * value for value in axis_of(state))
        self._surplus = 2.0 * self.damping[2] * math.sqrt(_STIFFNESS) * self.permitted(_FREE_SPEED, (x, y, z))

    def exert(self, state: ArmState, stretched: float = 0.0) -> None:
        """Commands the force; at each tick, because drivers let it expire.

        :param stretched: how far the tool is from the reference in the direction of the force (m).
        """
        taken = max(0.0, self.direction * pressed(state)) + _STIFFNESS * max(0.0, stretched)
        force = min(self.value("Force"), taken + self._surplus)
        self.arm.set_wrench((0.0, 0.0, self.direction * force))

    def advance(self, state: ArmState) -> float:
        """Returns how far the tool has moved along its axis, in the direction of the force (m)."""
        off = difference(state.pose.position, self.start.pose.position)
        return self.direction * dot(axis_of(self.start), off)

    def too_far(self, state: ArmState) -> str:
        """Returns why the tool has moved too far; "" if it has not."""
        moved = math.dist(state.pose.position, self.start.pose.position)
        if moved <= self.value("MaxDistance"):
            return ""
        return f"The tool has moved by {1000 * moved:.1f} mm ({forces(state)})"

    def held_for(self, state: ArmState) -> float:
        """Returns for how long the measured force has been the commanded one (s)."""
        off = abs(self.direction * pressed(state) - self.value("Force"))
        if off > self.value("Tolerance"):
            self._held_since = None
            return 0.0
        if self._held_since is None:
            self._held_since = state.stamp
        return state.stamp - self._held_since


class hold_pose(_Force):
    """Holds the pose of the start."""

    def createDescription(self) -> None:
        self.setDescription(HoldPose(), self.__class__.__name__)

    def move(self, state: ArmState, dt: float) -> State:
        self.exert(state, self.advance(state))
        if reason := self.too_far(state):
            return self.fail(reason, NOT_HELD)
        passed = state.stamp - self.start.stamp
        if 0.0 < self.value("Duration") <= passed:
            return self.success(f"Held for {passed:.1f} s ({forces(state)})")
        return self.step(f"Holding for {passed:.1f} s, {forces(state)}")


class apply_force(_Force):
    """Presses until the measured force was the commanded one for a duration. The reference follows the tool along its
    axis: no spring takes up a part of the force."""

    def createDescription(self) -> None:
        self.setDescription(ApplyForce(), self.__class__.__name__)

    def move(self, state: ArmState, dt: float) -> State:
        self.exert(state)
        position = moved(self.start.pose.position, axis_of(self.start), self.advance(state))
        self.arm.set_reference(Pose(position, self.start.pose.orientation))
        if reason := self.too_far(state):
            return self.fail(reason, NOT_HELD)
        held = self.held_for(state)
        if held >= self.value("Duration"):
            return self.success(f"Pressed for {held:.1f} s ({forces(state)})")
        return self.step(f"Pressing: {forces(state)}")


class pull_test(_Force):
    """Pulls with a growing force for the duration; the filter of the driver makes it grow smoothly."""

    direction = -1.0

    def createDescription(self) -> None:
        self.setDescription(PullTest(), self.__class__.__name__)

    def move(self, state: ArmState, dt: float) -> State:
        self.exert(state, self.advance(state))
        if reason := self.too_far(state):
            return self.fail(f"{reason}: the part does not hold", NOT_HELD)
        passed = state.stamp - self.start.stamp
        if passed >= self.value("Duration"):
            return self.success(f"The part holds for {passed:.1f} s ({forces(state)})")
        return self.step(f"Pulling: {forces(state)}")
