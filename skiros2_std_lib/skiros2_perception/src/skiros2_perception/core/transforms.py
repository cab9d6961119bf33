"""Poses as NumPy arrays, and their errors in the tangent space.

The error of a pose is a vector of six numbers: the shift of its origin (m), then the rotation vector (rad), both along
the axes of the reference frame: `p' = p + e[:3]`, `R' = exp(e[3:]) R`. Covariances are of this vector, as in
`geometry_msgs/PoseWithCovariance`.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from skiros2_motion.core.geometry import Pose, Quaternion

Array = npt.NDArray[np.float64]


def quaternion_of(matrix: Array) -> Quaternion:
    """Converts a rotation matrix to a quaternion with w >= 0."""
    x, y, z, w = Rotation.from_matrix(matrix).as_quat(canonical=True)
    return float(x), float(y), float(z), float(w)


def matrix_of(orientation: Quaternion) -> Array:
    """Converts a quaternion to a rotation matrix."""
    return np.asarray(Rotation.from_quat(orientation).as_matrix())


def make_pose(position: Array, rotation: Array) -> Pose:
    """Makes a pose of a position (3) and a rotation matrix."""
    return Pose((float(position[0]), float(position[1]), float(position[2])), quaternion_of(rotation))


def transformed(frame: Pose, points: Array) -> Array:
    """Transforms points (n x 3) from a frame to the reference frame of its pose."""
    return np.asarray(points @ matrix_of(frame.orientation).T + np.asarray(frame.position))


def untransformed(frame: Pose, points: Array) -> Array:
    """Transforms points (n x 3) from the reference frame of a pose to its frame."""
    return np.asarray((points - np.asarray(frame.position)) @ matrix_of(frame.orientation))


def moved(pose: Pose, error: Array) -> Pose:
    """Returns a pose with an error (6) added."""
    rotation = Rotation.from_rotvec(error[3:]) * Rotation.from_quat(pose.orientation)
    return make_pose(np.asarray(pose.position) + error[:3], rotation.as_matrix())


def difference(pose: Pose, reference: Pose) -> Array:
    """Returns the error (6) that added to `reference` gives `pose`."""
    turn = Rotation.from_quat(pose.orientation) * Rotation.from_quat(reference.orientation).inv()
    return np.concatenate((np.subtract(pose.position, reference.position), turn.as_rotvec()))


def turned_covariance(covariance: Array, orientation: Quaternion) -> Array:
    """Returns a covariance (6 x 6) along the axes of another frame.

    :param orientation: of the present axes in the other frame.
    """
    turn = np.kron(np.eye(2), matrix_of(orientation))
    return np.asarray(turn @ covariance @ turn.T)


def inverse(matrix: Array) -> Array:
    """Returns the symmetric inverse of a covariance or information matrix."""
    result = np.linalg.inv(matrix)
    return np.asarray((result + result.T) / 2, float)
