"""Forward and inverse kinematics of an arm.

The kinematics are a chain of fixed transforms and joints, derived once from the loaded model; the physics is not used
afterwards. Poses are those of the tool in the frame that the arm is mounted in (it moves with a mobile base), unless
noted otherwise.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from skiros2_std_reasoners.core.geometry import Pose, angle_between, normalized, rotated

Array = npt.NDArray[np.float64]

#: Accuracy of a solution (m, rad).
POSITION_ACCURACY = 1e-4
ORIENTATION_ACCURACY = 1e-3
#: Number of random restarts, and of steps per start.
_RESTARTS = 12
_STEPS = 60
#: Maximum step of a joint (rad or m) within the validity of the linear model.
_LARGEST_STEP = 0.4
#: Weight of an angle against a distance (m/rad).
_METRES_PER_RADIAN = 0.3


class Segment(NamedTuple):
    """A joint of the chain: its frame in the previous joint's frame at position 0, and its axis."""

    fixed: Array  # 4 x 4
    axis: Array  # of unit length, in the joint's frame
    slides: bool  # along the axis; else it turns about it
    lower: float
    upper: float


class Solution(NamedTuple):
    """A result of the solver: joint positions, and position and orientation error (m, rad)."""

    positions: Array
    off: float
    turned: float

    @property
    def converged(self) -> bool:
        """Whether this is a solution; otherwise it is the nearest pose found."""
        return self.off <= POSITION_ACCURACY and self.turned <= ORIENTATION_ACCURACY


class ArmKinematics:
    """A chain of joints with a tool at its end."""

    def __init__(self, segments: Sequence[Segment], tool: Pose, rest: Sequence[float], seed: int = 0) -> None:
        """`tool`: its pose in the last joint's frame. `rest`: preferred posture. `seed`: of random restarts."""
        self.segments = tuple(segments)
        self.lower = np.array([s.lower for s in segments])
        self.upper = np.array([s.upper for s in segments])
        self.rest = np.clip(np.array(rest, dtype=float), self.lower, self.upper)
        self._fixed = np.array([s.fixed for s in segments])
        self._tool = matrix(tool)
        self._slides = np.array([s.slides for s in segments])
        axes = np.array([s.axis for s in segments])
        self._axes = axes
        # Rodrigues: R(q) = I + sin q K + (1 - cos q) K K, with K the axis as a cross product
        self._cross = np.array([_cross_matrix(axis) for axis in axes])
        self._cross_squared = self._cross @ self._cross
        self._seed = seed

    def forward(self, positions: Sequence[float] | Array) -> Pose:
        """Returns the pose of the tool."""
        return pose_of(self._frames(np.asarray(positions, dtype=float))[-1] @ self._tool)

    def jacobian(self, positions: Sequence[float] | Array) -> Array:
        """Returns the Jacobian of the tool: 6 x n, linear (m), then angular (rad)."""
        return self.jacobian_and_tool(positions)[0]

    def jacobian_and_tool(self, positions: Sequence[float] | Array) -> tuple[Array, Array]:
        """Returns the Jacobian, and the tool frame as a transform (4 x 4)."""
        return self._jacobian(self._frames(np.asarray(positions, dtype=float)))

    def inverse(self, target: Pose, start: Sequence[float] | Array, restarts: int = _RESTARTS) -> Solution:
        """Returns joint positions within the limits for a pose of the tool: starting at `start`, then at the rest
        posture, then at random postures (the same in each call). Without a solution, returns the nearest result."""
        wanted = matrix(Pose(target.position, normalized(target.orientation)))
        best: Solution | None = None
        for posture in self._postures(np.asarray(start, dtype=float), restarts):
            found = self._solve_from(wanted, posture)
            if found.converged:
                return found
            if best is None or _cost(found) < _cost(best):
                best = found
        assert best is not None  # there is at least one start
        return best

    def _postures(self, start: Array, restarts: int) -> list[Array]:
        draw = np.random.default_rng(self._seed)
        drawn = self.lower + (self.upper - self.lower) * draw.random((restarts, len(self.segments)))
        return [np.clip(start, self.lower, self.upper), *([self.rest] if restarts else []), *drawn]

    def _solve_from(self, wanted: Array, start: Array) -> Solution:
        """Damped least squares with the rest posture in the nullspace (Nakamura and Hanafusa, Inverse Kinematic
        Solutions with Singularity Robustness, 1986)."""
        q = start.copy()
        reached = Solution(q, np.inf, np.inf)
        for step in range(_STEPS):
            jacobian, tool = self._jacobian(self._frames(q))
            error = difference(wanted, tool)
            off, turned = float(np.linalg.norm(error[:3])), float(np.linalg.norm(error[3:]))
            if off + turned < reached.off + reached.turned:
                reached = Solution(q.copy(), off, turned)
            if reached.converged and step:
                break
            damping = 1e-5 + min(0.05, 0.1 * (off + _METRES_PER_RADIAN * turned)) ** 2
            dq = self._step(jacobian, error, damping, q)
            largest = float(np.max(np.abs(dq)))
            q = np.clip(q + dq * min(1.0, _LARGEST_STEP / largest if largest else 1.0), self.lower, self.upper)
        return reached

    def _step(self, jacobian: Array, error: Array, damping: float, q: Array) -> Array:
        """Returns the step of the joints for an error. Joints that would exceed a limit are excluded once."""
        free = np.ones(len(q), dtype=bool)
        dq = np.zeros_like(q)
        for _ in range(2):
            j = jacobian[:, free]
            turning_back = 0.05 * (self.rest - q)[free]
            inner = np.linalg.solve(j @ j.T + damping * np.eye(6), error - j @ turning_back)
            dq[:] = 0.0
            dq[free] = turning_back + j.T @ inner
            beyond = free & (((q <= self.lower) & (dq < 0)) | ((q >= self.upper) & (dq > 0)))
            if not beyond.any() or beyond.sum() == free.sum():
                break
            free &= ~beyond
        dq[~free] = 0.0
        return dq

    def _frames(self, q: Array) -> Array:
        """Returns the frames of all joints at the given positions: n x 4 x 4."""
        moved = np.zeros_like(self._fixed)
        angle = np.where(self._slides, 0.0, q)[:, None, None]
        moved[:, :3, :3] = np.eye(3) + np.sin(angle) * self._cross + (1 - np.cos(angle)) * self._cross_squared
        moved[:, :3, 3] = np.where(self._slides, q, 0.0)[:, None] * self._axes
        moved[:, 3, 3] = 1.0
        steps: Array = self._fixed @ moved
        for i in range(1, len(steps)):
            steps[i] = steps[i - 1] @ steps[i]
        return steps

    def _jacobian(self, frames: Array) -> tuple[Array, Array]:
        """Returns the Jacobian, and the tool frame (4 x 4)."""
        tool = frames[-1] @ self._tool
        axes = np.einsum("nij,nj->ni", frames[:, :3, :3], self._axes)
        arms = tool[:3, 3] - frames[:, :3, 3]
        jacobian = np.empty((6, len(axes)))
        jacobian[:3] = np.where(self._slides[:, None], axes, _crossed(axes, arms)).T
        jacobian[3:] = np.where(self._slides[:, None], 0.0, axes).T
        return jacobian, tool


def kinematics_from_model(
    joints: Sequence[tuple[float, Pose, Sequence[float], bool, float, float]],
    root: Pose,
    tool: Pose,
    rest: Sequence[float],
    seed: int = 0,
) -> ArmKinematics:
    """Derives the chain from the current state of a model.

    :param joints: for each joint: position, pose of its child link, axis in that link's frame, whether it is prismatic,
        lower and upper limit.
    :param root: the reference frame of the chain. All poses are in one common frame.
    """
    segments = []
    before = matrix(root)
    for position, link, axis, slides, lower, upper in joints:
        here = matrix(link)
        segment = Segment(np.eye(4), np.asarray(axis, dtype=float), slides, lower, upper)
        # the link frame is the joint frame after the joint's motion: remove the motion to get the fixed part
        back = np.eye(4)
        if slides:
            back[:3, 3] = -position * segment.axis
        else:
            k = _cross_matrix(segment.axis)
            back[:3, :3] = np.eye(3) - np.sin(position) * k + (1 - np.cos(position)) * k @ k
        segments.append(segment._replace(fixed=np.linalg.inv(before) @ here @ back))
        before = here
    return ArmKinematics(segments, pose_of(np.linalg.inv(before) @ matrix(tool)), rest, seed)


def distances(a: Pose, b: Pose) -> tuple[float, float]:
    """Returns the distance (m) and the angle (rad) between two poses."""
    return float(np.linalg.norm(np.subtract(a.position, b.position))), angle_between(a.orientation, b.orientation)


def difference(target: Array, frame: Array) -> Array:
    """Returns the transform between two frames (4 x 4 each) in the common frame: a vector (m), and a rotation vector
    (rad)."""
    way = np.empty(6)
    way[:3] = target[:3, 3] - frame[:3, 3]
    way[3:] = _rotation_vector(target[:3, :3] @ frame[:3, :3].T)
    return way


def matrix(pose: Pose) -> Array:
    """Converts a pose to a 4 x 4 transform."""
    result = np.eye(4)
    for i, axis in enumerate(((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))):
        result[:3, i] = rotated(pose.orientation, axis)
    result[:3, 3] = pose.position
    return result


def pose_of(transform: Array) -> Pose:
    """Converts a 4 x 4 transform to a pose."""
    r = transform[:3, :3]
    # largest component first (Shepperd, Quaternion from Rotation Matrix, 1978)
    squares = [1 + r[0, 0] - r[1, 1] - r[2, 2], 1 - r[0, 0] + r[1, 1] - r[2, 2]]
    squares += [1 - r[0, 0] - r[1, 1] + r[2, 2], 1 + r[0, 0] + r[1, 1] + r[2, 2]]
    x, y, z, w = r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1], squares[3]
    match int(np.argmax(squares)):
        case 0:
            x, y, z, w = squares[0], r[0, 1] + r[1, 0], r[0, 2] + r[2, 0], x
        case 1:
            x, y, z, w = r[0, 1] + r[1, 0], squares[1], r[1, 2] + r[2, 1], y
        case 2:
            x, y, z, w = r[0, 2] + r[2, 0], r[1, 2] + r[2, 1], squares[2], z
    px, py, pz = (float(v) for v in transform[:3, 3])
    return Pose((px, py, pz), normalized((float(x), float(y), float(z), float(w))))


def _cost(found: Solution) -> float:
    return found.off + _METRES_PER_RADIAN * found.turned


def _rotation_vector(turn: Array) -> Array:
    """Converts a rotation matrix to a rotation vector (rad), in the shorter direction."""
    x, y, z, cosine = turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1], np.trace(turn) - 1
    if cosine > -1.9:  # twice that of the angle, as x, y and z are twice the axis times its sine
        sine = math.sqrt(x * x + y * y + z * z)
        return np.array((x, y, z)) * (math.atan2(sine, cosine) / sine if sine > 1e-9 else 0.5)
    # near half a turn this is ill-conditioned; the quaternion is not
    frame = np.eye(4)
    frame[:3, :3] = turn
    q = pose_of(frame).orientation
    vector = np.array(q[:3]) if q[3] >= 0 else -np.array(q[:3])
    return np.asarray(vector * (2 * math.atan2(float(np.linalg.norm(vector)), abs(q[3])) / np.linalg.norm(vector)))


def _cross_matrix(v: Array) -> Array:
    x, y, z = v
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def _crossed(a: Array, b: Array) -> Array:
    """Row-wise cross product; faster than numpy's for few rows."""
    return np.column_stack(
        (
            a[:, 1] * b[:, 2] - a[:, 2] * b[:, 1],
            a[:, 2] * b[:, 0] - a[:, 0] * b[:, 2],
            a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0],
        )
    )
