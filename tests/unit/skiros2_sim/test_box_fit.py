"""Fitting boxes of known size to points on their visible sides."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from skiros2_motion.core.geometry import (
    Pose,
    Vector,
    angle_between,
    from_euler,
    rotated,
)
from skiros2_sim.core.perception import (
    Points,
    corners_of,
    fit_box,
    least_rectangle,
    least_turned,
    outline_area,
    quaternion_of,
)
from support.box_symmetry import turn_between

EYE = np.array((0.2, -0.1, 0.6))
SIZES = [(0.05, 0.05, 0.05), (0.05, 0.05, 0.09), (0.04, 0.06, 0.1), (0.2, 0.3, 0.04)]


def seen_from(eye: Points, pose: Pose, size: Vector) -> Points:
    """Points 3 mm apart on the sides of a box that face the eye."""
    half = np.asarray(size) / 2
    sides = []
    for axis, sign in itertools.product(range(3), (-1.0, 1.0)):
        a, b = (n for n in range(3) if n != axis)
        u, v = np.meshgrid(np.arange(-half[a], half[a], 0.003), np.arange(-half[b], half[b], 0.003))
        side = np.empty((u.size, 3))
        side[:, a], side[:, b], side[:, axis] = u.ravel(), v.ravel(), sign * half[axis]
        normal = np.asarray(rotated(pose.orientation, tuple(sign * np.eye(3)[axis])))
        points = np.array([rotated(pose.orientation, tuple(p)) for p in side]) + pose.position
        if (eye - points.mean(axis=0)) @ normal > 0:
            sides.append(points)
    return np.vstack(sides)


@pytest.mark.parametrize("size", SIZES, ids=str)
@pytest.mark.parametrize("yaw", [0.0, 0.4, 1.3, -2.5])
def test_fit_finds_the_pose_of_a_box(size: Vector, yaw: float) -> None:
    pose = Pose((0.05, -0.03, 0.1), from_euler(0.0, 0.0, yaw))
    fit = fit_box(seen_from(EYE, pose, size), size)
    assert math.dist(fit.pose.position, pose.position) < 0.003
    assert turn_between(fit.pose, pose, size) < 0.02
    assert fit.error < 0.001


@pytest.mark.parametrize("turn", [(math.pi / 2, 0.0, 0.3), (0.0, math.pi / 2, 1.0), (0.2, -0.25, 0.7)])
def test_fit_finds_lying_and_tilted_boxes(turn: Vector) -> None:
    size = (0.04, 0.06, 0.1)
    pose = Pose((0.0, 0.02, 0.0), from_euler(*turn))
    fit = fit_box(seen_from(EYE, pose, size), size)
    assert math.dist(fit.pose.position, pose.position) < 0.003
    assert turn_between(fit.pose, pose, size) < 0.02


def test_fit_averages_noise() -> None:
    size = (0.05, 0.05, 0.05)
    pose = Pose((0.0, 0.0, 0.0), from_euler(0.0, 0.0, 0.5))
    points = seen_from(EYE, pose, size)
    points += np.random.default_rng(3).normal(0.0, 0.002, points.shape)
    fit = fit_box(points, size)
    assert math.dist(fit.pose.position, pose.position) < 0.002
    assert turn_between(fit.pose, pose, size) < 0.05
    assert fit.error == pytest.approx(0.002, rel=0.3)


def test_fit_accepts_three_points() -> None:
    fit = fit_box(np.array(((0.0, 0.0, 0.0), (0.01, 0.0, 0.0), (0.0, 0.01, 0.0))), (0.05, 0.05, 0.05))
    assert all(map(math.isfinite, (*fit.pose.position, *fit.pose.orientation)))


def test_fit_accepts_identical_points() -> None:
    fit = fit_box(np.zeros((50, 3)), (0.05, 0.05, 0.05))
    assert fit.error < 0.001


@pytest.mark.parametrize(("yaw", "size", "expected"), [
    (math.pi / 2, (0.05, 0.05, 0.08), 0.0),
    (1.0, (0.05, 0.05, 0.08), 1.0 - math.pi / 2),
    (1.0, (0.04, 0.05, 0.08), 1.0),
    (3.0, (0.04, 0.05, 0.08), 3.0 - math.pi),
])  # fmt: skip
def test_fit_returns_the_smallest_equivalent_rotation(yaw: float, size: Vector, expected: float) -> None:
    found = least_turned(from_euler(0.0, 0.0, yaw), size)
    assert angle_between(found, from_euler(0.0, 0.0, expected)) < 1e-6


def test_minimum_rectangle_is_aligned_with_the_points() -> None:
    corners = corners_of((0.4, 0.2, 0.0))[:, :2]
    cos, sin = math.cos(0.3), math.sin(0.3)
    angle, middle = least_rectangle(corners @ np.array(((cos, sin), (-sin, cos))) + (1.0, 2.0))
    assert angle == pytest.approx(0.3)
    assert middle == pytest.approx((1.0, 2.0))


def test_outline_omits_inner_points() -> None:
    assert outline_area(np.array(((0, 0), (2, 0), (1, 0.5), (2, 1), (1, 0), (0, 1), (0, 0)), float)) == pytest.approx(2)


def test_outline_of_a_line_has_no_area() -> None:
    assert outline_area(np.array(((0, 0), (1, 1), (2, 2)), float)) == 0.0


@pytest.mark.parametrize("turn", [(0.0, 0.0, 0.0), (0.3, -0.8, 2.0), (math.pi, 0.0, 0.0), (0.0, 0.0, math.pi)])
def test_quaternion_equals_the_rotation_matrix(turn: Vector) -> None:
    q = from_euler(*turn)
    columns = np.stack([rotated(q, tuple(axis)) for axis in np.eye(3)], axis=1)
    assert angle_between(quaternion_of(columns), q) < 1e-6
