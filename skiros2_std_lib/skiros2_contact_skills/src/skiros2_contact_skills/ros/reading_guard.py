"""Why an arm must stop, by the messages of a driver that does not check its sensor itself."""

from __future__ import annotations

from typing import NamedTuple

from skiros2_common.core.errors import ConfigurationError
from skiros2_common.core.failure_kind import FailureKind
from skiros2_contact_skills.ros.profiles import Reading
from skiros2_motion.core.compliant_arm import Wrench, turned_wrench
from skiros2_motion.core.geometry import conjugated
from skiros2_motion.core.wrench_guard import Limits, WrenchGuard, exceeded_limit, is_finite

#: Values of the setting `sensor`: each measurement of a working one differs from that before; or it may be equal.
NOISY, EXACT = "noisy", "exact"
#: Decimal places to which measurements are compared (N, Nm): the conversion between frames rounds.
_PLACES = 6


class Reason(NamedTuple):
    """Why an arm must stop."""

    text: str
    kind: FailureKind


class ReadingGuard:
    """The checks of one arm. Not thread-safe.

    :param topic: of the messages, for the texts.
    :param is_noisy: whether the sensor is noisy.
    :param is_stiff: whether the driver is: it needs a sensor that is found to be frozen.
    :raises ConfigurationError: the driver is stiff, and the sensor is not noisy.
    """

    def __init__(self, topic: str, is_noisy: bool, is_stiff: bool = False) -> None:
        if is_stiff and not is_noisy:
            raise ConfigurationError(f"sensor is {EXACT}: a position controller needs one that is {NOISY}")
        self._topic = topic
        # drivers measure along the axes of the base or of the tool: a frozen wrench is constant along one of them
        self._in_base, self._in_tool = WrenchGuard(is_noisy), WrenchGuard(is_noisy)

    def restart(self) -> None:
        """Forgets earlier measurements."""
        self._in_base.restart()
        self._in_tool.restart()

    def check(self, reading: Reading, zero: Wrench, limits: Limits, time: float) -> Reason | None:
        """Returns why the arm must stop; None if it need not. Without limits only numbers are checked.

        :param zero: of the sensor, along the axes of the tool.
        :param time: by the clock of the arm (s); that of a paused simulation stands still.
        """
        if not is_finite(*reading.pose, reading.wrench):
            return Reason(f"{self._topic} has numbers that are not finite", FailureKind.SENSOR)
        if not any(limits):
            return None
        in_tool = turned_wrench(conjugated(reading.pose.orientation), reading.wrench)
        if exceeded := exceeded_limit([a - b for a, b in zip(in_tool, zero, strict=True)], limits):
            return Reason(str(exceeded), FailureKind.LIMIT)
        for guard, wrench in ((self._in_base, reading.wrench), (self._in_tool, in_tool)):
            if frozen := guard.frozen([round(value, _PLACES) for value in wrench], time):
                return Reason(f"{self._topic}: {frozen}", FailureKind.SENSOR)
        return None
