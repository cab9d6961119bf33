"""The overlay motion: an Archimedean spiral."""

import math

import numpy as np
import pytest

from skiros2_common.core.errors import WrongValue
from skiros2_motion.core.spiral import Spiral, SpiralGoal

DT = 0.001


def points(spiral: Spiral, seconds: float) -> np.ndarray:
    return np.array([spiral.update(DT) for _ in range(round(seconds / DT))])


def test_neighbouring_turns_are_one_path_distance_apart() -> None:
    spiral = Spiral(SpiralGoal(radius=0.02, path_distance=0.002, path_velocity=0.05))
    track = points(spiral, 5.0)
    angle = np.unwrap(np.arctan2(track[:, 1], track[:, 0]))
    radius = np.linalg.norm(track, axis=1)
    turns = (angle[-1] - angle[1000]) / (2 * math.pi)
    assert turns > 3
    assert (radius[-1] - radius[1000]) / turns == pytest.approx(0.002, rel=1e-3)


def test_path_velocity_is_constant_outside_of_the_first_turn() -> None:
    spiral = Spiral(SpiralGoal(radius=0.02, path_distance=0.001, path_velocity=0.03))
    track = points(spiral, 4.0)
    speeds = np.linalg.norm(np.diff(track, axis=0), axis=1) / DT
    assert speeds[500:] == pytest.approx(0.03, rel=0.02)
    assert speeds.max() < 0.033


def test_spiral_stays_in_the_plane_of_its_direction() -> None:
    direction = (1.0, 2.0, 3.0)
    track = points(Spiral(SpiralGoal(0.01, 0.001, 0.05, direction)), 2.0)
    assert track @ np.array(direction) == pytest.approx(0.0, abs=1e-12)


def test_spiral_ends_at_the_outer_radius() -> None:
    spiral = Spiral(SpiralGoal(radius=0.003, path_distance=0.001, path_velocity=0.05))
    track = points(spiral, 3.0)
    assert spiral.is_complete
    assert np.linalg.norm(track[-1]) == pytest.approx(0.003)
    assert track[-1].tolist() == track[-2].tolist()


def test_decreasing_spiral_turns_back_and_grows_again() -> None:
    spiral = Spiral(SpiralGoal(0.003, 0.001, 0.05, allow_decrease=True))
    radius = np.linalg.norm(points(spiral, 1.9), axis=1)
    outer = int(np.argmax(radius[:900]))
    inner = outer + int(np.argmin(radius[outer:]))
    assert radius[outer] == pytest.approx(0.003, rel=0.01)
    assert radius[inner] < 1e-4
    assert radius[inner:].max() > 0.0025


def test_stopped_spiral_returns_to_its_centre_without_a_jump() -> None:
    spiral = Spiral(SpiralGoal(0.01, 0.002, 0.05))
    before = points(spiral, 1.0)
    spiral.stop()
    after = points(spiral, 1.0)
    steps = np.linalg.norm(np.diff(np.vstack([before[-1:], after]), axis=0), axis=1)
    assert steps.max() <= 0.05 * DT * 1.001
    assert spiral.has_ended
    assert after[-1] == pytest.approx(0.0)


def test_invalid_spiral_is_refused_with_all_problems() -> None:
    with pytest.raises(WrongValue) as refused:
        SpiralGoal(radius=-1.0, path_distance=math.nan, path_velocity=9.0, direction=(0.0, 0.0, 0.0))
    for name in ("radius -1", "path_distance nan", "path_velocity 9", "direction"):
        assert name in str(refused.value)
