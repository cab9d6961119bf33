"""Opening and closing a gripper: what a driver's control_msgs/GripperCommand does."""

from __future__ import annotations

import math

from skiros2_sim.core.gripper import Gripper
from skiros2_sim.core.motion import Outcome, State
from skiros2_sim.core.world import World

#: How near to the width counts as there (m).
_NEAR = 0.001
#: The fingers stand when they have moved less than this (m) in that time (s); longer than this they never move (s).
_STANDS, _STOOD, _LONGEST = 0.0002, 0.15, 10.0


class GripperMotion:
    """A motion to a width between the fingers, with so much force at most. It ends there, or where something between
    the fingers keeps them apart: both are success. The fingers go on pressing afterwards, so what they hold they keep,
    and when they lose it they close farther."""

    def __init__(self, world: World, gripper: Gripper, width: float, effort: float = 0.0) -> None:
        """`width` in m; `effort` in N, 0 or more than it has: all it has."""
        self.outcome: Outcome | None = None
        self.stalled = False
        self.reached_goal = False
        self._gripper = gripper
        self._width = width
        self._stood_since = self._spent = 0.0
        self._stood_at = gripper.width()
        refusal = _refusal(gripper, width, effort)
        if refusal:
            self.outcome = Outcome(State.REJECTED, refusal)
            return
        gripper.drive(width, effort)

    @property
    def width(self) -> float:
        """Between the fingers now (m)."""
        return self._gripper.width()

    @property
    def effort(self) -> float:
        """With which they press (N)."""
        return self._gripper.force()

    def update(self, dt: float) -> None:
        """Goes on by `dt` seconds."""
        if self.outcome is not None:
            return
        self._spent += dt
        width = self.width
        if abs(width - self._stood_at) > _STANDS:
            self._stood_at, self._stood_since = width, self._spent
        if self._spent - self._stood_since >= _STOOD:
            self.reached_goal = abs(width - self._width) <= _NEAR
            self.stalled = not self.reached_goal
            what = f"something keeps the fingers {width:.4f} m apart" if self.stalled else ""
            self.outcome = Outcome(State.SUCCEEDED, what)
        elif self._spent > _LONGEST:
            self.outcome = Outcome(State.ABORTED, f"the fingers do not come to rest, they are {width:.4f} m apart")

    def cancel(self) -> None:
        """The fingers stay as they are; those that hold something go on holding it."""
        if self.outcome is None:
            if abs(self.width - self._stood_at) > _STANDS or self.effort == 0.0:
                self._gripper.drive(self.width)
            self.outcome = Outcome(State.PREEMPTED, "cancelled")


def _refusal(gripper: Gripper, width: float, effort: float) -> str:
    """Why the command cannot be; "" when it can."""
    if not gripper.joints:
        return f"gripper {gripper.name} has no fingers in its model"
    if not math.isfinite(width) or not gripper.min_width - _NEAR <= width <= gripper.max_width + _NEAR:
        return f"width {width} m: gripper {gripper.name} opens from {gripper.min_width:g} to {gripper.max_width:g} m"
    if not math.isfinite(effort) or effort < 0.0:
        return f"effort {effort} N: expected a number, 0 or more"
    return ""
