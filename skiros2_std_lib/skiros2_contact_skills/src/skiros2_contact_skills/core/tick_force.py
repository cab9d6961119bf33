"""Regulates forces at the ticks of a skill, for arms whose driver does not."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from skiros2_motion.core.compliant_arm import ArmState
from skiros2_motion.core.force_control import ForceControl, ForceGoal
from skiros2_motion.core.geometry import Pose, composed, conjugated, inverted, rotated


class TickForce:
    """The loop of `ForceControl` at the rate of the ticks: it leads the reference. Slower than a driver by the ratio of
    the rates, as the admittance is limited to what is stable."""

    def __init__(self, goal: ForceGoal) -> None:
        self._loop = ForceControl(goal)
        self._last: Sequence[float] | None = None

    def change(self, goal: ForceGoal) -> None:
        """Continues with another goal in the same frame."""
        self._loop.change(goal)

    def reference(self, state: ArmState, wanted: Pose, stiffness: Sequence[float], dt: float) -> Pose:
        """Returns the reference of the tool: ahead of it along the regulated axes, and the wanted one along the others.

        :param wanted: pose of the tool in the base frame.
        :param stiffness: along the axes of the tool (N/m).
        :param dt: time since the last tick (s).
        """
        frame = self._loop.goal.frame
        at, goal = composed(state.pose, frame), composed(wanted, frame)
        back = conjugated(at.orientation)
        force = -np.array(rotated(back, state.wrench[:3]))
        velocity = np.zeros(3)
        if self._last is not None and dt > 0.0:
            moved = [(new - old) / dt for new, old in zip(at.position, self._last, strict=True)]
            velocity = np.array(rotated(back, moved))
        self._last = at.position
        springs = np.array(stiffness)
        leads = self._loop.update(force, velocity, springs, 2.0 * np.sqrt(springs), max(dt, 1e-3))
        offset = rotated(back, [a - b for a, b in zip(goal.position, at.position, strict=True)])
        x, y, z = np.where(self._loop.axes, leads, offset)
        shift = rotated(at.orientation, (float(x), float(y), float(z)))
        px, py, pz = (a + b for a, b in zip(at.position, shift, strict=True))
        assert all(map(math.isfinite, (px, py, pz)))
        return composed(Pose((px, py, pz), goal.orientation), inverted(frame))
