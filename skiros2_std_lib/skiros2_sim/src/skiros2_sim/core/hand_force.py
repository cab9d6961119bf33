"""The force on the hand of a simulated arm in each step: what its sensor measures, and what the sensor does not feel.

A sensor at the wrist measures what the hand passes on. In an impact, the hand and what it holds take a part of the
force F for themselves: F = measured + m a, with their mass m and acceleration a.
"""

from __future__ import annotations

import math

from skiros2_motion.core.geometry import Vector, conjugated, rotated
from skiros2_motion.core.wrench_guard import is_finite
from skiros2_sim.core.arm import Arm
from skiros2_sim.core.payload import Payload


class HandForce:
    """The largest force on the hand of one arm. The stepping thread calls it.

    :param dt: length of a step of the world (s).
    """

    def __init__(self, arm: Arm, payload: Payload, dt: float) -> None:
        self._arm, self._payload = arm, payload
        self._longest = 1.5 * dt
        #: Time (s), and velocities of the hand's centre of mass and of the tool in the map then (m/s).
        self._last: tuple[float, Vector, Vector] | None = None
        self._peak = 0.0

    def take_peak(self, time: float) -> float:
        """Returns the largest force since the last call (N).

        :param time: simulated (s).
        """
        peak = self.peak(time)
        self.forget()
        return peak

    def peak(self, time: float) -> float:
        """Returns the largest force since `take_peak` or `forget` (N).

        :param time: simulated (s).
        """
        self.note(time)
        return self._peak

    def forget(self) -> None:
        """Forgets the largest force."""
        self._peak = 0.0

    def note(self, time: float) -> None:
        """Notes the force in the last step, if it is known: an impact may end within one.

        :param time: simulated (s).
        """
        arm = self._arm
        tool = arm.tool_velocity()[0]
        hand = tool if arm.sensor is None else arm.sensor.velocity()
        (before, hand_was, tool_was), self._last = self._last or (time, hand, tool), (time, hand, tool)
        force, passed = list(arm.measured_wrench()[:3]), time - before
        if not (0.0 < passed <= self._longest and is_finite(force)):
            return
        if arm.sensor is not None:  # without one, contacts are measured
            # a hand that turns accelerates less than its fingertips
            own, held = arm.sensor.mass / passed, self._payload.mass / passed
            pairs = zip(hand, hand_was, tool, tool_was, strict=True)
            taken = [own * (now - then) + held * (tip - tip_then) for now, then, tip, tip_then in pairs]
            if math.hypot(*force) + math.hypot(*taken) <= self._peak:  # in any direction
                return
            inertia = rotated(conjugated(arm.tool_pose().orientation), taken)
            force = [part + more for part, more in zip(force, inertia, strict=True)]
        self._peak = max(self._peak, math.hypot(*force))
