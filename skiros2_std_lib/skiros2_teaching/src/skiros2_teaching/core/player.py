"""Plays motions of the tool and gripper events, one after the other, on a compliant arm."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from skiros2_motion.core.arm_kinematics import distances
from skiros2_motion.core.compliant_arm import ArmState, CompliantArm
from skiros2_motion.core.gripper import Gripper, GripperEvent
from skiros2_motion.core.time_scaling import MAX_PERIOD
from skiros2_teaching.core.timed_motion import TimedMotion

#: Progress codes of failures: the tool does not follow its reference, does not arrive, the gripper fails.
BLOCKED, NOT_REACHED, GRIPPER_FAILED = -130, -131, -132

#: Distance between tool and reference at which the tool counts as blocked (m, rad).
_MAX_LAG, _MAX_TURN_LAG = 0.05, 0.4
#: Times after the end of a motion at which the tool counts as at rest, and by which it must have arrived (s).
_RESTING, _SETTLING = 0.3, 2.0
#: Time in which a gripper has to end a command (s).
_GRIPPING = 15.0


class Failure(NamedTuple):
    """Why a player has ended early: text and progress code."""

    text: str
    code: int


class Player:
    """A player. It starts at its first update.

    :param gripper: for the events; None: they are refused.
    :param tolerance: distance from the last pose at the end (m).
    :param angular_tolerance: rad.
    """

    def __init__(
        self,
        arm: CompliantArm,
        gripper: Gripper | None,
        parts: Sequence[TimedMotion | GripperEvent],
        tolerance: float = 0.003,
        angular_tolerance: float = 0.03,
    ) -> None:
        self._arm, self._gripper = arm, gripper
        self._parts = list(parts)
        self._tolerances = tolerance, angular_tolerance
        self._index = 0
        self._began: float | None = None
        self._updated = 0.0
        self._gripping_since: float | None = None
        self.duration = sum(part.duration for part in self._parts if not isinstance(part, GripperEvent))
        self._done = 0.0
        self.failure: Failure | None = None
        #: Distance (m) and angle (rad) between the tool and its reference at the last update.
        self.lag = (0.0, 0.0)

    @property
    def has_ended(self) -> bool:
        """Whether all parts were played; False after a failure."""
        return self._index == len(self._parts)

    @property
    def progress(self) -> float:
        """Played fraction of the time of all motions."""
        return min(1.0, self._done / self.duration) if self.duration > 0.0 else 1.0

    def update(self, state: ArmState) -> None:
        """Sets the next reference, or advances the gripper. To be called at each tick until the player has ended."""
        now = self._arm.now()
        if self._began is None:
            self._began = self._updated = now
        self._began += max(0.0, now - self._updated - MAX_PERIOD)
        self._updated = now
        while not self.has_ended and self.failure is None:
            part = self._parts[self._index]
            if isinstance(part, GripperEvent):
                if not self._grip(part, now):
                    return
                self._began = now
            else:
                if not self._follow(part, state, now):
                    return
                self._done += part.duration
            self._index += 1

    def _follow(self, part: TimedMotion, state: ArmState, now: float) -> bool:
        """Returns whether the motion has ended. The next one starts when the time of this one is over."""
        assert self._began is not None
        passed = now - self._began
        reference = part.pose(passed)
        self._arm.set_reference(reference)
        self.lag = distances(state.pose, reference)
        if self.lag[0] > _MAX_LAG or self.lag[1] > _MAX_TURN_LAG:
            most = _text((_MAX_LAG, _MAX_TURN_LAG))
            self.failure = Failure(f"the tool is {_text(self.lag)} from its reference: expected up to {most}", BLOCKED)
            return False
        if passed < part.duration:
            return False
        following = self._parts[self._index + 1] if self._index + 1 < len(self._parts) else None
        if following is not None and not isinstance(following, GripperEvent):
            self._began += part.duration
            return True
        if self.lag[0] <= self._tolerances[0] and self.lag[1] <= self._tolerances[1]:
            return passed > part.duration + _RESTING
        if passed > part.duration + _SETTLING:
            text = f"the tool is {_text(self.lag)} from its goal: expected up to {_text(self._tolerances)}"
            self.failure = Failure(text, NOT_REACHED)
        return False

    def _grip(self, event: GripperEvent, now: float) -> bool:
        """Returns whether the gripper has executed an event."""
        if self._gripper is None:
            self.failure = Failure("the path has gripper events, but the arm has no gripper", GRIPPER_FAILED)
            return False
        if self._gripping_since is None:
            self._gripping_since = now
            self._gripper.command(event.width, event.effort)
            return False
        result = self._gripper.result()
        if result is None and now - self._gripping_since > _GRIPPING:
            result = f"it has not answered for {_GRIPPING:g} s"
        if result is None:
            return False
        self._gripping_since = None
        if result:
            self.failure = Failure(f"the gripper failed to move to {event.width:g} m: {result}", GRIPPER_FAILED)
        return not result


def _text(distance: tuple[float, float]) -> str:
    return f"{1000.0 * distance[0]:.1f} mm and {distance[1]:.3f} rad"
