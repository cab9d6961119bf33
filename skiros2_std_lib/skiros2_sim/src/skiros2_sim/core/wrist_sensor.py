"""A force/torque sensor between the last link of an arm and its hand.

It measures what a real one does: contacts, a carried object, weight and inertia of the hand, noise and a bias. As in
the drivers of real sensors, the weight of the hand is compensated from its mass and centre of mass, and the remaining
bias is zeroed on request.

It is read in each step: with six numbers, Python's floats take a third of the time of NumPy's arrays.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from skiros2_common.core.errors import WrongValue
from skiros2_motion.core.geometry import Pose, Vector, conjugated, cross, rotated
from skiros2_motion.core.numbers import finite
from skiros2_sim.core.physics import Part, Physics

#: Force (N) and torque (Nm).
Wrench = tuple[float, float, float, float, float, float]

_GRAVITY = -9.81
_NONE: Wrench = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


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
        self._bias = model.bias
        self._random = random
        self._is_noisy = bool(self._deviation.any())
        self._offset: Wrench = _NONE
        self._measured: Wrench = _NONE

    def zero(self) -> None:
        """Makes the last measured wrench the zero of the following ones."""
        self._offset = self._measured

    def measure(self, wrench: Sequence[float], orientation: Sequence[float]) -> Wrench:
        """Returns the measured wrench without the weight of the hand: force (N), torque (Nm) about the sensor.

        :param wrench: wrench that the hand and all that touches it exert on the sensor, in its frame.
        :param orientation: of the sensor, in the map.
        """
        weight = rotated(conjugated(orientation), (0.0, 0.0, self._mass * _GRAVITY))
        noise = (self._random.standard_normal(6) * self._deviation).tolist() if self._is_noisy else _NONE
        hand = (*weight, *cross(self._centre, weight))
        fx, fy, fz, tx, ty, tz = map(_with_errors, wrench, hand, self._bias, noise)
        self._measured = fx, fy, fz, tx, ty, tz
        ox, oy, oz, ax, ay, az = self._offset
        return fx - ox, fy - oy, fz - oz, tx - ax, ty - ay, tz - az


def _with_errors(felt: float, hand: float, bias: float, noise: float) -> float:
    return float(felt) - hand + bias + noise


class MountedSensor:
    """A sensor on a fixed joint of a simulated robot. The engine measures the force on the child link, in the frame of
    its centre of mass, without those that the coupling of two fingers bears.

    :param part: the child link of the joint.
    :param links: the child link and all its descendants.
    :param random: source of the noise.
    :param borne: as `Gripper.borne`.
    """

    def __init__(
        self,
        physics: Physics,
        part: Part,
        links: Sequence[int],
        model: SensorModel,
        random: np.random.Generator,
        borne: Callable[[], tuple[Vector, Vector] | None] = lambda: None,
    ) -> None:
        self._physics, self._part, self._borne = physics, part, borne
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
        self._measured: Wrench | None = None

    def after_step(self) -> None:
        """Called after each step. With noise it measures in each one, so that runs with one seed are identical."""
        self._measured = None
        if self.is_noisy:
            self._measure()

    def velocity(self) -> Vector:
        """Returns the velocity of the centre of mass of the hand's first link, in the map (m/s)."""
        return self._physics.velocity(self._part)[0]

    def zero(self) -> None:
        """Makes the last measured wrench the zero of the following ones."""
        self._measure()
        self._sensor.zero()
        self._measured = None

    def wrench(self, tool: Pose) -> Wrench:
        """Returns the measured external wrench on the hand: force (N), torque (Nm) about the tool, in its frame.

        :param tool: pose of the tool in the map.
        """
        measured = self._measure()
        pose = self._pose
        force, torque = rotated(pose.orientation, measured[:3]), rotated(pose.orientation, measured[3:])
        (px, py, pz), (qx, qy, qz) = pose.position, tool.position
        tx, ty, tz = cross((px - qx, py - qy, pz - qz), force)
        back = conjugated(tool.orientation)
        return (*rotated(back, force), *rotated(back, (torque[0] + tx, torque[1] + ty, torque[2] + tz)))

    def _measure(self) -> Wrench:
        if self._measured is None:
            reaction = self._physics.joint_states(self._part.body, (self._part.link,))[0].reaction
            self._pose = pose = self._frame()
            felt = [-part for part in reaction]
            borne = self._borne()
            if borne is not None:
                (px, py, pz), (x, y, z), force = borne[0], pose.position, borne[1]
                back, torque = conjugated(pose.orientation), cross((px - x, py - y, pz - z), force)
                felt = [a + b for a, b in zip(felt, (*rotated(back, force), *rotated(back, torque)), strict=True)]
            self._measured = self._sensor.measure(felt, pose.orientation)
        return self._measured

    def _frame(self) -> Pose:
        """Returns the pose of the sensor in the map."""
        return self._physics.mass_pose(self._part)
