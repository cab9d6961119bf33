"""A force/torque sensor between the last link of an arm and its hand.

It measures what a real one does: contacts, a carried object, weight and inertia of the hand, noise and a bias. As in
the drivers of real sensors, the weight of the hand is compensated from its mass and centre of mass, and the remaining
bias is zeroed on request.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from skiros2_common.core.errors import WrongValue
from skiros2_sim.core.joint import finite

Array = npt.NDArray[np.float64]

_GRAVITY = np.array([0.0, 0.0, -9.81])


@dataclass(frozen=True)
class SensorModel:
    """Errors of a sensor.

    :param force_noise: standard deviation of each force (N).
    :param torque_noise: standard deviation of each torque (Nm).
    :param bias: constant error (N, Nm).
    :raises WrongValue: a number is not finite, or a noise is negative.
    """

    force_noise: float = 0.0
    torque_noise: float = 0.0
    bias: tuple[float, ...] = (0.0,) * 6

    def __post_init__(self) -> None:
        finite(self.bias, 6, "bias of a force/torque sensor")
        for name, value in (("force_noise", self.force_noise), ("torque_noise", self.torque_noise)):
            if not (math.isfinite(value) and value >= 0.0):
                raise WrongValue(f"{name} {value}: expected a number of 0 or more")


class WristSensor:
    """A sensor.

    :param mass: of the hand (kg).
    :param centre: its centre of mass in the sensor's frame (m).
    :param random: source of the noise.
    """

    def __init__(
        self, mass: float, centre: Sequence[float], model: SensorModel, random: np.random.Generator
    ) -> None:
        self._mass, self._centre = mass, np.array(centre)
        self._deviation = np.array([model.force_noise] * 3 + [model.torque_noise] * 3)
        self._bias = np.array(model.bias)
        self._random = random
        self._offset = np.zeros(6)
        self._measured = np.zeros(6)

    def zero(self) -> None:
        """Makes the last measured wrench the zero of the following ones."""
        self._offset = self._measured.copy()

    def measure(self, wrench: Array, orientation: Sequence[float]) -> Array:
        """Returns the measured wrench without the weight of the hand: force (N), torque (Nm) about the sensor.

        :param wrench: wrench that the hand and all that touches it exert on the sensor, in its frame.
        :param orientation: of the sensor, in the map.
        """
        weight = Rotation.from_quat(orientation).inv().apply(self._mass * _GRAVITY)
        noise = self._random.standard_normal(6) * self._deviation if self._deviation.any() else 0.0
        self._measured = wrench - np.concatenate([weight, np.cross(self._centre, weight)]) + self._bias + noise
        return self._measured - self._offset
