"""Start-up and logging that all nodes share."""

from __future__ import annotations

import logging
import os
import sys
from collections.abc import Callable

import rospy
from rosgraph.names import valid_name

from skiros2_common.core.errors import ConfigurationError

#: Exit status of a node whose parameters or files are wrong, so that no restart can help (EX_CONFIG of sysexits.h).
EXIT_CONFIGURATION = 78


class RosoutHandler(logging.Handler):
    """Forwards the records of Python loggers to rosout."""

    def emit(self, record: logging.LogRecord) -> None:
        text = self.format(record)
        if record.levelno >= logging.CRITICAL and record.levelname != "ALWAYS":
            rospy.logfatal("%s", text)
        elif record.levelname == "ALWAYS":
            rospy.loginfo("%s", text)
        elif record.levelno >= logging.ERROR:
            rospy.logerr("%s", text)
        elif record.levelno >= logging.WARNING:
            rospy.logwarn("%s", text)
        elif record.levelno >= logging.INFO:
            rospy.loginfo("%s", text)
        else:
            rospy.logdebug("%s", text)


def bridge_logging(verbose: bool = False) -> None:
    """Sends the records of all `skiros2...` loggers to rosout, from now on.

    :param verbose: debug records too.
    """
    for name in [n for n in logging.root.manager.loggerDict if n.startswith("skiros2")] + ["skiros2"]:
        root = name.split(".")[0]
        logger = logging.getLogger(root)
        if not any(isinstance(h, RosoutHandler) for h in logger.handlers):
            logger.addHandler(RosoutHandler())
        logger.setLevel(logging.DEBUG if verbose else logging.INFO)
        logger.propagate = False
    if not any(isinstance(h, RosoutHandler) for h in logging.getLogger("skiros2").handlers):
        logging.getLogger("skiros2").addHandler(RosoutHandler())


def run_node(name: str, main: Callable[[], None], **init_options: object) -> None:
    """Runs a node program: registers the node, calls `main`, and ends the process.

    :param name: the node's default name.
    :param main: does the node's work and returns at shutdown. A `ConfigurationError` it raises ends the process
        with one line on stderr and status 78.
    :param init_options: for `rospy.init_node`.
    """
    try:
        rospy.init_node(name, **init_options)
    except rospy.ROSInitException as error:
        _die(f"{name}: {error}", 1)
    bridge_logging(bool(rospy.get_param("~verbose", False)))
    try:
        main()
    except ConfigurationError as error:
        _die(f"{rospy.get_name()}: {error}", EXIT_CONFIGURATION)
    except rospy.ROSInterruptException:
        return


def _die(line: str, status: int) -> None:
    """Ends the process with one line on stderr. Threads that a half-made node has started do not hold it up."""
    rospy.signal_shutdown(line)
    sys.stderr.write(line + "\n")
    sys.stderr.flush()
    os._exit(status)
