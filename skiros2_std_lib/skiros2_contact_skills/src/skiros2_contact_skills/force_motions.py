"""Primitives that hold a pose or exert a force."""

from __future__ import annotations

import math

from skiros2_common.core.abstract_skill import State
from skiros2_contact_skills.contact_primitive import (
    CONTACT_STIFFNESS,
    NO_PROGRESS,
    NOT_HELD,
    ContactPrimitive,
    axis_of,
    difference,
    dot,
    forces,
    pressed,
)
from skiros2_contact_skills.descriptions import ApplyForce, HoldPose, PullTest
from skiros2_contact_skills.regulated_motion import SOFT, RegulatedMotion
from skiros2_motion.core.compliant_arm import ArmState
from skiros2_motion.core.impact import KEPT_STIFFNESS
from skiros2_motion.core.impedance import MAX_WRENCH

#: Stiffness along the tool axis (N/m).
_STIFFNESS = 600.0
#: Maximum speed of a tool that a force accelerates before it touches something (m/s).
_FREE_SPEED = 0.02
#: Part of the force of a pull test that must be measured, and time until it is (s).
_PULLED, _PULLING_TIME = 0.9, 3.0
#: Time until a force that was set at a tick is exerted (s).
_DELAY = 0.12


class _Force(ContactPrimitive):
    """Exerts a force along the tool axis at a held pose. Before the contact the speed is limited: the force exceeds
    the measured one, and that of the spring, only as far as the damping takes up at the permitted speed."""

    #: 1 to press, -1 to pull.
    direction = 1.0

    def begin(self, state: ArmState) -> None:
        self.set_stiffness(_STIFFNESS)
        x, y, z = (self.direction * value for value in axis_of(state))
        damping = 2.0 * self.damping[2] * math.sqrt(_STIFFNESS) + _STIFFNESS * _DELAY
        stiffness = self.element("Arm").value_of(CONTACT_STIFFNESS) or KEPT_STIFFNESS
        self._surplus = damping * self.permitted(_FREE_SPEED, (x, y, z), stiffness=float(stiffness))

    def exert(self, state: ArmState) -> None:
        """Commands the force; at each tick, because drivers let it expire."""
        taken = max(0.0, self.direction * pressed(state)) + _STIFFNESS * max(0.0, self.advance(state))
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


class hold_pose(_Force):
    """Holds the pose of the start."""

    def createDescription(self) -> None:
        self.setDescription(HoldPose(), self.__class__.__name__)

    def move(self, state: ArmState, dt: float) -> State:
        self.exert(state)
        if reason := self.too_far(state):
            return self.fail(reason, NOT_HELD)
        passed = state.stamp - self.start.stamp
        if 0.0 < self.value("Duration") <= passed:
            return self.success(f"Held for {passed:.1f} s ({forces(state)})")
        return self.step(f"Holding for {passed:.1f} s, {forces(state)}")


class apply_force(RegulatedMotion):
    """Presses until the measured force was the commanded one for a duration."""

    def createDescription(self) -> None:
        self.setDescription(ApplyForce(), self.__class__.__name__)

    def begin(self, state: ArmState) -> None:
        super().begin(state)
        self.press_with(self.value("Force"), self.permitted(_FREE_SPEED, axis_of(state)), SOFT)
        self._held_since = math.inf

    def move(self, state: ArmState, dt: float) -> State:
        self.follow(state, self.start.pose, dt)
        moved = math.dist(state.pose.position, self.start.pose.position)
        if moved > self.value("MaxDistance"):
            return self.fail(f"The tool has moved by {1000 * moved:.1f} mm ({forces(state)})", NOT_HELD)
        is_pressed = abs(pressed(state) - self.value("Force")) <= self.value("Tolerance")
        self._held_since = min(self._held_since, state.stamp) if is_pressed else math.inf
        held = max(0.0, state.stamp - self._held_since)
        if held >= self.value("Duration"):
            return self.success(f"Pressed for {held:.1f} s ({forces(state)})")
        return self.step(f"Pressing: {forces(state)}")


class pull_test(_Force):
    """Pulls with a growing force until it was measured for the duration; the filter of the driver makes it grow
    smoothly. The spring of the held pose, which resists the pull as the hand yields, is added to it."""

    direction = -1.0

    def createDescription(self) -> None:
        self.setDescription(PullTest(), self.__class__.__name__)

    def begin(self, state: ArmState) -> None:
        super().begin(state)
        self._surplus = 2.0  # per tick: a part that is pulled at once slips in the fingers
        self._pulled_since = math.inf
        self._least = math.inf

    def exert(self, state: ArmState) -> None:
        spring = _STIFFNESS * max(0.0, self.advance(state))
        pull = min(self.value("Force"), max(0.0, -pressed(state)) + self._surplus)
        self.arm.set_wrench((0.0, 0.0, -min(pull + spring, MAX_WRENCH[2])))

    def move(self, state: ArmState, dt: float) -> State:
        self.exert(state)
        if reason := self.too_far(state):
            return self.fail(f"{reason}: the part does not hold", NOT_HELD)
        wanted, pull = self.value("Force"), -pressed(state)
        if pull < _PULLED * wanted:
            self._pulled_since, self._least = math.inf, math.inf
        else:
            self._pulled_since, self._least = min(self._pulled_since, state.stamp), min(self._least, pull)
        if state.stamp - self._pulled_since >= self.value("Duration"):
            return self.success(f"The part withstands {self._least:.1f} N for {self.value('Duration'):.1f} s")
        if state.stamp - self.start.stamp > self.value("Duration") + _PULLING_TIME:
            return self.fail(f"The pull has not reached {wanted:g} N ({forces(state)})", NO_PROGRESS)
        return self.step(f"Pulling: {forces(state)}")
