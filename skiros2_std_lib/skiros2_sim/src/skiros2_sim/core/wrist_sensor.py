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

from skiros2_common.core.errors import WrongValue
from skiros2_motion.core.geometry import Pose, conjugated, cross, rotated
from skiros2_motion.core.numbers import finite
from skiros2_sim.core.physics import Part, Physics

Array = npt.NDArray[np.float64]
#: Force (N) and torque (Nm).
Wrench = tuple[float, float, float, float, float, float]

_GRAVITY = -9.81


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


#: A sensor without errors.
EXACT = SensorModel()


class WristSensor:
    """A sensor.

    :param mass: of the hand (kg).
    :param centre: its centre of mass in the sensor's frame (m).
    :param random: source of the noise.
    """

    def __init__(self, mass: float, centre: Sequence[float], model: SensorModel, random: np.random.Generator) -> None:
        self._mass, self._centre = mass, tuple(float(value) for value in centre)
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
        weight = rotated(conjugated(orientation), (0.0, 0.0, self._mass * _GRAVITY))
        noise = self._random.standard_normal(6) * self._deviation if self._deviation.any() else 0.0
        self._measured = wrench - np.array((*weight, *cross(self._centre, weight))) + self._bias + noise
        return self._measured - self._offset


class MountedSensor:
    """A sensor on a fixed joint of a simulated robot. The engine measures the force on the child link, in the frame of
    its centre of mass.

    :param part: the child link of the joint.
    :param links: the child link and all its descendants.
    :param random: source of the noise.
    """

    def __init__(
        self,
        physics: Physics,
        part: Part,
        links: Sequence[int],
        model: SensorModel,
        random: np.random.Generator,
    ) -> None:
        self._physics, self._part = physics, part
        physics.add_force_sensor(*part)
        masses = [physics.mass(Part(part.body, link)) for link in links]
        centres = [physics.mass_pose(Part(part.body, link)).position for link in links]
        #: Pose of the sensor in the map at its last measurement.
        self._pose = pose = self._frame()
        #: Mass of the hand (kg).
        self.mass = sum(masses)
        centre = np.average(centres, axis=0, weights=masses) if self.mass > 0.0 else pose.position
        offset = rotated(conjugated(pose.orientation), np.subtract(centre, pose.position).tolist())
        self._sensor = WristSensor(self.mass, offset, model, random)
        #: Whether each measurement differs from the one before.
        self.is_noisy = model.force_noise > 0.0 or model.torque_noise > 0.0
        self._measured: Array | None = None

    def after_step(self) -> None:
        """Called after each step. With noise it measures in each one, so that runs with one seed are identical."""
        self._measured = None
        if self.is_noisy:
            self._measure()

    def zero(self) -> None:
        """Makes the last measured wrench the zero of the following ones."""
        self._measure()
        self._sensor.zero()
        self._measured = None

    def wrench(self, tool: Pose) -> Wrench:
        """Returns the measured external wrench on the hand: force (N), torque (Nm) about the tool, in its frame.

        :param tool: pose of the tool in the map.
        """
        measured = self._measure().tolist()
        pose = self._pose
        force, torque = rotated(pose.orientation, measured[:3]), rotated(pose.orientation, measured[3:])
        arm = [a - b for a, b in zip(pose.position, tool.position, strict=True)]
        about_tool = [a + b for a, b in zip(torque, cross(arm, force), strict=True)]
        back = conjugated(tool.orientation)
        return (*rotated(back, force), *rotated(back, about_tool))

    def _measure(self) -> Array:
        if self._measured is None:
            reaction = np.array(self._physics.joint_states(self._part.body, (self._part.link,))[0].reaction)
            self._pose = self._frame()
            self._measured = self._sensor.measure(-reaction, self._pose.orientation)
        return self._measured

    def _frame(self) -> Pose:
        """Returns the pose of the sensor in the map."""
        return self._physics.mass_pose(self._part)
