"""Start-up, shutdown and logging of nodes."""

from __future__ import annotations

import contextlib
import gc
import io
import logging
import os
import signal
import socket
import sys
import threading
import time
from collections.abc import Callable, Iterator
from queue import SimpleQueue

import rosgraph
import rosgraph.network
import rospy
import rospy.impl.tcpros_base as tcpros

from skiros2_common.command_line.command import VERSION
from skiros2_common.command_line.launch_error import (
    end_launch,
    launched_by,
    repeat_after_roslaunch,
    speak_for_launch,
)
from skiros2_common.core.errors import ConfigurationError
from skiros2_common.ros.master_watch import watch_master
from skiros2_common.ros.topic_polls import close_polls_with_topics
from skiros2_common.tools.logger import rosout_record

log = logging.getLogger(__name__)

#: Exit status of a node with wrong parameters or files, which a restart cannot fix (EX_CONFIG of sysexits.h).
EXIT_CONFIGURATION = 78

#: The period in which `spin` looks for a shutdown by ROS itself (s).
_POLL_PERIOD = 0.5

#: The timeout for the header of a new connection (s).
_HANDSHAKE_TIMEOUT = 10.0

#: The maximum size of a header (bytes). The longest ones of ROS clients contain a message definition.
_MAX_HEADER_BYTES = 4 * 1024 * 1024

#: A node that is ending has this time before its successor takes it for a second one (s); the period of looking.
_HANDOVER_TIMEOUT, _HANDOVER_PERIOD = 1.0, 0.1

_shutdown_thread: _ShutdownThread | None = None


class RosoutHandler(logging.Handler):
    """Forwards the records of Python loggers to rosout, with their source location."""

    def emit(self, record: logging.LogRecord) -> None:
        copy, rosout = rosout_record(record), logging.getLogger("rosout")
        if rosout.isEnabledFor(copy.levelno):
            rosout.handle(copy)

    def filter(self, record: logging.LogRecord) -> bool:
        # The records of rospy and of `skiros2_common.tools.logger` reach rosout without this handler.
        return not record.name.startswith(("ros", "topics", "xmlrpc")) and not getattr(record, "is_shown", False)


def bridge_logging(verbose: bool = False) -> None:
    """Forwards the records of Python's `logging` to rosout.

    :param verbose: include the debug records of this platform.
    """
    root = logging.getLogger()
    if not any(isinstance(handler, RosoutHandler) for handler in root.handlers):
        root.addHandler(RosoutHandler())
    root.setLevel(logging.INFO)
    for name in ("skiros2", "skiros2_common", "skiros2_world_model", "skiros2_skill", "skiros2_task", "skiros2_sim"):
        logging.getLogger(name).setLevel(logging.DEBUG if verbose else logging.INFO)


def run_node(name: str, main: Callable[[], None]) -> None:
    """Runs a node program: registers the node (again after a restart of the master), calls `main`, ends the process.

    :param name: the node's default name.
    :param main: does the node's work and returns at shutdown, which a signal starts in another thread; see `spin`.
        If it raises `ConfigurationError`, the process ends with one line on stderr and status 78.
    """
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(line_buffering=True)  # a pipe, as of `roslaunch | tee`, gets each message at once
    if "--version" in sys.argv:
        sys.stdout.write(f"{VERSION}\n")
        return
    if not rosgraph.is_master_online():
        _die(f"{name}: no ROS master answers at {rosgraph.get_master_uri()}; start one with roscore or roslaunch", 1)
    if launched_by():
        _end_second_launch(name)
    close_polls_with_topics()
    with shutdown_in_thread():
        try:
            rospy.init_node(name, disable_signals=True)
        except rospy.ROSInitException as error:
            _die(f"{name}: {error}", 1)
        handshake_in_threads()
        bridge_logging(bool(rospy.get_param("~verbose", False)))
        watch_master()
        gc.freeze()  # collections while the node runs do not visit the modules: a tick waits 20 ms less for the longest
        gc.enable()
        try:
            main()
        except ConfigurationError as error:
            _die(f"{rospy.get_name()}: {error}", EXIT_CONFIGURATION)
        except rospy.ROSInterruptException:
            return


def _end_second_launch(name: str) -> None:
    """Ends the launch if a node of this name runs already: the master would end that one, and its launch restart it."""
    given = rospy.names.load_mappings(sys.argv)
    namespace = given.get("__ns", rosgraph.names.get_ros_namespace())
    full = rosgraph.names.ns_join(namespace, given.get("__name", name))
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # another node of the launch may end it first
    end = time.monotonic() + _HANDOVER_TIMEOUT
    while _answers(full):
        if time.monotonic() > end:
            spokesman = speak_for_launch()
            if spokesman is not None:
                advice = "end its launch first, or set ROS_NAMESPACE for this one"
                repeat_after_roslaunch(f"{full} is already running: {advice}")
            end_launch()
            os._exit(EXIT_CONFIGURATION)
        time.sleep(_HANDOVER_PERIOD)


def _answers(node: str) -> bool:
    """Whether a node answers by this name: another one may have the address of a killed one by now."""
    service = f"{node}/get_loggers"  # which every node has; the other calls of a node do not tell its name
    header = {"service": service, "md5sum": "*", "callerid": "/skiros2_start", "probe": "1"}
    try:
        address = rospy.core.parse_rosrpc_uri(rosgraph.Master("/skiros2_start").lookupService(service))
        with socket.create_connection(address, _HANDOVER_TIMEOUT) as connection:
            rosgraph.network.write_ros_handshake_header(connection, header)
            answer = rosgraph.network.read_ros_handshake_header(connection, io.BytesIO(), 4096)
    except (rosgraph.MasterException, OSError, rosgraph.network.ROSHandshakeException):
        return False
    return bool(answer.get("callerid") == node)


def _die(line: str, status: int) -> None:
    """Ends the process with one line on stderr, without waiting for the threads of a partly started node."""
    rospy.signal_shutdown(line)
    sys.stderr.write(line + "\n")
    sys.stderr.flush()
    if status == EXIT_CONFIGURATION:
        repeat_after_roslaunch(line)
        end_launch()
    os._exit(status)


# -- shutdown ------------------------------------------------------------------------------------------------------


class _ShutdownThread(threading.Thread):
    """Shuts the node down on request.

    rospy runs the shutdown hooks in the signal handler, on top of the main thread's current frame. If that frame holds
    a lock that a hook needs, for example of logging, the node deadlocks.
    """

    def __init__(self) -> None:
        super().__init__(name="shutdown")
        self._reasons: SimpleQueue[str] = SimpleQueue()
        self.started = threading.Event()

    def request(self, reason: str) -> None:
        """Requests the shutdown. Safe in signal handlers: it takes no lock that the interrupted thread may hold."""
        self._reasons.put(reason)

    def run(self) -> None:
        reason = self._reasons.get()
        self.started.set()
        rospy.signal_shutdown(reason)


@contextlib.contextmanager
def shutdown_in_thread() -> Iterator[None]:
    """A context manager: SIGINT, SIGTERM and its end shut the node down in a separate thread.

    For the main thread, with `rospy.init_node(..., disable_signals=True)` inside. The main thread continues during the
    shutdown: it has to check `rospy.is_shutdown` or to call `spin`.
    """
    global _shutdown_thread
    _shutdown_thread = thread = _ShutdownThread()
    thread.start()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda number, _: thread.request(f"signal {number}"))
    try:
        yield
    finally:
        thread.request("the program has ended")
        thread.join()


def spin() -> None:
    """Same as `rospy.spin`, for use in `shutdown_in_thread`: returns after all shutdown hooks have run."""
    assert _shutdown_thread is not None, "spin requires shutdown_in_thread"
    while not rospy.is_shutdown() and not _shutdown_thread.started.wait(_POLL_PERIOD):
        pass
    if _shutdown_thread.started.is_set():
        _shutdown_thread.join()


# -- inbound connections -------------------------------------------------------------------------------------------


def handshake_in_threads() -> None:
    """Moves the handshakes of TCPROS connections to threads. Call it once, after `rospy.init_node`.

    rospy reads the header of a new connection in its single accepting thread, for up to 60 s. A client that sends
    nothing (a port scanner) or another protocol blocks all topics and services of the node for that time.
    """
    tcpros.start_tcpros_server()
    server = tcpros._tcpros_server.tcp_ros_server
    handshake = server.inbound_handler

    def check_header(connection: socket.socket, address: tuple[str, int]) -> None:
        timeout = connection.gettimeout()
        connection.settimeout(_HANDSHAKE_TIMEOUT)
        try:
            size = int.from_bytes(connection.recv(4, socket.MSG_PEEK), "little")
        except OSError as error:
            log.debug("connection from %s: no header received: %s", address, error)
            connection.close()
            return
        if size > _MAX_HEADER_BYTES:
            log.debug("connection from %s: not a TCPROS header", address)
            connection.close()
            return
        connection.settimeout(timeout)
        handshake(connection, address)

    def start_thread(*connection: object) -> None:
        threading.Thread(target=check_header, args=connection, name="inbound", daemon=True).start()

    server.inbound_handler = start_thread
