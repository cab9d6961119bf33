"""Forward and inverse kinematics of an arm, by Orocos KDL.

The chain is derived once from the loaded model; the physics is not used afterwards. Poses are those of the tool in the
frame that the arm is mounted in (it moves with a mobile base), unless noted otherwise. Called by one thread at a time.

KDL comes from Debian's `python3-pykdl`; it also has the mass matrix, gravity and Coriolis torques of a chain (4 us each
for seven joints). Pinocchio would save 29 of the 98 us of a control update, 4 % of the time of a step in contact, for
14 wheels that take 380 MB installed, and 0.5 s of import. Numba would take 208 MB, 0.6 s of import and 0.7 s for the
first call, 18 s without its cache. A random pose is solved in 1.9 ms on average, including restarts (own code in NumPy:
35 ms), and a pose next to a solved one in 0.05 ms.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import PyKDL

from skiros2_motion.core.geometry import Pose, angle_between, normalized
from skiros2_motion.core.motion import Pieces, complete

Array = npt.NDArray[np.float64]

#: Accuracy of a solution (m, rad).
POSITION_ACCURACY = 1e-4
ORIENTATION_ACCURACY = 1e-3
#: Number of random restarts, and maximum number of iterations per start (0.5 ms): 99 % of random poses are solved.
_RESTARTS, _ITERATIONS = 30, 60
#: Accuracy of KDL's iteration (m, rad), and damping at singularities.
_EPSILON, _DAMPING = 1e-5, 0.05
#: Weight of an angle against a distance (m/rad).
_METRES_PER_RADIAN = 0.3


class ChainJoint(NamedTuple):
    """A joint of the loaded model in its current state. All poses of a chain are in one common frame.

    :param position: rad or m.
    :param link: pose of the child link.
    :param axis: in the frame of the child link, of unit length.
    """

    position: float
    link: Pose
    axis: Sequence[float]
    is_prismatic: bool
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
    """A chain of joints with a tool at its end.

    :param joints: from the first one on, in the current state of the model.
    :param root: the reference frame of the chain.
    :param tool: current pose of the tool.
    :param rest: preferred posture (rad, m).
    :param seed: of the random restarts.
    """

    def __init__(
        self, joints: Sequence[ChainJoint], root: Pose, tool: Pose, rest: Sequence[float], seed: int = 0
    ) -> None:
        self.lower = np.array([joint.lower for joint in joints])
        self.upper = np.array([joint.upper for joint in joints])
        self.rest = np.clip(np.array(rest, dtype=float), self.lower, self.upper)
        self._seed = seed
        chain = _chain(joints, root, tool)
        self._count = len(joints)
        self._forward = PyKDL.ChainFkSolverPos_recursive(chain)
        self._jacobian = PyKDL.ChainJntToJacSolver(chain)
        self._columns = PyKDL.Jacobian(self._count)
        self._indices = [(row, column) for row in range(6) for column in range(self._count)]
        velocities = PyKDL.ChainIkSolverVel_wdls(chain)
        velocities.setLambda(_DAMPING)
        self._inverse = PyKDL.ChainIkSolverPos_NR_JL(
            chain, _joints(self.lower), _joints(self.upper), self._forward, velocities, _ITERATIONS, _EPSILON
        )
        self._nearest = PyKDL.ChainIkSolverPos_LMA(chain)
        self._solvers = chain, velocities  # KDL keeps references to both

    def forward(self, positions: Sequence[float] | Array) -> Pose:
        """Returns the pose of the tool."""
        return pose_of(self._frame(_joints(positions)))

    def jacobian(self, positions: Sequence[float] | Array) -> Array:
        """Returns the Jacobian of the tool: 6 x n, linear (m), then angular (rad)."""
        return self.tool_and_jacobian(positions)[1]

    def tool_and_jacobian(self, positions: Sequence[float] | Array) -> tuple[Pose, Array]:
        """Same as `forward` and `jacobian`, in less time."""
        joints = _joints(positions)
        self._jacobian.JntToJac(joints, self._columns)
        elements = np.fromiter(map(self._columns.__getitem__, self._indices), float, 6 * self._count)
        return pose_of(self._frame(joints)), elements.reshape(6, self._count)

    def inverse(self, target: Pose, start: Sequence[float] | Array, restarts: int = _RESTARTS) -> Solution:
        """Returns joint positions within the limits for a pose of the tool: starting at `start`, then at the rest
        posture, then at random postures (the same in each call). Without a solution, returns the nearest result."""
        return complete(self.search(target, start, restarts))

    def search(self, target: Pose, start: Sequence[float] | Array, restarts: int = _RESTARTS) -> Pieces[Solution]:
        """Same as `inverse`, in pieces of one start each (at most 1 ms)."""
        wanted = frame_of(Pose(target.position, normalized(target.orientation)))
        best: Solution | None = None
        for posture in self._postures(np.asarray(start, dtype=float), restarts):
            found = self._solve_from(wanted, posture)
            if found.converged:
                return found
            if best is None or _cost(found) < _cost(best):
                best = found
            yield
        assert best is not None  # there is at least one start
        nearest = self._nearest_to(wanted)
        return nearest if _cost(nearest) < _cost(best) else best

    def _postures(self, start: Array, restarts: int) -> list[Array]:
        draw = np.random.default_rng(self._seed)
        drawn = self.lower + (self.upper - self.lower) * draw.random((restarts, self._count))
        return [np.clip(start, self.lower, self.upper), *([self.rest] if restarts else []), *drawn]

    def _solve_from(self, wanted: PyKDL.Frame, start: Array) -> Solution:
        """Solves with Newton's method and damped least squares, within the joint limits."""
        found = PyKDL.JntArray(self._count)
        self._inverse.CartToJnt(_joints(start), wanted, found)
        return self._solution(found, wanted)

    def _nearest_to(self, wanted: PyKDL.Frame) -> Solution:
        """Minimises the distance to an unreachable pose with Levenberg and Marquardt's method."""
        found = PyKDL.JntArray(self._count)
        self._nearest.CartToJnt(_joints(self.rest), wanted, found)
        return self._solution(_joints(np.clip([found[i] for i in range(self._count)], self.lower, self.upper)), wanted)

    def _solution(self, found: PyKDL.JntArray, wanted: PyKDL.Frame) -> Solution:
        error = PyKDL.diff(self._frame(found), wanted)
        return Solution(np.array([found[i] for i in range(self._count)]), error.vel.Norm(), error.rot.Norm())

    def _frame(self, positions: PyKDL.JntArray) -> PyKDL.Frame:
        frame = PyKDL.Frame()
        self._forward.JntToCart(positions, frame)
        return frame


def distances(a: Pose, b: Pose) -> tuple[float, float]:
    """Returns the distance (m) and the angle (rad) between two poses."""
    return math.dist(a.position, b.position), angle_between(a.orientation, b.orientation)


def difference(target: Pose, pose: Pose) -> Array:
    """Returns the way from a pose to a target, in their common frame: a vector (m), and a rotation vector (rad)."""
    twist = PyKDL.diff(frame_of(pose), frame_of(target))
    return np.array([twist[i] for i in range(6)])


def frame_of(pose: Pose) -> PyKDL.Frame:
    """Converts a pose to a frame of KDL."""
    return PyKDL.Frame(PyKDL.Rotation.Quaternion(*pose.orientation), PyKDL.Vector(*pose.position))


def pose_of(frame: PyKDL.Frame) -> Pose:
    """Converts a frame of KDL to a pose."""
    return Pose((frame.p[0], frame.p[1], frame.p[2]), normalized(frame.M.GetQuaternion()))


def _chain(joints: Sequence[ChainJoint], root: Pose, tool: Pose) -> PyKDL.Chain:
    """Derives the chain from the current state of the model: a link is at the end of its joint's motion."""
    chain = PyKDL.Chain()
    moving = PyKDL.Joint("root", PyKDL.Joint.Fixed)
    before = frame_of(root)  # the last link
    for index, joint in enumerate(joints):
        kind = PyKDL.Joint.TransAxis if joint.is_prismatic else PyKDL.Joint.RotAxis
        axis = PyKDL.Vector(*(float(value) for value in joint.axis))
        its = PyKDL.Joint(f"joint {index}", PyKDL.Vector.Zero(), axis, kind)
        at_zero = frame_of(joint.link) * its.pose(joint.position).Inverse()
        chain.addSegment(PyKDL.Segment(f"link {index}", moving, before.Inverse() * at_zero))
        moving, before = its, frame_of(joint.link)
    chain.addSegment(PyKDL.Segment("tool", moving, before.Inverse() * frame_of(tool)))
    return chain


def _joints(positions: Sequence[float] | Array) -> PyKDL.JntArray:
    result = PyKDL.JntArray(len(positions))
    for index, position in enumerate(positions):
        result[index] = position
    return result


def _cost(found: Solution) -> float:
    return found.off + _METRES_PER_RADIAN * found.turned
