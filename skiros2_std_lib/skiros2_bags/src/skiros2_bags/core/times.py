"""Parses and formats times of a bag."""

from __future__ import annotations

import math
import time

from skiros2_bags.core.run import Run
from skiros2_common.core.errors import WrongValue

#: Numbers from here on are s since the epoch (1973); smaller numbers are s since the start of the bag.
_ABSOLUTE = 1e8

_CLOCK = ("%H:%M:%S", "%H:%M")
_DATE = ("%Y-%m-%d %H:%M:%S", "%Y-%m-%dT%H:%M:%S")


def parse_time(text: str, run: Run) -> float:
    """Returns the time that a text denotes (s since the epoch).

    `12.5` is 12.5 s after the start of the bag, `-3` is 3 s before its end, `1795233085.4` is s since the epoch,
    `14:05:30` is the local time on the day of the bag, `2026-11-21 14:05:30` includes the date.

    :raises WrongValue: the text has none of these forms.
    """
    text = text.strip()
    try:
        number = float(text)
    except ValueError:
        return _from_clock(text, run)
    if not math.isfinite(number):
        raise WrongValue(f"{text!r} is no time")
    if number >= _ABSOLUTE:
        return number
    return run.end + number if text.startswith("-") else run.start + number


def _from_clock(text: str, run: Run) -> float:
    day = time.strftime("%Y-%m-%d ", time.localtime(run.start))
    for candidate, patterns in ((text, _DATE), (day + text, tuple(f"%Y-%m-%d {pattern}" for pattern in _CLOCK))):
        for pattern in patterns:
            try:
                return time.mktime(time.strptime(candidate, pattern))
            except (ValueError, OverflowError):
                continue
    raise WrongValue(
        f"{text!r} is no time: expected s after the start (12.5), before the end (-3) or since the epoch, 14:05:30, "
        "or '2026-11-21 14:05:30'"
    )


def relative_time(at: float, run: Run) -> str:
    """Formats a time as s after the start of the bag."""
    return f"{at - run.start:.2f}"


def local_time(at: float) -> str:
    """Formats a time as local date and time."""
    return time.strftime("%Y-%m-%d %H:%M:%S", time.localtime(at))
