"""Mass and centre of mass of a payload, from wrenches that were measured with the tool in several orientations.

With the rotation R of the tool, the weight w in the base frame and the zero (f0, t0) of the sensor in the tool frame,
the sensor at rest measures

    f = R' w + f0,  t = c x R' w + t0

which is linear in w and f0, and then in the centre of mass c and t0. The weight is estimated as a vector, so that the
base frame may be tilted. (Atkeson, An and Hollerbach, Estimation of Inertial Parameters of Manipulator Loads and Links,
1986.)
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from skiros2_common.core.errors import WrongValue
from skiros2_motion.core.compliant_arm import Wrench
from skiros2_motion.core.geometry import Quaternion, Vector
from skiros2_motion.core.impedance import rotation_matrix

Array = npt.NDArray[np.float64]

#: Of the earth (m/s2).
GRAVITY = 9.81
#: Largest condition number of orientations that differ enough.
_CONDITION = 50.0
#: Mass below which there is no centre of mass (kg).
_NOTHING = 0.02


class PayloadSample(NamedTuple):
    """A measurement at rest, free of contact.

    :param orientation: of the tool in the base frame.
    :param wrench: along the axes of the tool, about its origin (N, Nm).
    """

    orientation: Quaternion
    wrench: Wrench


class PayloadEstimate(NamedTuple):
    """What the hand holds.

    :param mass: kg.
    :param centre: of mass, in the tool frame (m); the origin without a payload.
    :param residual: root mean square of the force that the estimate does not explain (N).
    """

    mass: float
    centre: Vector
    residual: float


def estimate_payload(samples: Sequence[PayloadSample]) -> PayloadEstimate:
    """Returns the payload that explains the samples best.

    :raises WrongValue: their orientations do not differ enough.
    """
    rotations = [rotation_matrix(sample.orientation).T for sample in samples]
    wrenches = np.array([sample.wrench for sample in samples]).reshape(-1, 6)
    about_weight = np.vstack([np.hstack([rotation, np.eye(3)]) for rotation in rotations] or [np.zeros((3, 6))])
    if len(samples) < 3 or np.linalg.cond(about_weight) > _CONDITION:
        raise WrongValue(f"the orientations of {len(samples)} samples do not differ enough for weight and zero")
    forces = wrenches[:, :3].ravel()
    solution = np.linalg.lstsq(about_weight, forces, rcond=None)[0]
    weight, off = solution[:3], about_weight @ solution - forces
    residual = float(np.sqrt(3.0 * np.mean(off**2)))
    mass = float(np.linalg.norm(weight)) / GRAVITY
    if mass < _NOTHING:
        return PayloadEstimate(mass, (0.0, 0.0, 0.0), residual)
    # c x f = -[f]x c
    about_centre = np.vstack([np.hstack([-_cross(rotation @ weight), np.eye(3)]) for rotation in rotations])
    x, y, z = np.linalg.lstsq(about_centre, wrenches[:, 3:].ravel(), rcond=None)[0][:3].tolist()
    return PayloadEstimate(mass, (x, y, z), residual)


def _cross(vector: Array) -> Array:
    x, y, z = vector
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
