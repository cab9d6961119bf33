"""A closed loop for the force along selected axes of a compliance frame; along the others the arm follows its
reference.

The impedance's spring of stiffness K pulls the tool along a selected axis by a *lead* l ahead of it. The loop moves the
reference with a velocity, which is limited, and adds a proportional part:

    l' = clip(a e, -v_max, v_max) - v,  lead = l + P e / K,  e = F - f

with the wanted force F, the measured one f (filtered), the velocity v of the tool, and the admittance a. In contact
this is a PI controller of the force. In the air the tool moves towards the surface with v_max (up to a fifth more while
it accelerates), however large F is, and the spring overcomes joint friction. (Position-based force control with an
inner impedance; Villani and De Schutter, Force Control, in Springer Handbook of Robotics, 2016.)

Anti-windup: K l stays within F and a margin for friction. Passivity: energy beyond the work of F itself comes from a
tank, which the damping refills; while it is empty, the loop adds none. (Ferraguti et al., An energy tank-based
interactive control architecture, 2015.)
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from skiros2_common.core.errors import WrongValue
from skiros2_motion.core.geometry import IDENTITY, Pose, Vector

Array = npt.NDArray[np.float64]

#: Maximum force (N), speed (m/s) and admittance (m/(s N)).
MAX_FORCE, MAX_SPEED, MAX_ADMITTANCE = 30.0, 0.1, 0.1
#: Force that the spring may have beyond the wanted one, for friction (N).
_MARGIN = 10.0
#: Time constant of the filter of the measured force (s), and proportional gain.
_FORCE_FILTER, _PROPORTIONAL = 0.005, 0.1
#: Capacity of the tank, which is full at first (J).
_TANK = 1.0
#: Largest gain K a dt of an update that is stable on a rigid surface.
_STABLE = 0.2


class ForceGoal(NamedTuple):
    """A force that is regulated.

    :param force: that the tool exerts along the axes of the compliance frame (N); 0 along axes that are not selected.
    :param axes: whether the force along each axis is regulated.
    :param speed: maximum speed along a selected axis (m/s).
    :param admittance: speed per error of the force (m/(s N)). Large on stiff and sloped surfaces, small for a contact
        at speed.
    :param tip: origin of the compliance frame in the tool frame (m): the tip of a held part. Its axes are those of the
        tool.
    """

    force: Vector
    axes: tuple[bool, bool, bool] = (False, False, True)
    speed: float = 0.02
    admittance: float = 0.02
    tip: Vector = (0.0, 0.0, 0.0)

    @property
    def frame(self) -> Pose:
        """The compliance frame in the tool frame."""
        return Pose(self.tip, IDENTITY.orientation)


def checked_goal(goal: ForceGoal) -> ForceGoal:
    """Returns the goal.

    :raises WrongValue: a number is not finite or out of range; the text lists all problems.
    """
    named = [(f"force {value} N", value, -MAX_FORCE, MAX_FORCE) for value in goal.force]
    named += [(f"speed {goal.speed} m/s", goal.speed, 0.0, MAX_SPEED)]
    named += [(f"admittance {goal.admittance} m/(s N)", goal.admittance, 0.0, MAX_ADMITTANCE)]
    named += [(f"tip {value} m", value, -1.0, 1.0) for value in goal.tip]
    problems = [f"{name}: expected {low:g} to {high:g}" for name, value, low, high in named if not low <= value <= high]
    if problems:
        raise WrongValue(f"force control: {'; '.join(problems)}")
    return goal


class ForceControl:
    """The loop of one arm. It starts without a lead, with the force that is measured then."""

    def __init__(self, goal: ForceGoal) -> None:
        self.goal = checked_goal(goal)
        self.axes = np.array(goal.axes)
        self._wanted = np.where(self.axes, goal.force, 0.0)
        self._measured: Array | None = None
        self._lead = np.zeros(3)
        self.tank = _TANK

    def change(self, goal: ForceGoal) -> None:
        """Continues with another goal in the same frame."""
        self.goal = checked_goal(goal)
        self.axes = np.array(goal.axes)
        self._wanted = np.where(self.axes, goal.force, 0.0)

    def update(self, force: Array, velocity: Array, stiffness: Array, damping: Array, dt: float) -> Array:
        """Returns the lead of the reference along each axis (m); that of an axis that is not selected is 0.

        :param force: measured, that the tool exerts along the axes of the compliance frame (N).
        :param velocity: of the compliance frame along its axes (m/s).
        :param stiffness: along the axes (N/m).
        :param damping: along the axes (Ns/m).
        :param dt: time since the last update (s).
        """
        if not np.isfinite(force).all():
            return np.zeros(3)
        if self._measured is None:
            self._measured = force.copy()
        self._measured += (1.0 - math.exp(-dt / _FORCE_FILTER)) * (force - self._measured)
        error = np.where(self.axes, self._wanted - self._measured, 0.0)
        springs = np.maximum(stiffness, 1.0)
        gain = np.minimum(self.goal.admittance, _STABLE / (springs * dt))
        speed = np.clip(gain * error, -self.goal.speed, self.goal.speed)
        power = np.maximum((springs * self._lead - self._wanted) * speed, 0.0)
        if self.tank <= 0.0:
            speed, power = np.where(power > 0.0, 0.0, speed), np.zeros(3)
        dissipated = float(damping[self.axes] @ velocity[self.axes] ** 2)
        self.tank = min(_TANK, max(0.0, self.tank + (dissipated - float(power.sum())) * dt))
        most = (np.abs(self._wanted) + _MARGIN) / springs
        self._lead = np.clip(np.where(self.axes, self._lead + (speed - velocity) * dt, 0.0), -most, most)
        return np.asarray(np.clip(self._lead + _PROPORTIONAL * error / springs, -most, most))
