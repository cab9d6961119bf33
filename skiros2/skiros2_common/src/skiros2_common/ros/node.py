"""Start-up, logging and parameters of nodes."""

from __future__ import annotations

import logging
import math
import os
import sys
from collections.abc import Callable

import rosgraph
import rospy

from skiros2_common.command_line.launch_error import repeat_after_roslaunch
from skiros2_common.core.errors import ConfigurationError
from skiros2_common.ros.inbound_connections import handshake_in_threads
from skiros2_common.ros.master_watch import watch_master
from skiros2_common.ros.shutdown import shutdown_in_thread

#: Exit status of a node with wrong parameters or files, which a restart cannot fix (EX_CONFIG of sysexits.h).
EXIT_CONFIGURATION = 78

#: The levels of rosout; others are mapped to the next lower one.
_ROSOUT_LEVELS = (logging.CRITICAL, logging.ERROR, logging.WARNING, logging.INFO, logging.DEBUG)


class RosoutHandler(logging.Handler):
    """Forwards the records of Python loggers to rosout, with their source location."""

    def emit(self, record: logging.LogRecord) -> None:
        # ALWAYS is above all levels, but is not an error.
        number = logging.INFO if record.levelname == "ALWAYS" else record.levelno
        level = next((known for known in _ROSOUT_LEVELS if number >= known), logging.DEBUG)
        rosout = logging.getLogger("rosout")
        if rosout.isEnabledFor(level):
            overrides = {"name": "rosout", "levelno": level, "levelname": logging.getLevelName(level)}
            text = {"msg": self.format(record), "args": (), "exc_info": None, "exc_text": None}
            rosout.handle(logging.makeLogRecord({**record.__dict__, **overrides, **text}))

    def filter(self, record: logging.LogRecord) -> bool:
        # The records of rospy and of `skiros2_common.tools.logger` reach rosout without this handler.
        return not record.name.startswith(("ros", "topics", "xmlrpc")) and not getattr(record, "is_shown", False)


def bridge_logging(verbose: bool = False) -> None:
    """Forwards the records of Python's `logging` to rosout.

    :param verbose: include the debug records of this platform.
    """
    root = logging.getLogger()
    if not any(isinstance(handler, RosoutHandler) for handler in root.handlers):
        handler = RosoutHandler()
        handler.setFormatter(logging.Formatter("%(message)s"))
        root.addHandler(handler)
    root.setLevel(logging.INFO)
    for name in ("skiros2", "skiros2_common", "skiros2_world_model", "skiros2_skill", "skiros2_task", "skiros2_sim"):
        logging.getLogger(name).setLevel(logging.DEBUG if verbose else logging.INFO)


def run_node(name: str, main: Callable[[], None]) -> None:
    """Runs a node program: registers the node (again after a restart of the master), calls `main`, ends the process.

    :param name: the node's default name.
    :param main: does the node's work and returns at shutdown, which a signal starts in another thread (see `shutdown`).
        If it raises `ConfigurationError`, the process ends with one line on stderr and status 78.
    """
    if not rosgraph.is_master_online():
        _die(f"{name}: no ROS master answers at {rosgraph.get_master_uri()}; start one with roscore or roslaunch", 1)
    with shutdown_in_thread():
        try:
            rospy.init_node(name, disable_signals=True)
        except rospy.ROSInitException as error:
            _die(f"{name}: {error}", 1)
        handshake_in_threads()
        bridge_logging(bool(rospy.get_param("~verbose", False)))
        watch_master()
        try:
            main()
        except ConfigurationError as error:
            _die(f"{rospy.get_name()}: {error}", EXIT_CONFIGURATION)
        except rospy.ROSInterruptException:
            return


def _die(line: str, status: int) -> None:
    """Ends the process with one line on stderr, without waiting for the threads of a partly started node."""
    rospy.signal_shutdown(line)
    sys.stderr.write(line + "\n")
    sys.stderr.flush()
    if status == EXIT_CONFIGURATION:
        repeat_after_roslaunch(line)
    os._exit(status)


def list_param(name: str) -> list[str]:
    """A parameter with a list of names; [] if it is missing or empty.

    :raises ConfigurationError: the parameter has another value.
    """
    value = rospy.get_param(name, [])
    if value in ("", None):
        return []
    if not isinstance(value, list) or not all(isinstance(item, str) for item in value):
        raise ConfigurationError(f"parameter {rospy.resolve_name(name)} is {value!r}, expected a list of names")
    return value


def positive_param(name: str, default: float, maximum: float = math.inf) -> float:
    """A parameter with a number above 0.

    :param maximum: upper bound, inclusive.
    :raises ConfigurationError: the parameter has another value.
    """
    value = rospy.get_param(name, default)
    is_number = isinstance(value, (int, float)) and not isinstance(value, bool)
    if not is_number or not 0 < value <= maximum or math.isinf(value):
        limit = "" if math.isinf(maximum) else f" and up to {maximum:g}"
        raise ConfigurationError(f"parameter {rospy.resolve_name(name)} is {value!r}, expected a number above 0{limit}")
    return float(value)
