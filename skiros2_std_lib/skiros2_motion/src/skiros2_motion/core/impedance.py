"""The law of a Cartesian impedance controller, as compliant arms in laboratories have it.

    torques = J' (-K e - D J dq) + J' F + nullspace + bias

with the Jacobian J of the tool, its pose error e and stiffness K in the tool frame, the damping D = 2 z sqrt(K) with
the damping factors z, the commanded wrench F, the bias of gravity and Coriolis forces, and a posture that is kept in
the nullspace of the tool: (I - J' J'+) (k (q0 - q) - 2 z0 sqrt(k) dq). (Khatib, A Unified Approach for Motion and Force
Control of Robot Manipulators, 1987; Albu-Schaeffer et al., Cartesian Impedance Control of Redundant Robots, 2003.)

A joint that is nearer to a limit than LIMIT_MARGIN is repelled from it in the nullspace, by a torque that grows with
the square of the depth: the elbow gives way, and the tool does not feel it. (Khatib, Real-Time Obstacle Avoidance for
Manipulators and Mobile Robots, 1986.) An arm without a nullspace, as one with six joints, cannot give way.

D does not depend on the arm's inertia. Measured against D = 2 Q z sqrt(K0) Q', with the inertia Q Q' and K = Q K0 Q'
(double diagonalisation; Albu-Schaeffer et al., 2003): that was not better, see docs/contact.md.

In directions without stiffness D is FREE_DAMPING: the arm stops after a push. With a stiffness of 0 in all directions
the arm is guided by hand: reference and posture follow it, so that it stays where it was left when it gets stiff again.

Reference, stiffness and wrench follow their commanded values through filters of first order, and the torques change by
at most 1 Nm per ms: a sudden command does not jerk the arm. Pure computation; the stepping thread calls it.
At 500 Hz it is the dearest part of a simulated arm after the engine: few calls of NumPy, `dot` in place of `@` (half
the time for a matrix of this size), and Python's floats for what has three numbers.

With limits of force and torque, spring and wrench together stay within them: |-K e + F| <= limit, along and about the
axes. So the reference leads the tool by at most (limit - |F|) / K, and a contact at rest is within the limit without
any sensor.

Regions repel the tool (`regions`).

`brake` brings the arm to rest: reference and posture follow, so that only the damping is left, and with the masses M of
its joints, the torques -BRAKING M dq are added. At rest, or after BRAKING_TIME, it holds its pose again.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from skiros2_common.core.errors import WrongValue
from skiros2_motion.core.geometry import IDENTITY, Pose, Vector, between, conjugated, multiplied, rotated
from skiros2_motion.core.numbers import finite
from skiros2_motion.core.regions import Region, repelled
from skiros2_motion.core.wrench_guard import Limits, is_finite, limited_wrench

Array = npt.NDArray[np.float64]

#: Default stiffness along and about the axes of the tool (N/m, Nm/rad), and damping factors: tool, nullspace.
STIFFNESS = (600.0, 600.0, 600.0, 40.0, 40.0, 40.0)
DAMPING_FACTORS = (1.0, 1.0, 1.0, 1.0, 1.0, 1.0)
#: Limits of the stiffness (N/m, Nm/rad), the wrench (N, Nm) and the damping factors.
MAX_STIFFNESS = (2000.0, 2000.0, 2000.0, 300.0, 300.0, 300.0)
MAX_WRENCH = (30.0, 30.0, 30.0, 10.0, 10.0, 10.0)
MAX_DAMPING_FACTOR = 6.0
#: Damping along and about axes without stiffness (Ns/m, Nms/rad): 20 N guide the tool at 0.5 m/s.
FREE_DAMPING = (40.0, 40.0, 40.0, 3.0, 3.0, 3.0)
#: Maximum change of a joint torque (Nm/s), also while the arm brakes.
TORQUE_RATE, BRAKING_RATE = 1000.0, 5000.0
#: Rate with which a braking arm loses its speed (1/s), the longest time of that (s), and the speed of each joint at
#: which it rests (rad/s).
BRAKING, BRAKING_TIME, REST = 40.0, 0.15, 0.01

#: Time constants (s) of the filters of the reference, and of stiffness, damping and wrench.
_REFERENCE_FILTER, _COMMAND_FILTER = 0.02, 0.1
#: Maximum error that produces a force (m, rad).
_MAX_DISTANCE, _MAX_TURN = 0.15, 0.5
#: Stiffness (Nm/rad) and damping factor of the posture.
_POSTURE_STIFFNESS, _POSTURE_DAMPING = 10.0, 0.7
#: Distance from a joint's limit within which it is repelled (rad), at most that fraction of its range, and the torque
#: at the limit (Nm).
LIMIT_MARGIN, LIMIT_PART, LIMIT_TORQUE = 0.4, 0.15, 120.0
#: Largest stiffness and damping that are stable with torques that change once per update, as a fraction of the inertia
#: over the length of an update, squared for the stiffness.
_STABLE_STIFFNESS, _STABLE_DAMPING = 0.2, 0.5
#: Number of updates between computations of the inertia, which changes slowly with the posture.
_INERTIA_PERIOD = 8
#: Regularisation of the tool's inertia (1/kg, 1/(kg m2)) and of the projection at singularities.
_SINGULAR = 1e-3
_SINGULAR_POSTURE = 1e-6 * np.eye(6)


class ArmState(NamedTuple):
    """The measured state of an arm with n joints.

    :param positions: n (rad).
    :param velocities: n (rad/s).
    :param tool: pose of the tool in the arm's base frame.
    :param jacobian: of the tool in the base frame, 6 x n: linear, then angular.
    :param masses: n x n (kg m2); used if `Impedance.needs_masses`.
    :param bias: torques of gravity and Coriolis forces, n (Nm).
    """

    positions: Array
    velocities: Array
    tool: Pose
    jacobian: Array
    masses: Array
    bias: Array


class Gains(NamedTuple):
    """Stiffness and damping of the tool, 6 x 6 in its frame, and damping of the posture (n)."""

    stiffness: Array
    damping: Array
    posture_damping: Array


class Impedance:
    """The controller's commanded values and filters. `restart` must be called before the first `torques`.

    :param efforts: maximum torque of each joint (Nm).
    :param limits: lowest and highest position of each joint (rad, m); None for joints without limits.
    """

    def __init__(self, efforts: Sequence[float], limits: tuple[Array, Array] | None = None) -> None:
        self._efforts = np.array(efforts)
        self._limits = limits
        self._reference = IDENTITY
        self._stiffness = np.array(STIFFNESS)
        self._damping = np.array(DAMPING_FACTORS)
        self._wrench = np.zeros(6)
        self.posture = np.zeros(len(efforts))
        #: Desired joint velocities (rad/s) of a motion along a known path; 0 otherwise.
        self.velocities = np.zeros(len(efforts))
        #: Offset that is added to the reference (m, in its frame), for example of an overlay motion.
        self.overlay = np.zeros(3)
        #: Lead of the reference before the tool along axes of the tool whose force is regulated (m); NaN along others.
        self.leads: Array | None = None
        #: Filtered values.
        self.reference = IDENTITY
        self.stiffness = self._stiffness.copy()
        self.wrench = np.zeros(6)
        #: Pose error in the tool frame (m, rad) and joint torques (Nm) of the last update.
        self.error = np.zeros(6)
        self.commanded_torques = np.zeros(len(efforts))
        #: Limits of spring and wrench together.
        self.limits = Limits()
        #: Regions that the tool does not enter.
        self.regions: Sequence[Region] = ()
        #: Wrench of spring, damping and command of the last update, in the tool frame (N, Nm).
        self.exerted = np.zeros(6)
        self._braking_time = 0.0
        self._gains: Gains | None = None
        self._updates = 0

    @property
    def commanded_stiffness(self) -> tuple[float, ...]:
        """The last stiffness that was set."""
        return tuple(float(value) for value in self._stiffness)

    @property
    def damping_factors(self) -> tuple[float, ...]:
        """The damping factors along and about the axes of the tool."""
        return tuple(float(value) for value in self._damping)

    @property
    def is_guided(self) -> bool:
        """Whether the commanded stiffness is 0 in all directions: the tool can be moved by hand."""
        return not any(self._stiffness.tolist())

    @property
    def is_braking(self) -> bool:
        """Whether the arm is brought to rest."""
        return self._braking_time > 0.0

    @property
    def needs_masses(self) -> bool:
        """Whether the next update uses the masses of the arm."""
        return self._gains is None or self._updates % _INERTIA_PERIOD == 0

    def restart(self, state: ArmState) -> None:
        """Starts at the current pose and posture, without a wrench and without a jump of the torques.

        :raises WrongValue: a number of the state is not finite. Nothing has changed then.
        """
        check_state(state)
        self.set_reference(state.tool, filtered=False)
        self.posture, self.velocities = state.positions.copy(), np.zeros_like(state.positions)
        self.cancel_wrench()
        self.stiffness = self._stiffness.copy()
        self.overlay, self.leads = np.zeros(3), None
        self.commanded_torques = state.bias.copy()
        self._braking_time = 0.0
        self._updates = 0

    def brake(self) -> None:
        """Brings the arm to rest, without wrench and overlay motion; then it holds its pose."""
        self.cancel_wrench()
        self.overlay = np.zeros(3)
        self._braking_time = BRAKING_TIME

    def set_reference(self, pose: Pose, filtered: bool = True) -> None:
        """Sets the attractor of the tool, in the arm's base frame.

        :param filtered: False for points of a smooth path, which are followed without delay.
        :raises WrongValue: a number is not finite.
        """
        if not is_finite(*pose):
            raise WrongValue(f"reference: expected finite numbers, got {pose}")
        self._reference = pose
        if not filtered:
            self.reference = pose

    def set_stiffness(self, values: Sequence[float]) -> None:
        """Sets the stiffness along and about the axes of the tool (N/m, Nm/rad).

        :raises WrongValue: a value is not finite or out of range; the text lists all of them.
        """
        self._stiffness = np.array(checked("stiffness", values, MAX_STIFFNESS, lowest=0.0))

    def set_damping_factors(self, values: Sequence[float]) -> None:
        """Sets the damping factors along and about the axes of the tool; 1 is critical damping.

        :raises WrongValue: a value is not finite or out of range; the text lists all of them.
        """
        self._damping = np.array(checked("damping factor", values, (MAX_DAMPING_FACTOR,) * 6, lowest=0.0))

    def set_wrench(self, values: Sequence[float]) -> None:
        """Sets the wrench that the tool exerts, in its frame (N, Nm).

        :raises WrongValue: a value is not finite or out of range; the text lists all of them.
        """
        self._wrench = np.array(checked("wrench", values, MAX_WRENCH))

    def cancel_wrench(self) -> None:
        """Sets the wrench to 0, without delay by a filter; the torques still change slowly."""
        self._wrench, self.wrench = np.zeros(6), np.zeros(6)

    def torques(self, state: ArmState, dt: float, load: Array | None = None) -> Array:
        """Returns the joint torques (Nm) for the next `dt` seconds.

        :param load: force (N) in the base frame that compensates the weight of a carried object.
        :raises WrongValue: a number of the state, or of the torques, is not finite. The torques stay then.
        """
        check_state(state)
        if self.is_guided or self.is_braking:
            self.set_reference(state.tool, filtered=False)
            self.posture, self.velocities = state.positions.copy(), np.zeros_like(state.positions)
        self._filter(dt)
        into = rotation_matrix(state.tool.orientation).T
        jacobian = (into @ state.jacobian.reshape(2, 3, -1)).reshape(6, -1)  # in the tool frame
        along = jacobian.T
        if self.needs_masses or self._gains is None:
            free = np.where(self._stiffness == 0.0, FREE_DAMPING, 0.0)
            self._gains = stable_gains(self.stiffness, self._damping, free, jacobian, state.masses, dt)
        self._updates += 1
        stiffness, damping, posture_damping = self._gains
        self.error = self._offset(state.tool)
        too_fast = state.velocities - self.velocities
        wrench = limited_wrench(self.wrench - stiffness.dot(self.error), self.limits)
        if self.regions:
            velocity = state.jacobian[:3].dot(state.velocities)
            force = repelled(into.T.dot(wrench[:3]), state.tool.position, velocity, self.regions)
            wrench = np.concatenate((into.dot(force), wrench[3:]))
        wrench = wrench - damping.dot(jacobian.dot(too_fast))
        self.exerted = wrench.copy()
        if load is not None:
            wrench[:3] += into.dot(load)
        posture = _POSTURE_STIFFNESS * (self.posture - state.positions) - posture_damping * too_fast
        if self._limits is not None:
            posture += limit_repulsion(state.positions, *self._limits)
        # both act along the tool's axes: the wrench, and the part of the posture that would move the tool
        wrench -= np.linalg.solve(jacobian.dot(along) + _SINGULAR_POSTURE, jacobian.dot(posture))
        wanted = along.dot(wrench) + posture + state.bias
        if self.is_braking:
            wanted += self._braking_torques(state, dt)
        if not math.isfinite(sum(wanted.tolist())):
            raise WrongValue(f"torques: expected finite numbers, got {wanted.tolist()}")
        step = (BRAKING_RATE if self.is_braking else TORQUE_RATE) * dt
        change = np.minimum(np.maximum(wanted - self.commanded_torques, -step), step)
        changed = self.commanded_torques + change
        self.commanded_torques = np.minimum(np.maximum(changed, -self._efforts), self._efforts)
        return self.commanded_torques

    def _braking_torques(self, state: ArmState, dt: float) -> Array:
        """Returns the torques that slow the arm down, beside the damping of the law."""
        self._braking_time -= dt
        if np.abs(state.velocities).max() <= REST:
            self._braking_time = 0.0
        torques: Array = -BRAKING * (state.masses @ state.velocities)
        return torques

    def _filter(self, dt: float) -> None:
        part = 1.0 - math.exp(-dt / _COMMAND_FILTER)
        self.stiffness += part * (self._stiffness - self.stiffness)
        self.wrench += part * (self._wrench - self.wrench)
        if self.reference != self._reference:
            self.reference = between(self.reference, self._reference, 1.0 - math.exp(-dt / _REFERENCE_FILTER))

    def _offset(self, tool: Pose) -> Array:
        """Returns the offset of the tool from the reference, in the tool frame, limited in length and rotation."""
        reference = self.reference
        x, y, z = reference.position
        overlay = self.overlay.tolist()
        if any(overlay):
            dx, dy, dz = rotated(reference.orientation, overlay)
            x, y, z = x + dx, y + dy, z + dz
        back = conjugated(tool.orientation)
        tx, ty, tz = tool.position
        way = rotated(back, (tx - x, ty - y, tz - z))
        # of the rotation from the reference to the tool, which has the same axis in both frames
        turn = rotation_vector(multiplied(conjugated(reference.orientation), tool.orientation))
        offset = np.array([*_limited(way, _MAX_DISTANCE), *_limited(turn, _MAX_TURN)])
        if self.leads is not None:
            offset[:3] = np.where(np.isnan(self.leads), offset[:3], -self.leads)
        return offset


def _limited(vector: Vector, most: float) -> Vector:
    length = math.hypot(*vector)
    if length <= most:
        return vector
    x, y, z = vector
    return x * most / length, y * most / length, z * most / length


def limit_repulsion(positions: Array, lower: Array, upper: Array) -> Array:
    """Returns the torques that repel joints from their limits (Nm).

    :param positions: rad, as the limits.
    """
    margin = np.minimum(LIMIT_MARGIN, LIMIT_PART * (upper - lower))
    depth = np.clip((lower + margin - positions) / margin, 0.0, 1.0)
    height = np.clip((positions - upper + margin) / margin, 0.0, 1.0)
    return np.asarray(LIMIT_TORQUE * (depth**2 - height**2))


def check_state(state: ArmState) -> None:
    """Checks that a measured state has finite numbers only.

    :raises WrongValue: it has others; the text names where.
    """
    positions, velocities, tool, *more = state
    # of lists: NumPy's sum takes three times as long for some numbers
    total = sum(sum(part.ravel().tolist()) for part in (positions, velocities, *more))
    if math.isfinite(total + sum(tool.position) + sum(tool.orientation)):
        return
    arrays = (positions, velocities, np.array([*tool.position, *tool.orientation]), *more)
    parts = [name for name, part in zip(ArmState.__annotations__, arrays, strict=True) if not np.isfinite(part).all()]
    if parts:
        raise WrongValue(f"{', '.join(parts)} of the arm: expected finite numbers")


def rotation_matrix(q: Sequence[float]) -> Array:
    """Returns the matrix of a unit quaternion (x, y, z, w). SciPy's rotations take 20 us for one."""
    x, y, z, w = q
    return np.array(
        [
            [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)],
            [2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)],
            [2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)],
        ]
    )


def rotation_vector(q: Sequence[float]) -> Vector:
    """Returns the rotation vector of a unit quaternion, of the shorter rotation (rad)."""
    x, y, z, w = q if q[3] >= 0.0 else [-value for value in q]
    sine = math.sqrt(x * x + y * y + z * z)
    factor = 2.0 * math.atan2(sine, w) / sine if sine > 1e-12 else 2.0
    return factor * x, factor * y, factor * z


def stable_gains(stiffness: Array, factors: Array, damping: Array, jacobian: Array, masses: Array, dt: float) -> Gains:
    """Returns K and D = 2 z sqrt(K) or `damping`, reduced in directions in which the tool's inertia is too low.

    With the tool's inertia Q Q', a gain G is diagonal in Q^-1 G Q^-T; its elements are frequencies there, which must
    stay below those of the updates.

    :param stiffness: 6, in the frame of the Jacobian (N/m, Nm/rad).
    :param factors: 6 damping factors.
    :param damping: minimum damping, 6 (Ns/m, Nms/rad).
    :param jacobian: 6 x n, in the tool frame.
    :param masses: n x n (kg m2).
    :param dt: length of an update (s).
    """
    mobility = jacobian @ np.linalg.solve(masses, jacobian.T) + _SINGULAR * np.eye(6)
    mobilities = np.diag(mobility)
    limited = []
    for gain, most in (
        (stiffness, _STABLE_STIFFNESS / dt**2),
        (np.maximum(2.0 * factors * np.sqrt(stiffness), damping), _STABLE_DAMPING / dt),
    ):
        if gain @ mobilities <= most:  # the sum of the modes: none of them is larger
            limited.append(np.diag(gain))
            continue
        root = np.linalg.cholesky(mobility)
        modes, vectors = np.linalg.eigh(root.T @ (gain[:, None] * root))
        if modes[-1] <= most:
            limited.append(np.diag(gain))
            continue
        q = np.linalg.inv(root).T @ vectors
        limited.append((q * np.minimum(np.maximum(modes, 0.0), most)) @ q.T)
    posture = 2.0 * _POSTURE_DAMPING * np.sqrt(_POSTURE_STIFFNESS * np.diag(masses))
    return Gains(limited[0], limited[1], posture)


def checked(what: str, values: Sequence[float], most: Sequence[float], lowest: float | None = None) -> list[float]:
    """Checks six numbers along and about x, y and z.

    :param most: maximum of each one.
    :param lowest: minimum of all; None for the negative maximum.
    :raises WrongValue: a number is not finite or out of range; the text lists all of them.
    """
    numbers = finite(values, 6, f"{what} along and about x, y, z")
    problems = [
        f"{what} {value:g} of {axis}: expected {-top if lowest is None else lowest:g} to {top:g}"
        for axis, value, top in zip(["x", "y", "z", "rx", "ry", "rz"], numbers, most, strict=True)
        if not (-top if lowest is None else lowest) <= value <= top
    ]
    if problems:
        raise WrongValue("; ".join(problems))
    return numbers
