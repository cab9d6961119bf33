"""Registration of points with the shape of an object: its pose, with covariance and quality.

Point-to-plane ICP (Y. Chen and G. Medioni, "Object modelling by registration of multiple range images", 1992): each
point p is matched with the nearest sample s of the shape, with normal n; the pose minimises the sum of
(n (p - s) / sigma)^2. One step solves the normal equations H e = b, with rows n and (p - t) x n, t being the origin of
the object.

The inverse of H is the covariance of the pose for independent errors of the points (A. Censi, "An accurate closed-form
estimate of ICP's covariance", 2007, for this error function). Directions that the points do not determine have no
information: steps leave them unchanged (J. Zhang, M. Kaess and S. Singh, "On degeneracy of optimization-based state
estimation problems", 2016), and other views add it. Errors of the camera's pose are added to the covariance.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from skiros2_motion.core.geometry import Pose, Quaternion, multiplied
from skiros2_perception.core.problems import Code, Problem, Rejected
from skiros2_perception.core.shape import Shape
from skiros2_perception.core.transforms import (
    Array,
    difference,
    matrix_of,
    moved,
    untransformed,
)
from skiros2_perception.core.view import Cloud, Sensor, View
from skiros2_perception.core.visibility import Visibility, visibility

#: Number of points for the search over all starts, and for the result.
_COARSE, _FINE = 400, 6000
_COARSE_STEPS, _FINE_STEPS = 12, 20
#: Maximum angle between the normals of a point and of its match (cosine).
_SAME_SIDE = math.cos(math.radians(40.0))
#: Eigenvalues of H below this fraction of the largest one carry no information.
_DEGENERATE = 1e-3
#: Deviation of a real surface from its shape (m), added to that of each point.
_SURFACE = 0.0003
#: A start that scores lower than the best one by less counts as equal; the one closest to the prior wins.
_EQUAL_SCORE = 0.02


class Limits(NamedTuple):
    """When a registration is accepted.

    :param points: minimum number of matched points.
    :param fitness: minimum fraction of the points that match.
    :param residual: maximum root mean square distance of matched points, in standard deviations.
    :param contradicted: maximum fraction of the visible surface behind which the camera sees something.
    :param shift: maximum distance from the prior position (m).
    :param turn: maximum angle from the prior orientation (rad).
    """

    points: int = 150
    fitness: float = 0.8
    residual: float = 2.0
    contradicted: float = 0.15
    shift: float = 0.05
    turn: float = math.radians(25.0)


DEFAULT = Limits()


@dataclass(frozen=True, eq=False)
class Registration:
    """The pose of an object in one view.

    :param pose: of the object in the reference frame of the view.
    :param information: inverse covariance (6 x 6) of its error, see `transforms`; singular if the view does not
        determine the pose.
    :param fitness: fraction of the points that match, 0 to 1.
    :param residual: root mean square distance of matched points from the surface, along its normal (m).
    :param visibility: of the object at that pose.
    :param stamp: time of the view (s).
    """

    pose: Pose
    information: Array
    fitness: float
    residual: float
    visibility: Visibility
    stamp: float


class _Fit(NamedTuple):
    pose: Pose
    hessian: Array
    fitness: float
    residual: float  # m
    chi2: float  # per match
    matches: int


def register(
    shape: Shape, cloud: Cloud, view: View, sensor: Sensor, prior: Pose, limits: Limits = DEFAULT
) -> Registration:
    """Returns the pose of an object whose points are given.

    Searches from the prior pose, from the centre of the points, and from the rotations of each after which the shape
    looks similar. Of equally good poses, the one nearest to the prior is returned.

    :param cloud: points of the object in the view.
    :param prior: expected pose of the object, in the reference frame of the view.
    :raises Rejected: no pose fits; it has all reasons.
    """
    if len(cloud) < limits.points:
        raise Rejected(Problem(Code.TOO_FEW_POINTS, f"{len(cloud)} points: expected at least {limits.points}"))
    coarse = cloud.thinned(_COARSE)
    tries = [_fit(shape, coarse, start, _COARSE_STEPS, limits.shift) for start in _starts(shape, cloud, prior)]
    scored = [(fit, _score(fit, shape, view, sensor)) for fit in tries]
    # the best start of all, and the best acceptable one: they differ if the shape has a (nearly) equal other side
    near = [(fit, score) for fit, score in scored if not _far_problems(fit.pose, prior, limits)]
    starts = [max(group, key=lambda pair: pair[1])[0].pose for group in (scored, near) if group]
    fine = cloud.thinned(_FINE)
    fits = [_fit(shape, fine, start, _FINE_STEPS, 4 * sensor.noise + 0.004) for start in dict.fromkeys(starts)]
    scores = [_score(fit, shape, view, sensor) for fit in fits]
    equal = [fit for fit, score in zip(fits, scores, strict=True) if score >= max(scores) - _EQUAL_SCORE]
    fit = min(equal, key=lambda fit: _far(fit.pose, prior, shape))
    seen = visibility(shape, fit.pose, view, sensor)
    problems = _problems(fit, seen, prior, limits)
    if problems:
        raise Rejected(*problems)
    information = with_camera_error(fit.hessian / max(1.0, fit.chi2), fit.pose, view.pose, sensor)
    return Registration(fit.pose, information, fit.fitness, fit.residual, seen, view.stamp)


def with_camera_error(information: Array, pose: Pose, camera: Pose, sensor: Sensor) -> Array:
    """Returns the information (6 x 6) of a pose after adding the covariance Q of the camera's pose.

    (I^-1 + Q)^-1 = I - I (I + Q^-1)^-1 I, also for a singular I (identity of Woodbury).
    """
    # a rotation of the camera about its origin shifts the object, and rotates it
    arm = np.subtract(pose.position, camera.position)
    cross = np.array(((0.0, arm[2], -arm[1]), (-arm[2], 0.0, arm[0]), (arm[1], -arm[0], 0.0)))
    jacobian = np.block([[np.eye(3), cross], [np.zeros((3, 3)), np.eye(3)]])
    error = jacobian @ np.diag((sensor.position**2 + 1e-12,) * 3 + (sensor.angle**2 + 1e-12,) * 3) @ jacobian.T
    inner = np.linalg.solve(information + np.linalg.inv(error), information)
    result = information - information @ inner
    return np.asarray((result + result.T) / 2)


def _starts(shape: Shape, cloud: Cloud, prior: Pose) -> list[Pose]:
    turns: list[Quaternion] = shape.similar_turns()
    starts = [Pose(prior.position, multiplied(prior.orientation, turn)) for turn in turns]
    # the middle of what is seen, at the prior height
    low, high = np.percentile(cloud.points, (2, 98), axis=0)
    x, y, _ = (low + high) / 2
    centre = (float(x), float(y), prior.position[2])
    for yaw in (0.0, 0.15, -0.15):
        turned = multiplied((0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2)), prior.orientation)
        starts += [Pose(centre, multiplied(turned, turn)) for turn in turns]
    return starts


def _score(fit: _Fit, shape: Shape, view: View, sensor: Sensor) -> float:
    """Returns the fraction of matched points, times that of the visible surface that is not contradicted."""
    return fit.fitness * (1.0 - visibility(shape, fit.pose, view, sensor, samples=600).absent)


def _far(pose: Pose, prior: Pose, shape: Shape) -> float:
    """Returns how far a pose is from the prior (m): the shift, and the turn at the corner of the shape."""
    error = difference(pose, prior)
    return float(np.linalg.norm(error[:3]) + shape.radius * np.linalg.norm(error[3:]))


def _fit(shape: Shape, cloud: Cloud, pose: Pose, steps: int, reach: float) -> _Fit:
    """Minimises the distances of points from the shape.

    :param reach: maximum distance of a match at first (m); it shrinks to six standard deviations.
    """
    least = 6 * float(np.median(cloud.deviations)) + 0.002
    scale = np.array((1.0, 1.0, 1.0, *(1 / shape.radius,) * 3))
    matches = _matches(shape, cloud, pose, reach)
    for _ in range(steps):
        rows, residuals, weights = matches
        if len(rows) < 6:
            break
        j = rows * scale
        values, vectors = np.linalg.eigh(j.T @ (j * weights[:, None]))
        good = values > _DEGENERATE * values[-1]
        right = vectors.T @ (j.T @ (weights * residuals))
        step = scale * (vectors[:, good] @ (right[good] / values[good]))
        pose = moved(pose, step)
        reach = max(least, reach / 1.5)
        matches = _matches(shape, cloud, pose, reach)
        if reach == least and np.abs(step / scale).max() < 1e-6:
            break
    return _result(shape, cloud, pose, least)


class _Matches(NamedTuple):
    rows: Array  # n x 6
    residuals: Array  # n (m)
    weights: Array  # n (1 / m^2)


def _matches(shape: Shape, cloud: Cloud, pose: Pose, reach: float) -> _Matches:
    """Returns the rows of the normal equations for the points with a match."""
    rotation = matrix_of(pose.orientation)
    local = untransformed(pose, cloud.points)
    distances, nearest = shape.tree.query(local, distance_upper_bound=reach)
    found = np.isfinite(distances)
    found[found] = np.einsum("ni,ni->n", cloud.normals[found] @ rotation, shape.normals[nearest[found]]) > _SAME_SIDE
    normals = shape.normals[nearest[found]] @ rotation.T
    residuals = np.einsum("ni,ni->n", shape.normals[nearest[found]], local[found] - shape.points[nearest[found]])
    arms = cloud.points[found] - np.asarray(pose.position)
    rows = np.hstack((normals, np.cross(arms, normals)))
    return _Matches(rows, residuals, 1 / (cloud.deviations[found] ** 2 + _SURFACE**2))


def _result(shape: Shape, cloud: Cloud, pose: Pose, reach: float) -> _Fit:
    rows, residuals, weights = _matches(shape, cloud, pose, reach)
    count = len(rows)
    if count == 0:
        return _Fit(pose, np.zeros((6, 6)), 0.0, math.inf, math.inf, 0)
    scale = np.array((1.0, 1.0, 1.0, *(1 / shape.radius,) * 3))
    j = rows * scale
    values, vectors = np.linalg.eigh(j.T @ (j * weights[:, None]))
    values = np.where(values > _DEGENERATE * values[-1], values, 0.0)
    hessian = (vectors * values) @ vectors.T / np.outer(scale, scale)
    chi2 = float(np.sum(weights * residuals**2) / max(1, count - 6))
    return _Fit(pose, hessian, count / len(cloud), math.sqrt(float(np.mean(residuals**2))), chi2, count)


def _problems(fit: _Fit, seen: Visibility, prior: Pose, limits: Limits) -> list[Problem]:
    checks = (
        (fit.fitness < limits.fitness, Code.LOW_FITNESS,
         f"{fit.fitness:.0%} of the points match the shape: expected at least {limits.fitness:.0%}"),
        (fit.matches and fit.chi2 > limits.residual**2, Code.LARGE_RESIDUAL,
         f"matched points are {math.sqrt(fit.chi2):.1f} standard deviations from the shape: expected up to"
         f" {limits.residual:g}"),
        (seen.absent > limits.contradicted, Code.CONTRADICTED,
         f"the camera sees through {seen.absent:.0%} of the shape: expected up to {limits.contradicted:.0%}"),
    )  # fmt: skip
    found = [Problem(code, text) for is_bad, code, text in checks if is_bad]
    return found + _far_problems(fit.pose, prior, limits)


def _far_problems(pose: Pose, prior: Pose, limits: Limits) -> list[Problem]:
    """Returns the reasons why a pose is too far from the prior."""
    error = difference(pose, prior)
    shift, turn = float(np.linalg.norm(error[:3])), float(np.linalg.norm(error[3:]))
    found = []
    if shift > limits.shift:
        text = f"{shift * 1000:.0f} mm from the expected position: expected up to {limits.shift * 1000:.0f} mm"
        found.append(Problem(Code.FAR_FROM_PRIOR, text))
    if turn > limits.turn:
        text = f"{math.degrees(turn):.0f} degrees from the expected orientation: expected up to"
        found.append(Problem(Code.FAR_FROM_PRIOR, f"{text} {math.degrees(limits.turn):.0f} degrees"))
    return found
