"""A straight way of a tool, and the joint positions along it, looked up by time."""

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

#: How far the places are apart for which joint positions are solved (m, rad): between them they are interpolated.
_STEP, _TURN_STEP = 0.01, 0.03
#: No joint moves farther than that (rad or m) between two of them: it would be another posture of the arm.
_LARGEST_JUMP = 0.25
#: What the tool is accelerated with (m/s2, rad/s2), and the part of their speed that joints are moved with at most.
_ACCELERATION, _ANGULAR_ACCELERATION = 1.0, 3.0
_JOINT_SPEED = 0.8


class Moment(NamedTuple):
    """What is wanted at a time: the tool's pose, the positions and velocities of the joints, and m to go."""

    tool: Pose
    positions: Array
    velocities: Array
    to_go: float


class CartesianPath:
    """From where the arm is, straight to a pose, turning evenly, with a trapezoid of speed.

    :param start: positions of the joints.
    :param speed: of the tool in m/s, and `angular_speed` in rad/s, at most; slower where a joint cannot follow.
    :raises Refused: no joint positions put the tool there, or somewhere on the way.
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
        """Seconds."""
        return self._ramp + 1.0 / self._rate if self._rate else 0.0

    def at(self, time: float, speed: float = 1.0) -> Moment:
        """What is wanted `time` seconds after the start; `speed`: at which part of its speed time goes on there."""
        s, rate = self._along(time)
        cells = len(self._positions) - 1
        i = min(int(s * cells), cells - 1)
        before, step = self._positions[i], self._positions[i + 1] - self._positions[i]
        positions = before + (s * cells - i) * step
        tool = Pose(_between(self._from, self._to, s), slerp(self._from.orientation, self._to.orientation, s))
        return Moment(tool, positions, step * cells * rate * speed, (1 - s) * self._length)

    def _along(self, time: float) -> tuple[float, float]:
        """The part of the way that is done, and how fast it grows (1/s)."""
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
        """The rate (parts of the way per second) between the ramps, and how long each ramp is (s)."""
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
        # a short way is over before the full speed is reached
        rate = min(*rates, math.sqrt(acceleration)) if len(rates) > 1 else min(rates[0], math.sqrt(acceleration))
        return rate, rate / acceleration

    def _solved(self, kinematics: ArmKinematics, joints: Sequence[Joint], start: Array) -> Array:
        """Joint positions along the way."""
        best = kinematics.inverse(self._to, start)
        if not best.there:
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
            if not found.there or float(jumps.max()) > _LARGEST_JUMP:
                why = _at_limits(kinematics, joints, found.positions) or "the arm would have to change its posture"
                raise Refused(
                    f"the straight way leaves what the arm reaches after {part * self._length:.3f} m of "
                    f"{self._length:.3f} m ({why}), though the target itself is reachable"
                )
            solved.append(found.positions)
        return np.array(solved)


def slerp(a: Quaternion, b: Quaternion, part: float) -> Quaternion:
    """The orientation at a part of the way from one to the other, the shorter way round (Shoemake, Animating Rotation
    with Quaternion Curves, 1985)."""
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
    """The joints that are at a limit, in words."""
    at = [
        joint.name
        for joint, q, lower, upper in zip(joints, positions, kinematics.lower, kinematics.upper, strict=True)
        if q <= lower + 1e-3 or q >= upper - 1e-3
    ]
    return f"{' and '.join(at)} at its limit" if at else ""
