"""Primitives that hold a pose or exert a force."""

from __future__ import annotations

import math

from skiros2_common.core.abstract_skill import State
from skiros2_contact_skills.contact_primitive import NOT_HELD, ContactPrimitive, forces, pressed
from skiros2_contact_skills.descriptions import ApplyForce, HoldPose, PullTest
from skiros2_motion.core.compliant_arm import ArmState

#: Stiffness along the tool axis (N/m).
_STIFFNESS = 600.0


class _Force(ContactPrimitive):
    """Exerts a force along the tool axis at a held pose."""

    #: 1 to press, -1 to pull.
    direction = 1.0

    def begin(self, state: ArmState) -> None:
        self.set_stiffness(_STIFFNESS)
        self._held_since: float | None = None

    def exert(self) -> None:
        """Commands the force; at each tick, because drivers let it expire."""
        self.arm.set_wrench((0.0, 0.0, self.direction * self.value("Force")))

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
        self.exert()
        if reason := self.too_far(state):
            return self.fail(reason, NOT_HELD)
        passed = state.stamp - self.start.stamp
        if 0.0 < self.value("Duration") <= passed:
            return self.success(f"Held for {passed:.1f} s ({forces(state)})")
        return self.step(f"Holding for {passed:.1f} s, {forces(state)}")


class apply_force(_Force):
    """Presses until the measured force was the commanded one for a duration."""

    def createDescription(self) -> None:
        self.setDescription(ApplyForce(), self.__class__.__name__)

    def move(self, state: ArmState, dt: float) -> State:
        self.exert()
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
        self.exert()
        if reason := self.too_far(state):
            return self.fail(f"{reason}: the part does not hold", NOT_HELD)
        passed = state.stamp - self.start.stamp
        if passed >= self.value("Duration"):
            return self.success(f"The part holds for {passed:.1f} s ({forces(state)})")
        return self.step(f"Pulling: {forces(state)}")
