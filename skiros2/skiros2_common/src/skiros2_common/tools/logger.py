"""The logging functions that skill libraries call, on top of Python's `logging`.

Each takes a short source name and a text, or only a text. Messages go to stdout, coloured by level, and in a ROS node
also to rosout. `Log` keeps the last messages for `has*`, `count*Msg` and `msg*`.
"""

from __future__ import annotations

import logging
import sys
from collections import Counter, deque
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


#: The levels of Python's `logging` for the modes.
_NUMBERS = {
    ALWAYS: 60,
    ERROR: logging.ERROR,
    WARN: logging.WARNING,
    OK: 22,
    INFO: logging.INFO,
    DEBUG: logging.DEBUG,
    TRACE: 5,
}
_COLOURS = {
    _NUMBERS[ALWAYS]: logColor.BOLD,
    _NUMBERS[ERROR]: logColor.RED,
    _NUMBERS[WARN]: logColor.YELLOW,
    _NUMBERS[OK]: logColor.GREEN,
    _NUMBERS[INFO]: "",
    _NUMBERS[DEBUG]: logColor.BLUE,
    _NUMBERS[TRACE]: logColor.MAGENTA,
}
for _mode in (ALWAYS, OK, TRACE):
    logging.addLevelName(_NUMBERS[_mode], _mode.name)

#: The width of the source name in a line.
_NAME_WIDTH = 20
#: The number of messages that a `Log` keeps.
_MAX_MESSAGES = 1000
#: The levels of rosout.
_ROSOUT = (logging.CRITICAL, logging.ERROR, logging.WARNING, logging.INFO, logging.DEBUG)


class _OutputHandler(logging.Handler):
    """Writes records to stdout and, in a ROS node, to the handlers of `rosout` except the screen."""

    def __init__(self) -> None:
        super().__init__()
        self.is_on = True
        self.has_colours = True

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
        _to_rosout(record)


def _to_rosout(record: logging.LogRecord) -> None:
    rospy = sys.modules.get("rospy")  # without rospy there is no node
    if rospy is None or not rospy.core.is_initialized():
        return
    number = logging.INFO if record.levelno == _NUMBERS[ALWAYS] else record.levelno
    level = next((known for known in _ROSOUT if number >= known), logging.DEBUG)
    overrides = {"name": "rosout", "levelno": level, "levelname": logging.getLevelName(level)}
    copy = logging.makeLogRecord({**record.__dict__, **overrides})
    for handler in logging.getLogger("rosout").handlers:
        if not type(handler).__name__.endswith("StreamHandler"):
            handler.handle(copy)


_output = _OutputHandler()


class Log:
    """Logs messages and keeps the last ones.

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

    def log(self, mode: int, msg: Any, desc: Any = None) -> None:
        """Logs a message, unless its level is above the set one."""
        mode = logMode(mode)
        if not self._logger.isEnabledFor(_NUMBERS[mode]):
            return
        text = "  " * self._indent + (str(msg) if desc is None else f"{msg!s:<{_NAME_WIDTH}} {desc}")
        self._messages.append((mode, text))
        self._counts[mode] += 1
        self._logger.log(_NUMBERS[mode], "%s", text, stacklevel=3)

    def always(self, msg: Any, desc: Any = None) -> None:
        self.log(ALWAYS, msg, desc)

    def error(self, msg: Any, desc: Any = None) -> None:
        self.log(ERROR, msg, desc)

    def warn(self, msg: Any, desc: Any = None) -> None:
        self.log(WARN, msg, desc)

    def ok(self, msg: Any, desc: Any = None) -> None:
        self.log(OK, msg, desc)

    def info(self, msg: Any, desc: Any = None) -> None:
        self.log(INFO, msg, desc)

    def debug(self, msg: Any, desc: Any = None) -> None:
        self.log(DEBUG, msg, desc)

    def trace(self, msg: Any, desc: Any = None) -> None:
        self.log(TRACE, msg, desc)

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

    def lastError(self) -> str:
        """The last error, or ""."""
        return next(iter(reversed(self.messages(ERROR))), "")

    def lastWarn(self) -> str:
        """The last warning, or ""."""
        return next(iter(reversed(self.messages(WARN))), "")

    def testError(self) -> bool:
        """Whether an error was logged since `clear`."""
        return self.count(ERROR) > 0

    def testWarn(self) -> bool:
        """Whether a warning was logged since `clear`."""
        return self.count(WARN) > 0

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

    def msgAlways(self) -> list[str]:
        return self.messages(ALWAYS)

    def msgError(self) -> list[str]:
        return self.messages(ERROR)

    def msgWarn(self) -> list[str]:
        return self.messages(WARN)

    def msgOk(self) -> list[str]:
        return self.messages(OK)

    def msgInfo(self) -> list[str]:
        return self.messages(INFO)

    def msgDebug(self) -> list[str]:
        return self.messages(DEBUG)

    def msgTrace(self) -> list[str]:
        return self.messages(TRACE)

    def countAlwaysMsg(self) -> int:
        return self.count(ALWAYS)

    def countErrorMsg(self) -> int:
        return self.count(ERROR)

    def countWarnMsg(self) -> int:
        return self.count(WARN)

    def countOkMsg(self) -> int:
        return self.count(OK)

    def countInfoMsg(self) -> int:
        return self.count(INFO)

    def countDebugMsg(self) -> int:
        return self.count(DEBUG)

    def countTraceMsg(self) -> int:
        return self.count(TRACE)

    def hasAlways(self) -> bool:
        return self.count(ALWAYS) > 0

    def hasError(self) -> bool:
        return self.count(ERROR) > 0

    def hasWarn(self) -> bool:
        return self.count(WARN) > 0

    def hasOk(self) -> bool:
        return self.count(OK) > 0

    def hasInfo(self) -> bool:
        return self.count(INFO) > 0

    def hasDebug(self) -> bool:
        return self.count(DEBUG) > 0

    def hasTrace(self) -> bool:
        return self.count(TRACE) > 0


_log = Log()

always, error, warn, ok = _log.always, _log.error, _log.warn, _log.ok
info, debug, trace = _log.info, _log.debug, _log.trace
assertError, assertWarn, assertOk, assertInfo = _log.assertError, _log.assertWarn, _log.assertOk, _log.assertInfo
setLevel, getLevel, useColor = _log.setLevel, _log.getLevel, _log.useColor
enableOutput, disableOutput, clear, reset = _log.enableOutput, _log.disableOutput, _log.clear, _log.reset
indent, unindent = _log.indent, _log.unindent
lastError, lastWarn, testError, testWarn = _log.lastError, _log.lastWarn, _log.testError, _log.testWarn
toString, dump = _log.toString, _log.dump
msgAlways, msgError, msgWarn, msgOk = _log.msgAlways, _log.msgError, _log.msgWarn, _log.msgOk
msgInfo, msgDebug, msgTrace = _log.msgInfo, _log.msgDebug, _log.msgTrace
countAlwaysMsg, countErrorMsg, countWarnMsg = _log.countAlwaysMsg, _log.countErrorMsg, _log.countWarnMsg
countOkMsg, countInfoMsg = _log.countOkMsg, _log.countInfoMsg
countDebugMsg, countTraceMsg = _log.countDebugMsg, _log.countTraceMsg
hasAlways, hasError, hasWarn, hasOk = _log.hasAlways, _log.hasError, _log.hasWarn, _log.hasOk
hasInfo, hasDebug, hasTrace = _log.hasInfo, _log.hasDebug, _log.hasTrace
