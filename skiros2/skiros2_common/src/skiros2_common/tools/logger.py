"""The logging functions that skill libraries call, on top of Python's `logging`.

Each takes a short origin and a text, or a text alone. In a ROS node the records reach rosout.
"""

from __future__ import annotations

import logging
from typing import Any

ALWAYS, OK, TRACE = 60, 22, 5
ERROR, WARN, INFO, DEBUG = logging.ERROR, logging.WARNING, logging.INFO, logging.DEBUG

for _number, _name in ((ALWAYS, "ALWAYS"), (OK, "OK"), (TRACE, "TRACE")):
    logging.addLevelName(_number, _name)

_logger = logging.getLogger("skiros2")


class logColor:
    """ANSI colours."""

    RED = "\033[91m"
    GREEN = "\033[92m"
    YELLOW = "\033[93m"
    BLUE = "\033[94m"
    BOLD = "\033[1m"
    UNDERLINE = "\033[4m"
    ENDC = "\033[0m"


def setLevel(mode: int) -> None:
    """Records below this level are dropped."""
    _logger.setLevel(int(mode))


def getLevel() -> int:
    return _logger.getEffectiveLevel()


def _log(level: int, msg: Any, desc: Any) -> None:
    if desc is None:
        _logger.log(level, "%s", msg)
    else:
        _logger.log(level, "%s: %s", msg, desc)


def always(msg: Any, desc: Any = None) -> None:
    _log(ALWAYS, msg, desc)


def error(msg: Any, desc: Any = None) -> None:
    _log(ERROR, msg, desc)


def warn(msg: Any, desc: Any = None) -> None:
    _log(WARN, msg, desc)


def ok(msg: Any, desc: Any = None) -> None:
    _log(OK, msg, desc)


def info(msg: Any, desc: Any = None) -> None:
    _log(INFO, msg, desc)


def debug(msg: Any, desc: Any = None) -> None:
    _log(DEBUG, msg, desc)


def trace(msg: Any, desc: Any = None) -> None:
    _log(TRACE, msg, desc)


def assertError(cond: Any, msg: Any, desc: Any = None) -> None:
    """Logs an error when `cond` holds."""
    if cond:
        error(msg, desc)


def assertWarn(cond: Any, msg: Any, desc: Any = None) -> None:
    """Logs a warning when `cond` holds."""
    if cond:
        warn(msg, desc)


def assertOk(cond: Any, msg: Any, desc: Any = None) -> None:
    """Logs good news when `cond` holds."""
    if cond:
        ok(msg, desc)


def assertInfo(cond: Any, msg: Any, desc: Any = None) -> None:
    """Logs an information when `cond` holds."""
    if cond:
        info(msg, desc)
