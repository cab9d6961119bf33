"""The weight of the object in the hand of a simulated arm, which the compliant controller compensates."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from skiros2_motion.core.geometry import Vector, conjugated, rotated
from skiros2_sim.core.arm import Arm
from skiros2_sim.core.robot import Robot

Array = npt.NDArray[np.float64]

#: Maximum weight (N) of a carried object that is compensated.
_MAX = 30.0
_GRAVITY = 9.81


class Payload:
    """The compensated weight.

    :ivar force: force against it, in the robot's frame (N).
    """

    def __init__(self, robot: Robot, arm: Arm) -> None:
        self._robot, self._arm = robot, arm
        self.force = self._zeroed = np.zeros(3)

    @property
    def mass(self) -> float:
        """Mass of the object in the hand (kg)."""
        return math.hypot(*self.force.tolist()) / _GRAVITY

    def carry(self) -> None:
        """Compensates the weight of the object in the hand."""
        self.force = self._lifting()

    def zero(self) -> None:
        """The weight of the object in the hand is in the zero of the sensor from now on."""
        self._zeroed = self._lifting()

    def measured(self, orientation: tuple[float, float, float, float]) -> Vector:
        """Returns the compensating force that the sensor's measurement answers: that which its zero does not contain.

        :param orientation: of the tool in the robot's frame.
        :returns: along the axes of the tool (N).
        """
        return rotated(conjugated(orientation), (self.force - self._zeroed).tolist())

    def _lifting(self) -> Array:
        felt = rotated(self._arm.tool_pose().orientation, self._arm.wrench()[:3])[2]
        # a suspended object pulls down; a contact from below pushes up and is not compensated
        up = (0.0, 0.0, min(max(-felt, 0.0), _MAX))
        return np.array(rotated(conjugated(self._robot.pose().orientation), up))
