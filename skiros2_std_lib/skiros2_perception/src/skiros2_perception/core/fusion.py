"""Fusion of the estimates of several views: an information filter on poses.

The estimate is a pose x with the inverse covariance L of its error. A measurement z with information I is added by
e = (L + I)^-1 I (z - x), x <- x + e, L <- L + I (S. Thrun, W. Burgard and D. Fox, "Probabilistic Robotics", 2005,
section 3.5); differences and sums are those of `transforms`. Measurements that disagree are refused.
"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2

from skiros2_common.core.errors import WrongValue
from skiros2_motion.core.geometry import Pose, Quaternion, composed
from skiros2_perception.core.problems import Code, Problem, Rejected
from skiros2_perception.core.registration import Registration
from skiros2_perception.core.transforms import Array, difference, moved, turned_covariance

#: Probability of a larger Mahalanobis distance of two estimates that agree.
_OUTLIER = 1e-3
#: Largest acceptable standard deviation of a determined pose: position (m), orientation (rad).
_POSITION, _ORIENTATION = 0.01, math.radians(5.0)
#: Information of a direction that nothing determines: a standard deviation of 1 m, and of 3 rad.
_NOTHING = np.diag((1.0,) * 3 + (0.1,) * 3)


@dataclass(frozen=True, eq=False)
class Estimate:
    """The pose of an object, with covariance and quality.

    :param pose: in the reference frame.
    :param information: inverse covariance (6 x 6) of its error, see `transforms`.
    :param fitness: mean fraction of matched points over the views, 0 to 1.
    :param residual: mean distance of matched points over the views (m).
    :param views: number of views.
    :param stamp: time of the last view (s).
    """

    pose: Pose
    information: Array
    fitness: float
    residual: float
    views: int
    stamp: float

    @property
    def covariance(self) -> Array:
        """Covariance (6 x 6): m^2, m rad, rad^2."""
        result = np.linalg.inv(self.information + _NOTHING)
        return np.asarray((result + result.T) / 2)

    @property
    def deviations(self) -> tuple[float, float]:
        """The largest standard deviation of the position (m) and of the orientation (rad), in any direction."""
        covariance = self.covariance
        position, angle = (float(np.linalg.eigvalsh(block)[-1]) for block in (covariance[:3, :3], covariance[3:, 3:]))
        return math.sqrt(position), math.sqrt(angle)


def estimate_of(registration: Registration) -> Estimate:
    """Returns the estimate of one view."""
    return Estimate(
        registration.pose,
        registration.information,
        registration.fitness,
        registration.residual,
        1,
        registration.stamp,
    )


def fused(first: Estimate, second: Estimate) -> Estimate:
    """Returns the estimate from both.

    :raises Rejected: the estimates disagree: their Mahalanobis distance is too large.
    """
    distance, limit = mahalanobis(first, second)
    if distance > limit:
        error = difference(second.pose, first.pose)
        shift, turn = float(np.linalg.norm(error[:3])), float(np.linalg.norm(error[3:]))
        text = (
            f"a new view disagrees with the previous ones ({first.views}) by {shift * 1000:.1f} mm and"
            f" {math.degrees(turn):.1f} degrees, Mahalanobis distance {distance:.1f}: expected up to {limit:.1f}; the"
            " object may have moved"
        )
        raise Rejected(Problem(Code.INCONSISTENT, text))
    information = first.information + second.information
    pull = second.information @ difference(second.pose, first.pose)
    step = np.asarray(np.linalg.solve(information + 1e-6 * _NOTHING, pull), float)
    views = first.views + second.views

    def mean(a: float, b: float) -> float:
        return (a * first.views + b * second.views) / views

    return Estimate(
        moved(first.pose, step),
        information,
        mean(first.fitness, second.fitness),
        mean(first.residual, second.residual),
        views,
        max(first.stamp, second.stamp),
    )


def mahalanobis(first: Estimate, second: Estimate) -> tuple[float, float]:
    """Returns the Mahalanobis distance of two estimates, and its limit for estimates of the same pose."""
    error = difference(second.pose, first.pose)
    squared = float(error @ np.linalg.solve(first.covariance + second.covariance, error))
    return math.sqrt(max(0.0, squared)), math.sqrt(float(chi2.isf(_OUTLIER, 6)))


def check_determined(estimate: Estimate) -> None:
    """Checks that the views determine the whole pose.

    :raises Rejected: a direction is not determined.
    """
    position, angle = estimate.deviations
    if position > _POSITION or angle > _ORIENTATION:
        text = (
            f"standard deviations up to {position * 1000:.1f} mm and {math.degrees(angle):.1f} degrees: expected up to"
            f" {_POSITION * 1000:g} mm and {math.degrees(_ORIENTATION):g} degrees; add a view from another side"
        )
        raise Rejected(Problem(Code.NOT_DETERMINED, text))


def in_frame(estimate: Estimate, frame: Pose) -> Estimate:
    """Returns an estimate in another frame.

    :param frame: pose of the present reference frame in the other one.
    """
    orientation: Quaternion = frame.orientation
    turned = turned_covariance(estimate.information, orientation)
    return Estimate(
        composed(frame, estimate.pose), turned, estimate.fitness, estimate.residual, estimate.views, estimate.stamp
    )


def covariance_text(covariance: Array) -> str:
    """Returns a covariance as JSON: 36 numbers, row by row."""
    return json.dumps([float(f"{number:.6g}") for number in np.asarray(covariance).ravel()])


def covariance_from(text: str) -> Array:
    """Reads a covariance (6 x 6) from JSON.

    :raises WrongValue: it is not a covariance of six numbers.
    """
    try:
        numbers = np.array(json.loads(text), float)
    except (ValueError, TypeError):
        numbers = np.empty(0)
    if numbers.shape != (36,) or not np.isfinite(numbers).all():
        raise WrongValue(f"covariance {text[:80]!r}: expected a JSON list of 36 finite numbers")
    covariance = numbers.reshape(6, 6)
    if not np.allclose(covariance, covariance.T, rtol=1e-3, atol=1e-12) or np.linalg.eigvalsh(covariance)[0] <= 0:
        raise WrongValue(f"covariance {text[:80]!r}: expected a symmetric positive definite matrix")
    return np.asarray((covariance + covariance.T) / 2)
