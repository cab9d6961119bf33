"""The logging functions that skill libraries call, on top of Python's `logging`.

Each takes a short source name and a text, or only a text. Messages go to stdout, coloured by level, and in a ROS node
also to rosout. `Log` keeps the last messages. Its methods are functions of this module too.
"""

from __future__ import annotations

import functools
import logging
import re
import sys
from collections import Counter, deque
from collections.abc import Callable
from enum import IntEnum
from pathlib import Path
from typing import Any, TypeVar

_T = TypeVar("_T")


class logMode(IntEnum):
    """The levels; messages up to the set level are shown."""

    ALWAYS = -1
    ERROR = 0
    WARN = 1
    OK = 2
    INFO = 3
    DEBUG = 4
    TRACE = 5


ALWAYS, ERROR, WARN, OK, INFO, DEBUG, TRACE = logMode


class logColor:
    """ANSI colours."""

    RED = "\033[91m"
    GREEN = "\033[92m"
    YELLOW = "\033[93m"
    BLUE = "\033[94m"
    MAGENTA = "\033[95m"
    BOLD = "\033[1m"
    UNDERLINE = "\033[4m"
    ENDC = "\033[0m"


#: The level of Python's `logging` and the colour of each mode.
_NUMBERS = {ALWAYS: 60, ERROR: 40, WARN: 30, OK: 22, INFO: 20, DEBUG: 10, TRACE: 5}
_COLOURS = {
    _NUMBERS[ALWAYS]: logColor.BOLD,
    _NUMBERS[ERROR]: logColor.RED,
    _NUMBERS[WARN]: logColor.YELLOW,
    _NUMBERS[OK]: logColor.GREEN,
    _NUMBERS[DEBUG]: logColor.BLUE,
    _NUMBERS[TRACE]: logColor.MAGENTA,
}
for _mode in (ALWAYS, OK, TRACE):
    logging.addLevelName(_NUMBERS[_mode], _mode.name)

#: The width of the source name in a line.
_NAME_WIDTH = 20
#: The number of messages that a `Log` keeps.
_MAX_MESSAGES = 1000
#: The levels of rosout; others are mapped to the next lower one.
_ROSOUT_LEVELS = (logging.CRITICAL, logging.ERROR, logging.WARNING, logging.INFO, logging.DEBUG)
#: The methods of `Log` for one level.
_OF_LEVEL = re.compile(r"(msg|count|has)(Always|Error|Warn|Ok|Info|Debug|Trace)(Msg)?")


def rosout_record(record: logging.LogRecord) -> logging.LogRecord:
    """A copy of a record for the handlers of `rosout`, with one of its levels."""
    number = logging.INFO if record.levelno == _NUMBERS[ALWAYS] else record.levelno  # ALWAYS is not an error
    level = next((known for known in _ROSOUT_LEVELS if number >= known), logging.DEBUG)
    changes = {"name": "rosout", "levelno": level, "levelname": logging.getLevelName(level)}
    text = {"msg": logging.Formatter().format(record), "args": (), "exc_info": None, "exc_text": None}
    return logging.makeLogRecord({**record.__dict__, **changes, **text})


class _OutputHandler(logging.Handler):
    """Writes records to stdout and, in a ROS node, to the handlers of `rosout` except the screen."""

    is_on = True
    has_colours = True

    def emit(self, record: logging.LogRecord) -> None:
        record.is_shown = True  # so that `RosoutHandler` skips it
        if not self.is_on:
            return
        colour = _COLOURS.get(record.levelno, "") if self.has_colours else ""
        text = self.format(record)
        try:
            sys.stdout.write(f"{colour}{text}{logColor.ENDC}\n" if colour else f"{text}\n")
            sys.stdout.flush()
        except (OSError, ValueError):
            self.handleError(record)
        rospy = sys.modules.get("rospy")  # without rospy there is no node
        if rospy is not None and rospy.core.is_initialized():
            for handler in logging.getLogger("rosout").handlers:
                if not type(handler).__name__.endswith("StreamHandler"):
                    handler.handle(rosout_record(record))


_output = _OutputHandler()


def _logging_method(mode: logMode) -> Callable[..., None]:
    def log(self: Log, msg: Any, desc: Any = None) -> None:
        self.log(mode, msg, desc)

    return log


class Log:
    """Logs messages and keeps the last ones.

    `msgError`, `countErrorMsg` and `hasError` are the errors logged since `clear`, their number and whether there are
    any; each other level has the same three methods.

    :param name: of the Python logger.
    """

    def __init__(self, name: str = "skiros2") -> None:
        self._logger = logging.getLogger(name)
        if _output not in self._logger.handlers:
            self._logger.addHandler(_output)
            self._logger.setLevel(_NUMBERS[TRACE])
        self._messages: deque[tuple[logMode, str]] = deque(maxlen=_MAX_MESSAGES)
        self._counts: Counter[logMode] = Counter()
        self._indent = 0

    def __getattr__(self, name: str) -> Any:
        found = _OF_LEVEL.fullmatch(name)
        if found is None or (found[1] == "count") != bool(found[3]):
            raise AttributeError(name)
        mode = logMode[found[2].upper()]
        if found[1] == "msg":
            return functools.partial(self.messages, mode)
        return functools.partial(self.count if found[1] == "count" else self._has, mode)

    def log(self, mode: int, msg: Any, desc: Any = None) -> None:
        """Logs a message, unless its level is above the set one."""
        mode = logMode(mode)
        if not self._logger.isEnabledFor(_NUMBERS[mode]):
            return
        text = "  " * self._indent + (str(msg) if desc is None else f"{msg!s:<{_NAME_WIDTH}} {desc}")
        self._messages.append((mode, text))
        self._counts[mode] += 1
        self._logger.log(_NUMBERS[mode], "%s", text, stacklevel=3)

    always, error, warn, ok, info, debug, trace = map(_logging_method, logMode)

    def assertError(self, cond: _T, msg: Any, desc: Any = None) -> _T:
        """Logs an error if `cond` is false. Returns `cond`."""
        if not cond:
            self.log(ERROR, msg, desc)
        return cond

    def assertWarn(self, cond: _T, msg: Any, desc: Any = None) -> _T:
        """Logs a warning if `cond` is false. Returns `cond`."""
        if not cond:
            self.log(WARN, msg, desc)
        return cond

    def assertOk(self, cond: Any, msg: Any, desc: Any = None) -> bool:
        """Logs a message of level OK if `cond` is true. Returns `not cond`."""
        if cond:
            self.log(OK, msg, desc)
        return not cond

    def assertInfo(self, cond: Any, msg: Any, desc: Any = None) -> bool:
        """Logs a message of level INFO if `cond` is true. Returns `not cond`."""
        if cond:
            self.log(INFO, msg, desc)
        return not cond

    # -- output -----------------------------------------------------------------------------------------------

    def setLevel(self, mode: int) -> None:
        """Discards messages above this level."""
        self._logger.setLevel(_NUMBERS[logMode(mode)])

    def getLevel(self) -> logMode:
        """The highest level shown."""
        return max((mode for mode in logMode if self._logger.isEnabledFor(_NUMBERS[mode])), default=ALWAYS)

    def useColor(self, state: bool = True) -> None:
        """Whether lines are coloured by their level."""
        _output.has_colours = state

    def enableOutput(self) -> None:
        """Shows messages (the default)."""
        _output.is_on = True

    def disableOutput(self) -> None:
        """Keeps messages without showing them."""
        _output.is_on = False

    def indent(self) -> None:
        """Increases the indentation of further lines."""
        self._indent += 1

    def unindent(self) -> None:
        """Decreases the indentation of further lines."""
        self._indent = max(0, self._indent - 1)

    # -- past messages -----------------------------------------------------------------------------------------

    def messages(self, mode: int) -> list[str]:
        """The last messages of a level."""
        return [text for known, text in self._messages if known == mode]

    def count(self, mode: int) -> int:
        """The number of messages of a level since `clear`."""
        return self._counts[logMode(mode)]

    def _has(self, mode: int) -> bool:
        return self.count(mode) > 0

    def lastError(self) -> str:
        """The last error, or ""."""
        return next(iter(reversed(self.messages(ERROR))), "")

    def lastWarn(self) -> str:
        """The last warning, or ""."""
        return next(iter(reversed(self.messages(WARN))), "")

    def testError(self) -> bool:
        """Whether an error was logged since `clear`."""
        return self._has(ERROR)

    def testWarn(self) -> bool:
        """Whether a warning was logged since `clear`."""
        return self._has(WARN)

    def toString(self) -> str:
        """The last messages, a line each."""
        return "\n".join(f"[{mode.name}] {text}" for mode, text in self._messages)

    def dump(self, filename: str) -> None:
        """Writes the last messages to a file, a line each."""
        Path(filename).write_text(self.toString() + "\n")

    def clear(self) -> None:
        """Deletes all messages."""
        self._messages.clear()
        self._counts.clear()

    def reset(self) -> None:
        """Deletes all messages and resets all settings."""
        self.clear()
        self._indent = 0
        self.setLevel(TRACE)
        self.useColor()
        self.enableOutput()


_log = Log()

always, error, warn, ok = _log.always, _log.error, _log.warn, _log.ok
info, debug, trace = _log.info, _log.debug, _log.trace
assertError, assertWarn, assertOk, assertInfo = _log.assertError, _log.assertWarn, _log.assertOk, _log.assertInfo
setLevel, getLevel = _log.setLevel, _log.getLevel


def __getattr__(name: str) -> Any:
    return getattr(_log, name)
