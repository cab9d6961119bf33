"""A straight path of a tool with the joint positions along it, evaluated by time."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from skiros2_common.core.errors import Refused
from skiros2_sim.core.arm_kinematics import ArmKinematics, distances
from skiros2_sim.core.joint import Joint
from skiros2_std_reasoners.core.geometry import Pose, Quaternion, normalized

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
    """A straight path from the current pose to a target, with even rotation and a trapezoidal speed profile.

    :param start: joint positions.
    :param speed: maximum speed of the tool (m/s), `angular_speed` (rad/s); reduced to respect joint limits.
    :raises Refused: the target, or a pose on the path, is not reachable.
    """

    def __init__(
        self,
        kinematics: ArmKinematics,
        joints: Sequence[Joint],
        start: Array,
        target: Pose,
        speed: float,
        angular_speed: float,
    ) -> None:
        self._from = kinematics.forward(start)
        self._to = Pose(target.position, normalized(target.orientation))
        self._length, self._angle = distances(self._from, self._to)
        self._positions = self._solved(kinematics, joints, start)
        self._rate, self._ramp = self._profile(joints, speed, angular_speed)

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
        tool = Pose(_between(self._from, self._to, s), slerp(self._from.orientation, self._to.orientation, s))
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

    def _solved(self, kinematics: ArmKinematics, joints: Sequence[Joint], start: Array) -> Array:
        """Returns joint positions along the path."""
        best = kinematics.inverse(self._to, start)
        if not best.converged:
            raise Refused(
                f"no joint positions put the tool there: it comes within {best.off:.3f} m and {best.turned:.3f} rad"
            )
        cells = max(1, math.ceil(self._length / _STEP), math.ceil(self._angle / _TURN_STEP))
        solved = [start]
        for k in range(1, cells + 1):
            part = k / cells
            tool = Pose(_between(self._from, self._to, part), slerp(self._from.orientation, self._to.orientation, part))
            found = kinematics.inverse(tool, solved[-1], restarts=0)
            jumps = np.abs(found.positions - solved[-1])
            if not found.converged or float(jumps.max()) > _LARGEST_JUMP:
                why = _at_limits(kinematics, joints, found.positions) or "the arm would have to change its posture"
                raise Refused(
                    f"the straight way leaves what the arm reaches after {part * self._length:.3f} m of "
                    f"{self._length:.3f} m ({why}), though the target itself is reachable"
                )
            solved.append(found.positions)
        return np.array(solved)


def slerp(a: Quaternion, b: Quaternion, part: float) -> Quaternion:
    """Interpolates between two orientations in the shorter direction (Shoemake, Animating Rotation with Quaternion
    Curves, 1985)."""
    dot = sum(x * y for x, y in zip(a, b, strict=True))
    sign = -1.0 if dot < 0.0 else 1.0
    angle = math.acos(min(1.0, abs(dot)))
    if angle < 1e-6:
        return normalized(b)
    first, second = math.sin((1 - part) * angle), sign * math.sin(part * angle)
    return normalized([first * x + second * y for x, y in zip(a, b, strict=True)])


def _between(a: Pose, b: Pose, part: float) -> tuple[float, float, float]:
    x, y, z = (p + part * (q - p) for p, q in zip(a.position, b.position, strict=True))
    return x, y, z


def _at_limits(kinematics: ArmKinematics, joints: Sequence[Joint], positions: Array) -> str:
    """Names the joints that are at a limit."""
    at = [
        joint.name
        for joint, q, lower, upper in zip(joints, positions, kinematics.lower, kinematics.upper, strict=True)
        if q <= lower + 1e-3 or q >= upper - 1e-3
    ]
    return f"{' and '.join(at)} at its limit" if at else ""
