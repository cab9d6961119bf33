"""The primitive that moves an arm by a hand-held device."""

from __future__ import annotations

import time

from skiros2_common.core.abstract_skill import State
from skiros2_contact_skills.contact_primitive import ContactPrimitive
from skiros2_motion.core.compliant_arm import ArmState
from skiros2_teaching.core.teleoperation import TIMEOUT, Limits, TwistInput, next_reference
from skiros2_teaching.descriptions import TeleoperateArm
from skiros2_teaching.guiding import Guiding, start_guiding, stop_guiding
from skiros2_teaching.teach import STOPPED
from skiros2_teaching.twists import twists_of

#: Progress code of the failure without any twist.
NO_TWIST = -144


class teleoperate_arm(ContactPrimitive):
    """The reference moves by the twists, ahead of the tool by a limited distance."""

    def createDescription(self) -> None:
        self.setDescription(TeleoperateArm(), self.__class__.__name__)

    def __str__(self) -> str:
        return str(self.label)

    def begin(self, state: ArmState) -> None:
        self.arm.set_stiffness((self.value("Stiffness"),) * 3, (self.value("RotationalStiffness"),) * 3)
        self._limits = Limits(*(self.value(key) for key in ("Speed", "AngularSpeed", "Lead", "AngularLead")))
        self._twists = twists_of(self.wmi, self.element("Robot"), self.element("Arm"), self.value("Topic"))
        self._guiding = start_guiding(self.element("Arm"), self.arm)
        self._reference = state.pose
        self._began = time.monotonic()
        self.arm.set_reference(state.pose)

    def move(self, state: ArmState, dt: float) -> State:
        assert self._guiding is not None and self._twists is not None
        twist = self._twists.twist()
        if twist is not None:
            self._has_moved = self._moves = True
            self._reference = next_reference(self._reference, state.pose, twist, self._limits, dt)
            self.arm.set_reference(self._reference)
        elif self._moves:
            self._moves, self._reference = False, state.pose
            self.arm.set_reference(state.pose)
        arm, recorded = self.label_of("Arm"), self._guiding.is_recorded
        if self._guiding.ends and not recorded:
            return self.success(f"{arm} holds its pose")
        if twist is not None:
            return self.step(f"{arm} is moved by twists{', and recorded' if recorded else ''}")
        if self._has_moved and not recorded:
            return self.success(f"{arm} holds its pose: no twist for {TIMEOUT:g} s")
        waited, longest = time.monotonic() - self._began, self.value("WaitTime")
        if not self._has_moved and waited > longest:
            return self.fail(f"No twist for {arm} within {longest:g} s", NO_TWIST)
        return self.step(f"{arm} waits for twists")

    def onStart(self) -> bool:
        self._guiding: Guiding | None = None
        self._twists: TwistInput | None = None
        self._has_moved = self._moves = False
        return super().onStart()

    def onPreempt(self) -> State:
        return self.fail(f"Stopped; {self.label_of('Arm')} holds its pose", STOPPED)

    def onEnd(self) -> bool:
        if self._twists is not None:
            self._twists.close()
        if self._guiding is not None:
            stop_guiding(self.element("Arm"), self._guiding)
        return super().onEnd()
