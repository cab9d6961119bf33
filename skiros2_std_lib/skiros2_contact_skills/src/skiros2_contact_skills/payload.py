"""The primitive that identifies what the hand holds, by moving it."""

from __future__ import annotations

import math

import numpy as np

from skiros2_common.core.abstract_skill import State
from skiros2_contact_skills.contact_primitive import NOT_REACHED, ContactPrimitive, forces
from skiros2_contact_skills.descriptions import IdentifyPayload
from skiros2_motion.core.compliant_arm import ArmState, turned_wrench
from skiros2_motion.core.geometry import Pose, between, conjugated, multiplied
from skiros2_motion.core.payload_estimate import PayloadEstimate, PayloadSample, estimate_payload

#: Stiffness along the tool axis (N/m).
_STIFFNESS = 1000.0
#: Time of a turn, until the arm is at rest after it, and of the measurement (s).
_TURN_TIME, _REST_TIME, _MEASURING_TIME = 1.0, 0.6, 0.4
#: Largest root mean square of the force that a payload does not explain: the hand touches something (N).
_UNEXPLAINED = 1.0
#: Turns about x and y of the tool, as parts of the angle; the last one returns.
_TURNS = ((0.0, 0.0), (1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0), (0.0, 0.0))


class identify_payload(ContactPrimitive):
    """Turns the tool about its origin and measures the wrench at rest in each orientation."""

    def createDescription(self) -> None:
        self.setDescription(IdentifyPayload(), self.__class__.__name__)

    def begin(self, state: ArmState) -> None:
        self.set_stiffness(_STIFFNESS)
        self._turn, self._since = 0, state.stamp
        self._from = self._to = state.pose
        self._measured: list[tuple[float, ...]] = []
        self._samples: list[PayloadSample] = []

    def move(self, state: ArmState, dt: float) -> State:
        passed = state.stamp - self._since
        self.arm.set_reference(between(self._from, self._to, min(1.0, passed / _TURN_TIME)))
        at_rest = _TURN_TIME + _REST_TIME
        if passed >= at_rest:
            self._measured.append(turned_wrench(conjugated(state.pose.orientation), state.wrench))
        if passed >= at_rest + _MEASURING_TIME:
            return self._next(state)
        return self.step(f"Orientation {self._turn + 1} of {len(_TURNS)}: {forces(state)}")

    def _next(self, state: ArmState) -> State:
        """Takes the sample of an orientation, and turns to the next one."""
        fx, fy, fz, tx, ty, tz = np.mean(self._measured, axis=0).tolist()
        self._samples.append(PayloadSample(state.pose.orientation, (fx, fy, fz, tx, ty, tz)))
        self._turn += 1
        if self._turn == len(_TURNS):
            return self._result(estimate_payload(self._samples))
        self._measured, self._since, self._from = [], state.stamp, self._to
        half = math.radians(self.value("Angle")) / 2.0
        about_x, about_y = _TURNS[self._turn]
        turn = math.sin(about_x * half), math.sin(about_y * half), 0.0, math.cos(half if about_x or about_y else 0.0)
        self._to = Pose(self.start.pose.position, multiplied(self.start.pose.orientation, turn))
        return self.step(f"Turning to orientation {self._turn + 1} of {len(_TURNS)}")

    def _result(self, found: PayloadEstimate) -> State:
        x, y, z = (1000.0 * value for value in found.centre)
        text = f"{found.mass:.3f} kg at ({x:.0f}, {y:.0f}, {z:.0f}) mm of the tool, within {found.residual:.2f} N"
        if found.residual > _UNEXPLAINED:
            return self.fail(f"No payload explains the forces, the hand may touch something: {text}", NOT_REACHED)
        self.params["Mass"].values = [found.mass]
        self.params["CentreOfMass"].values = list(found.centre)
        part = self.optional_element("Part")
        if part is not None:
            part.setProperty("skiros:Weight", found.mass)
            self.wmi.update_element_properties(part)
        return self.success(text)
