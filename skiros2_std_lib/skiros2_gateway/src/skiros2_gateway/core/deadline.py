"""The deadline of a request: what a client was told has failed is not done afterwards.

Deadlines are times of this machine's monotonic clock (s), which the live view's beats carry to the page.
"""

from __future__ import annotations

import math
import time
from contextvars import ContextVar

from skiros2_common.core.errors import TimedOut, WrongValue

_deadline: ContextVar[float] = ContextVar("deadline", default=math.inf)


def read_deadline(text: str) -> float:
    """Returns a deadline that a client sends.

    :raises WrongValue: it is not a number.
    """
    try:
        found = float(text)
    except ValueError:
        found = math.nan
    if math.isnan(found):
        raise WrongValue(f"the deadline {text[:40]!r} is not a number, expected s of the gateway's monotonic clock")
    return found


def set_deadline(deadline: float) -> None:
    """Sets the deadline of the current request."""
    _deadline.set(deadline)


def remaining() -> float:
    """Returns the time (s) until the deadline of the current request; infinite without one."""
    return _deadline.get() - time.monotonic()


def check_deadline() -> None:
    """
    :raises TimedOut: the deadline of the current request has passed.
    """
    if not remaining() >= 0.0:
        raise TimedOut(f"the request was {-remaining():.2f} s late; nothing was done")
