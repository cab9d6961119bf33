"""The force/torque sensor of a wrist."""

import math

import numpy as np
import pytest

from skiros2_common.core.errors import WrongValue
from skiros2_motion.core.geometry import from_euler
from skiros2_sim.core.wrist_sensor import SensorModel, WristSensor

DOWN = from_euler(math.pi, 0.0, 0.0)
UPRIGHT = (0.0, 0.0, 0.0, 1.0)


def sensor(mass: float = 0.0, centre=(0.0, 0.0, 0.1), **errors) -> WristSensor:
    return WristSensor(mass, centre, SensorModel(**errors), np.random.default_rng(1))


def weight_of(mass: float, orientation, centre=(0.0, 0.0, 0.1)) -> np.ndarray:
    """The wrench of a hand's weight in the frame of a sensor that points down or up."""
    force = np.array([0.0, 0.0, -9.81 * mass if orientation == UPRIGHT else 9.81 * mass])
    return np.concatenate([force, np.cross(centre, force)])


@pytest.mark.parametrize("orientation", [UPRIGHT, DOWN])
def test_weight_of_the_hand_is_compensated_in_each_orientation(orientation) -> None:
    assert sensor(mass=0.8).measure(weight_of(0.8, orientation), orientation) == pytest.approx([0.0] * 6, abs=1e-9)


def test_carried_object_is_measured_in_the_frame_of_the_sensor() -> None:
    wrench = weight_of(0.8, DOWN) + np.array([0.0, 0.0, 2.0, 0.0, 0.0, 0.0])
    assert sensor(mass=0.8).measure(wrench, DOWN)[:3] == pytest.approx([0.0, 0.0, 2.0])


def test_lever_of_the_hand_makes_a_torque() -> None:
    force = np.array([0.0, 0.0, -9.81])
    raw = np.concatenate([force, np.cross([0.05, 0.0, 0.0], force)])
    assert sensor(mass=1.0, centre=(0.05, 0.0, 0.0)).measure(raw, UPRIGHT) == pytest.approx([0.0] * 6, abs=1e-9)
    assert raw[4] == pytest.approx(0.4905)


def test_zeroing_removes_the_bias() -> None:
    biased = sensor(bias=(1.0, 2.0, 3.0, 0.1, 0.2, 0.3))
    assert biased.measure(np.zeros(6), UPRIGHT) == pytest.approx([1.0, 2.0, 3.0, 0.1, 0.2, 0.3])
    biased.zero()
    assert biased.measure(np.array([5.0, 0.0, 0.0, 0.0, 0.0, 0.0]), UPRIGHT) == pytest.approx([5.0, 0, 0, 0, 0, 0])


def test_noise_has_the_given_deviation_and_no_mean() -> None:
    noisy = sensor(force_noise=0.2, torque_noise=0.01)
    values = np.array([noisy.measure(np.zeros(6), UPRIGHT) for _ in range(5000)])
    assert values.std(axis=0) == pytest.approx([0.2] * 3 + [0.01] * 3, rel=0.05)
    assert values.mean(axis=0) == pytest.approx(0.0, abs=0.02)


@pytest.mark.parametrize("errors", [{"force_noise": -1.0}, {"torque_noise": math.nan}, {"bias": (1.0,)}])
def test_invalid_errors_are_refused(errors) -> None:
    with pytest.raises(WrongValue):
        SensorModel(**errors)
