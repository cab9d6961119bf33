"""Opens and closes a gripper, as a driver of control_msgs/GripperCommand does."""

from __future__ import annotations

import math

from skiros2_sim.core.gripper import Gripper
from skiros2_sim.core.motion import Outcome, State

#: Tolerance of the width (m).
_NEAR = 0.001
#: The fingers are at rest if they move less than this (m) within that time (s); timeout of a motion (s).
_STANDS, _STOOD, _MAX_DURATION = 0.0002, 0.15, 10.0


class GripperMotion:
    """A motion to a finger distance with a maximum force. It succeeds at the target, or when an object stops the
    fingers. Afterwards the fingers keep pressing: they hold the object, and close further if it slips out."""

    def __init__(self, gripper: Gripper, width: float, effort: float = 0.0) -> None:
        """Starts the motion: `width` in m, `effort` in N; 0 for the maximum."""
        self.outcome: Outcome | None = None
        self.stalled = False
        self.reached_goal = False
        self._gripper = gripper
        self._width = width
        self._stood_since = self._spent = 0.0
        self._stood_at = gripper.width()
        rejection = _rejection(gripper, width, effort)
        if rejection:
            self.outcome = Outcome(State.REJECTED, rejection)
            return
        gripper.drive(width, effort)

    @property
    def width(self) -> float:
        """Current distance between the fingers (m)."""
        return self._gripper.width()

    @property
    def effort(self) -> float:
        """Current motor force (N)."""
        return self._gripper.force()

    def update(self, dt: float) -> None:
        """Advances by `dt` seconds."""
        if self.outcome is not None:
            return
        self._spent += dt
        width = self.width
        if abs(width - self._stood_at) > _STANDS:
            self._stood_at, self._stood_since = width, self._spent
        if self._spent - self._stood_since >= _STOOD:
            self.reached_goal = abs(width - self._width) <= _NEAR
            self.stalled = not self.reached_goal
            what = f"an object holds the fingers {width:.4f} m apart" if self.stalled else ""
            self.outcome = Outcome(State.SUCCEEDED, what)
        elif self._spent > _MAX_DURATION:
            self.outcome = Outcome(State.ABORTED, f"the fingers do not come to rest; they are {width:.4f} m apart")

    def cancel(self) -> None:
        """Stops the fingers; a gripper that holds an object keeps holding it."""
        if self.outcome is None:
            if abs(self.width - self._stood_at) > _STANDS or self.effort == 0.0:
                self._gripper.drive(self.width)
            self.outcome = Outcome(State.PREEMPTED, "cancelled")


def _rejection(gripper: Gripper, width: float, effort: float) -> str:
    """Returns why a command is invalid; "" if it is valid."""
    if not gripper.joints:
        return f"gripper {gripper.name} has no fingers in its model"
    if not math.isfinite(width) or not gripper.min_width - _NEAR <= width <= gripper.max_width + _NEAR:
        return f"width {width} m: gripper {gripper.name} opens from {gripper.min_width:g} to {gripper.max_width:g} m"
    if not math.isfinite(effort) or effort < 0.0:
        return f"effort {effort} N: expected a number, 0 or more"
    return ""
