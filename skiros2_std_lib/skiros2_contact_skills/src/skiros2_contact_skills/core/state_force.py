"""Regulates forces at the states of a driver that does not, in its adapter."""

from __future__ import annotations

import logging
import math
from collections import deque
from collections.abc import Sequence
from contextlib import AbstractContextManager
from typing import Any

from skiros2_contact_skills.core.tick_force import TickForce
from skiros2_motion.core.compliant_arm import ArmState
from skiros2_motion.core.force_control import ForceGoal, checked_goal
from skiros2_motion.core.geometry import Pose
from skiros2_motion.core.regions import Region

log = logging.getLogger(__name__)

#: Maximum rate of the loop (Hz): beyond it, the filters of drivers and the transport are slower.
MAX_RATE = 200.0
#: Time of the arm's clock without `refresh` after which the regulation ends (s): nobody commands it any more.
TIMEOUT = 1.0
#: Maximum number of states that are kept for `take_states`: two seconds of a driver with 1 kHz.
_KEPT = 2000


class StateForce:
    """The loop of one arm. Not thread-safe.

    :param most: maximum rate (Hz); that of a driver that takes references more slowly than it measures.
    :ivar sent: the last reference of the loop, also after it has ended by itself; None before the first one.
    """

    def __init__(self, most: float = MAX_RATE) -> None:
        self._most = most
        self._goal: ForceGoal | None = None
        self._loop: TickForce | None = None
        self._at = self._refreshed = -math.inf
        self.sent: Pose | None = None
        self._peak = 0.0
        #: States since they were last taken.
        self.recent: deque[ArmState] = deque(maxlen=_KEPT)

    def rate(self, period: float) -> float:
        """Returns the rate of the loop (Hz).

        :param period: time between states (s); 0 if it is not known.
        """
        return min(self._most, 1.0 / period) if period > 0.0 else self._most

    @property
    def is_active(self) -> bool:
        """Whether a force is regulated."""
        return self._loop is not None

    def set_goal(self, goal: ForceGoal | None) -> None:
        """Starts, changes or ends the regulation.

        :raises WrongValue: a number is not finite or out of range.
        """
        if goal is not None and self._loop is not None and self._goal is not None and goal.tip == self._goal.tip:
            self._loop.change(goal)
        else:
            self._loop = None if goal is None else TickForce(checked_goal(goal))
            self._at = self._refreshed = -math.inf
            self.sent = None
        self._goal = goal

    def refresh(self) -> None:
        """A reference was commanded."""
        self._refreshed = self._at
        if self._loop is None:
            self.sent = None

    def note(self, peak: float) -> None:
        """A force was measured (N)."""
        self._peak = max(self._peak, peak)

    def take_peak(self) -> float:
        """Returns the largest measured force since the last call (N)."""
        peak, self._peak = self._peak, 0.0
        return peak

    def update(self, state: ArmState, wanted: Pose | None, stiffness: Sequence[float]) -> Pose | None:
        """Returns the reference of the tool that regulates the force, or at which the arm stays when nobody commands it
        any more; None while nothing is due.

        :param wanted: reference of the tool along the axes that are not regulated, in the base frame; None: the pose of
            the tool.
        :param stiffness: along the axes of the tool (N/m).
        """
        self.note(math.hypot(*state.wrench[:3]))
        self.recent.append(state)
        passed = state.stamp - self._at
        if self._loop is None or 0.0 <= passed < 0.9 / self._most:
            return None
        self._at = state.stamp
        if self._refreshed == -math.inf or passed < 0.0:  # the first state, or a clock that was set
            self._refreshed = self._at
        if self._at - self._refreshed > TIMEOUT:
            log.warning("no reference for %g s: force control has ended, the arm holds its pose", TIMEOUT)
            self.set_goal(None)
            self.sent = state.pose
        else:
            dt = passed if 0.0 < passed < 1.0 else 0.0
            self.sent = self._loop.reference(state, wanted or state.pose, stiffness, dt)
        return self.sent


class ForceAdapter:
    """Base of adapters: the states and the largest force between two ticks, and regions.

    :ivar regions: that the reference keeps the tool out of.
    """

    _force: StateForce
    _lock: AbstractContextManager[Any]
    regions: Sequence[Region] = ()

    def set_regions(self, regions: Sequence[Region]) -> None:
        self.regions = tuple(regions)

    def take_peak(self) -> float:
        with self._lock:
            return self._force.take_peak()

    def take_states(self) -> list[ArmState]:
        with self._lock:
            states = list(self._force.recent)
            self._force.recent.clear()
        return states
