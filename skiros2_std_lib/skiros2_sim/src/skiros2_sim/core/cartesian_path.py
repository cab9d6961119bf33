"""A straight path of a tool with the joint positions along it, evaluated by time."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from skiros2_common.core.errors import Refused
from skiros2_sim.core.arm_kinematics import ArmKinematics, between, distances
from skiros2_sim.core.computation import Pieces
from skiros2_sim.core.joint import Joint
from skiros2_std_reasoners.core.geometry import Pose, normalized

Array = npt.NDArray[np.float64]

#: Distance between solved poses (m, rad); joint positions are interpolated between them.
_STEP, _TURN_STEP = 0.01, 0.03
#: Maximum joint step (rad or m) between solved poses; a larger step would change the posture of the arm.
_LARGEST_JUMP = 0.25
#: Accelerations of the tool (m/s2, rad/s2), and maximum joint speed as a fraction of the joint's limit.
_ACCELERATION, _ANGULAR_ACCELERATION = 1.0, 3.0
_JOINT_SPEED = 0.8


class PathPoint(NamedTuple):
    """Target at a time: tool pose, joint positions and velocities, remaining distance (m)."""

    tool: Pose
    positions: Array
    velocities: Array
    to_go: float


class CartesianPath:
    """A straight path between two poses of the tool, with even rotation and a trapezoidal speed profile.

    :param positions: joint positions at equal distances along the path.
    :param speed: maximum speed of the tool (m/s), `angular_speed` (rad/s); reduced to respect joint limits.
    """

    def __init__(
        self,
        joints: Sequence[Joint],
        start: Pose,
        target: Pose,
        positions: Array,
        speed: float,
        angular_speed: float,
    ) -> None:
        self._from, self._to = start, target
        self._length, self._angle = distances(start, target)
        self._positions = positions
        self._rate, self._ramp = self._profile(joints, speed, angular_speed)

    @classmethod
    def plan(
        cls,
        kinematics: ArmKinematics,
        joints: Sequence[Joint],
        start: Array,
        target: Pose,
        speed: float,
        angular_speed: float,
    ) -> Pieces[CartesianPath]:
        """Plans a path from the current pose to a target, in pieces of at most 1 ms.

        :param start: joint positions.
        :raises Refused: the target, or a pose on the path, is not reachable.
        """
        first, last = kinematics.forward(start), Pose(target.position, normalized(target.orientation))
        best = yield from kinematics.search(last, start)
        if not best.converged:
            raise Refused(
                f"no joint positions reach the target: the nearest are off by {best.off:.3f} m "
                f"and {best.turned:.3f} rad"
            )
        length, angle = distances(first, last)
        cells = max(1, math.ceil(length / _STEP), math.ceil(angle / _TURN_STEP))
        solved = [start]
        for k in range(1, cells + 1):
            yield
            found = kinematics.inverse(between(first, last, k / cells), solved[-1], restarts=0)
            jumps = np.abs(found.positions - solved[-1])
            if not found.converged or float(jumps.max()) > _LARGEST_JUMP:
                reason = _at_limits(kinematics, joints, found.positions) or "the arm would have to change its posture"
                raise Refused(
                    f"the straight path is not reachable beyond {k / cells * length:.3f} m of {length:.3f} m "
                    f"({reason}), though its target is"
                )
            solved.append(found.positions)
        return cls(joints, first, last, np.array(solved), speed, angular_speed)

    @property
    def duration(self) -> float:
        """s."""
        return self._ramp + 1.0 / self._rate if self._rate else 0.0

    def at(self, time: float, speed: float = 1.0) -> PathPoint:
        """Returns the target `time` seconds after the start; `speed` is the rate of time, for the velocities."""
        s, rate = self._along(time)
        cells = len(self._positions) - 1
        i = min(int(s * cells), cells - 1)
        before, step = self._positions[i], self._positions[i + 1] - self._positions[i]
        positions = before + (s * cells - i) * step
        tool = between(self._from, self._to, s)
        return PathPoint(tool, positions, step * cells * rate * speed, (1 - s) * self._length)

    def _along(self, time: float) -> tuple[float, float]:
        """Returns the completed fraction of the path, and its rate (1/s)."""
        if time >= self.duration:
            return 1.0, 0.0
        if time <= 0.0:
            return 0.0, 0.0
        slope = self._rate / self._ramp
        left = self.duration - time
        if time < self._ramp:
            return slope * time**2 / 2, slope * time
        if left < self._ramp:
            return 1.0 - slope * left**2 / 2, slope * left
        return self._rate * (time - self._ramp / 2), self._rate

    def _profile(self, joints: Sequence[Joint], speed: float, angular_speed: float) -> tuple[float, float]:
        """Returns the rate (1/s) between the ramps, and the duration of a ramp (s)."""
        cells = len(self._positions) - 1
        fastest = np.max(np.abs(np.diff(self._positions, axis=0)), axis=0) * cells
        rates = [
            _JOINT_SPEED * joint.velocity / most
            for joint, most in zip(joints, fastest, strict=True)
            if most > 1e-9 and joint.velocity > 0.0
        ]
        accelerations = []
        if self._length > 1e-6:
            rates.append(speed / self._length)
            accelerations.append(_ACCELERATION / self._length)
        if self._angle > 1e-6:
            rates.append(angular_speed / self._angle)
            accelerations.append(_ANGULAR_ACCELERATION / self._angle)
        if not accelerations:
            return 0.0, 0.0
        acceleration = min(accelerations)
        # a short path ends before the full speed is reached
        rate = min(*rates, math.sqrt(acceleration)) if len(rates) > 1 else min(rates[0], math.sqrt(acceleration))
        return rate, rate / acceleration


def _at_limits(kinematics: ArmKinematics, joints: Sequence[Joint], positions: Array) -> str:
    """Names the joints that are at a limit."""
    at = [
        joint.name
        for joint, q, lower, upper in zip(joints, positions, kinematics.lower, kinematics.upper, strict=True)
        if q <= lower + 1e-3 or q >= upper - 1e-3
    ]
    return f"{' and '.join(at)} at its limit" if at else ""
