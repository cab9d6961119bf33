"""Quaternions, Euler angles and poses, compared with matrices."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from skiros2_motion.core.geometry import (
    IDENTITY,
    Pose,
    angle_between,
    between,
    composed,
    from_euler,
    half_extents,
    inverted,
    multiplied,
    normalized,
    rotated,
    to_euler,
)

ANGLES = st.floats(-math.pi, math.pi)
VECTORS = st.tuples(*[st.floats(-10, 10)] * 3)
TURNS = st.tuples(ANGLES, st.floats(-1.5, 1.5), ANGLES)
POSES = st.builds(lambda p, turn: Pose(p, from_euler(*turn)), VECTORS, TURNS)


def matrix(roll, pitch, yaw):
    """Turns about the fixed axes x, y, z, in that order."""
    (sr, cr), (sp, cp), (sy, cy) = ((math.sin(a), math.cos(a)) for a in (roll, pitch, yaw))
    x = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    y = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    z = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
    return z @ y @ x


def same_turn(a, b):
    return angle_between(a, b) == pytest.approx(0.0, abs=1e-6)


@given(TURNS, VECTORS)
def test_euler_angles_match_rotation_matrices(turn, vector):
    assert rotated(from_euler(*turn), vector) == pytest.approx(tuple(matrix(*turn) @ vector), abs=1e-9)


@given(TURNS)
def test_euler_angles_round_trip(turn):
    assert to_euler(from_euler(*turn)) == pytest.approx(turn, abs=1e-6) or same_turn(
        from_euler(*to_euler(from_euler(*turn))), from_euler(*turn)
    )


@pytest.mark.parametrize("pitch", [math.pi / 2, -math.pi / 2])
@pytest.mark.parametrize(("roll", "yaw"), [(0.0, 0.7), (0.4, 0.0), (0.4, -1.1), (3.0, 3.0)])
def test_roll_is_zero_at_vertical_pitch(pitch, roll, yaw):
    q = from_euler(roll, pitch, yaw)
    found = to_euler(q)
    assert found[0] == 0.0
    assert found[1] == pytest.approx(pitch)
    assert same_turn(from_euler(*found), q)


@given(TURNS, TURNS, VECTORS)
def test_product_composes_rotations(a, b, vector):
    a, b = from_euler(*a), from_euler(*b)
    assert rotated(multiplied(a, b), vector) == pytest.approx(rotated(a, rotated(b, vector)), abs=1e-8)


@given(POSES)
def test_pose_and_inverse_are_the_identity(pose):
    there_and_back = composed(pose, inverted(pose))
    assert there_and_back.position == pytest.approx((0, 0, 0), abs=1e-8)
    assert same_turn(there_and_back.orientation, IDENTITY.orientation)


@given(POSES, POSES, POSES)
def test_composition_is_associative(a, b, c):
    left, right = composed(composed(a, b), c), composed(a, composed(b, c))
    assert left.position == pytest.approx(right.position, abs=1e-7)
    assert same_turn(left.orientation, right.orientation)


@pytest.mark.parametrize("angle", [0.0, 0.05, 1.0, math.pi])
def test_angle_between_orientations_is_that_of_the_rotation(angle):
    assert angle_between(IDENTITY.orientation, from_euler(0, 0, angle)) == pytest.approx(angle)
    assert angle_between(IDENTITY.orientation, tuple(-c for c in from_euler(0, 0, angle))) == pytest.approx(angle)


def test_zero_quaternion_is_the_identity():
    assert normalized((0, 0, 0, 0)) == IDENTITY.orientation
    assert normalized((0, 0, 3, 4)) == pytest.approx((0, 0, 0.6, 0.8))


def test_half_extents_contain_the_rotated_box():
    assert half_extents(IDENTITY.orientation, (2, 4, 6)) == pytest.approx((1, 2, 3))
    assert half_extents(from_euler(0, 0, math.pi / 2), (2, 4, 6)) == pytest.approx((2, 1, 3))
    assert half_extents(from_euler(0, 0, math.pi / 4), (2, 2, 2)) == pytest.approx((math.sqrt(2), math.sqrt(2), 1))


@given(POSES, POSES, st.floats(0.0, 1.0))
def test_pose_between_two_is_on_the_line_and_the_shorter_turn(start: Pose, end: Pose, part: float) -> None:
    pose = between(start, end, part)
    way, turn = math.dist(start.position, end.position), angle_between(start.orientation, end.orientation)
    assert math.dist(start.position, pose.position) == pytest.approx(part * way, abs=1e-9)
    assert angle_between(start.orientation, pose.orientation) == pytest.approx(part * turn, abs=1e-6)
    assert angle_between(pose.orientation, end.orientation) == pytest.approx((1.0 - part) * turn, abs=1e-6)
