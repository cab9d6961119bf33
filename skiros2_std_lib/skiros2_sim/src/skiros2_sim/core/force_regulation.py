"""The force of a simulated arm, regulated in the frame of a held part at the rate of the compliant controller."""

from __future__ import annotations

import logging
import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from skiros2_motion.core.force_control import ForceControl, ForceGoal
from skiros2_motion.core.geometry import IDENTITY, Pose, composed, inverted
from skiros2_motion.core.impedance import ArmState, Impedance, rotation_matrix

log = logging.getLogger(__name__)

Array = npt.NDArray[np.float64]


class ForceRegulation:
    """Couples the loop to the law: the law controls the compliance frame in place of the tool, and the loop sets the
    lead of its reference.

    :ivar frame: the controlled frame in the tool frame.
    """

    def __init__(self, impedance: Impedance) -> None:
        self._impedance = impedance
        self._loop: ForceControl | None = None
        self.frame = IDENTITY
        #: Time until the goal expires (s), and that time after each reference.
        self._left = self._timeout = math.inf

    def set_goal(self, goal: ForceGoal | None, timeout: float = math.inf) -> None:
        """Starts, changes or ends the regulation. The reference of the tool stays.

        :param timeout: time (s) without a reference after which it ends.
        :raises WrongValue: a number is not finite or out of range.
        """
        if goal is None:
            self._loop, self._impedance.leads = None, None
        elif self._loop is not None and goal.frame == self.frame:
            self._loop.change(goal)
        else:
            self._loop = ForceControl(goal)
        self._left = self._timeout = timeout
        frame = IDENTITY if goal is None else goal.frame
        if frame != self.frame:
            tool = composed(self._impedance.reference, inverted(self.frame))
            self.frame = frame
            self._impedance.set_reference(self.controlled(tool), filtered=False)

    @property
    def is_active(self) -> bool:
        """Whether a force is regulated."""
        return self._loop is not None

    def controlled(self, tool: Pose) -> Pose:
        """Returns the pose of the controlled frame at a pose of the tool."""
        return tool if self.frame == IDENTITY else composed(tool, self.frame)

    def commanded(self, tool: Pose) -> Pose:
        """Returns the reference of the controlled frame, by that of the tool, which is commanded now."""
        self._left = self._timeout
        return self.controlled(tool)

    def state(self, state: ArmState, dt: float) -> ArmState:
        """Returns the state of the controlled frame, from that of the tool. Ends a goal that has expired.

        :param dt: time since the last update (s).
        """
        self._left -= dt
        if self._left <= 0.0:
            log.warning("no reference for %g s: force control has ended, the arm holds its pose", self._timeout)
            self.set_goal(None)
            self._impedance.set_reference(state.tool)
        if self.frame == IDENTITY:
            return state
        x, y, z = rotation_matrix(state.tool.orientation) @ np.array(self.frame.position)
        jacobian = state.jacobian.copy()
        jacobian[:3] -= np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]]) @ jacobian[3:]
        return state._replace(tool=self.controlled(state.tool), jacobian=jacobian)

    def update(self, state: ArmState, wrench: Sequence[float], dt: float) -> None:
        """Sets the leads of the law.

        :param state: of the controlled frame.
        :param wrench: measured at the hand, in the tool frame (N, Nm).
        """
        assert self._loop is not None, "no force is regulated"
        stiffness = self._impedance.stiffness[:3]
        damping = 2.0 * np.array(self._impedance.damping_factors[:3]) * np.sqrt(stiffness)
        force = -np.array(wrench[:3])  # the axes of the frame are those of the tool
        velocity = rotation_matrix(state.tool.orientation).T @ (state.jacobian[:3] @ state.velocities)
        leads = self._loop.update(force, velocity, stiffness, damping, dt)
        self._impedance.leads = np.where(self._loop.axes, leads, np.nan)
