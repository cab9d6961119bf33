"""Connecting to a node that may start later, or end while it is connected to."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from typing import TypeVar

log = logging.getLogger(__name__)

T = TypeVar("T")


def connect(attempt: Callable[[], T], closed: threading.Event, pause: float = 1.0) -> T | None:
    """Attempts to connect until that succeeds. Returns the connection, or None once `closed` is set. Blocks.

    :param attempt: connects; whatever it raises is logged, and the next attempt follows after `pause` (s).
    """
    while not closed.is_set():
        try:
            return attempt()
        except Exception as error:
            if not closed.is_set():
                log.warning("not connected, the next attempt follows in %g s: %s", pause, error)
        closed.wait(pause)
    return None
