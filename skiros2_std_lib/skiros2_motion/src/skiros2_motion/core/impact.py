"""Impacts of an arm: the peak force of a contact, and the speed that keeps it below a limit.

A tool with the apparent mass m that meets a contact of the stiffness k at the speed v, and is not pushed, has the peak

    F = v sqrt(k m)

because its kinetic energy m v^2 / 2 becomes that of the spring, F^2 / (2 k). Nothing that a controller does in the few
milliseconds until then changes it. The apparent mass along a direction u is u' (J M^-1 J')^-1 u, with the Jacobian J of
the tool (6 x n), the masses M of the arm, and u without rotation: faces meet, and the tool does not turn. A tool that
turns about an edge is lighter. (Khatib, Inertial Properties in Robotic Manipulation, 1995; ISO/TS 15066, annex A, has
the same formula.)
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

#: Apparent mass (kg) of an arm that does not know it: arms of 3 to 15 kg payload have 2 to 8 kg in most postures.
DEFAULT_MASS = 8.0
#: Stiffness (N/m) of hand and work piece where it is not known: parallel faces of metal, the stiffest that is met.
DEFAULT_STIFFNESS = 4e6
#: That of a contact that a tool keeps and which it does not approach: metal on metal, behind the links of an arm.
KEPT_STIFFNESS = 600e3
#: Minimum permitted speed (m/s): an arm that may not move at all is of no use.
MIN_SPEED = 0.002
#: Regularisation at singularities (1/kg, 1/(kg m2)).
_SINGULAR = 1e-6


def apparent_mass(jacobian: Array, masses: Array, direction: Sequence[float]) -> float:
    """Returns the mass that the tool has along a direction in which it does not turn (kg); very large at a singularity.

    :param jacobian: of the tool, 6 x n: linear, then angular.
    :param masses: n x n (kg m2).
    :param direction: unit vector, in the frame of the Jacobian.
    """
    mobility = jacobian @ np.linalg.solve(masses, jacobian.T) + _SINGULAR * np.eye(6)
    along = np.array([*direction, 0.0, 0.0, 0.0])
    return float(along @ np.linalg.solve(mobility, along))


def peak_force(speed: float, mass: float, stiffness: float = DEFAULT_STIFFNESS) -> float:
    """Returns the peak force (N) of a contact at a speed (m/s), with an apparent mass (kg) and a stiffness (N/m)."""
    return speed * math.sqrt(stiffness * mass)


def permitted_speed(force: float, mass: float, stiffness: float = DEFAULT_STIFFNESS, late: float = 0.0) -> float:
    """Returns the speed (m/s) at which a contact has a peak force (N), at least `MIN_SPEED`.

    :param mass: apparent mass (kg).
    :param stiffness: of the contact (N/m).
    :param late: force that the controller adds before a limit is noticed, per speed of its reference (Ns/m): the time
        until then x the controller's stiffness.
    """
    return max(MIN_SPEED, force / (math.sqrt(stiffness * mass) + late))
