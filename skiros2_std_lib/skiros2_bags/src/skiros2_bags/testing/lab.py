"""A ROS master of its own with the nodes that a replay needs; this process is a node too."""

from __future__ import annotations

import contextlib
import os
import shutil
import signal
import socket
import subprocess
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any
from xmlrpc.client import ServerProxy

import rospy

from skiros2_common.core.errors import SkirosError, TimedOut

#: How long a node may take to start, and to end when it is asked to (s).
START_SECONDS = 30.0
END_SECONDS = 10.0

_POLL = 0.02  # s


class NodeDied(SkirosError):
    """A node of a replay has ended by itself."""


class Lab:
    """A context manager. One in a process, since rospy can be initialised once; `ROS_MASTER_URI` is set for good.

    :param name: of the node that this process is.
    """

    def __init__(self, name: str) -> None:
        self._name = name
        self._home = tempfile.mkdtemp(prefix="skiros2-replay-")
        self._port = _free_port()
        self._running: list[tuple[str, subprocess.Popen[bytes]]] = []

    def __enter__(self) -> Lab:
        os.environ.update(
            ROS_MASTER_URI=f"http://localhost:{self._port}",
            ROS_HOSTNAME="localhost",
            ROS_HOME=self._home,
            ROS_LOG_DIR=f"{self._home}/log",
            HOME=self._home,
        )
        entered = False
        try:
            self._start("master", ["roscore", "-p", str(self._port)])
            self.wait_for(self._master_answers, "the master")
            rospy.init_node(self._name, disable_signals=True)
            entered = True
        finally:
            if not entered:
                self.__exit__(None, None, None)
        return self

    def __exit__(self, kind: type | None, error: BaseException | None, trace: TracebackType | None) -> None:
        """Ends all nodes, the last one first, then the master."""
        master, nodes = self._running[:1], self._running[1:]
        for _, process in nodes:
            process.send_signal(signal.SIGINT)
        for _, process in reversed(nodes):
            _end(process)
        rospy.signal_shutdown("the replay is over")
        for _, process in master:
            _end(process)
        shutil.rmtree(self._home, ignore_errors=True)

    def set_parameters(self, values: Mapping[str, Any]) -> None:
        """Sets parameters of the master by full name."""
        for name, value in values.items():
            rospy.set_param(name, value)

    def node(self, package: str, program: str, name: str, parameters: Mapping[str, Any] | None = None) -> None:
        """Starts a node; does not wait for it.

        :param name: its full name.
        :param parameters: its private ones.
        """
        namespace, _, own = name.rpartition("/")
        self.set_parameters({f"{name}/{key}": value for key, value in (parameters or {}).items()})
        self._start(name, ["rosrun", package, program, f"__name:={own}", f"__ns:={namespace or '/'}"])

    def launch(self, *arguments: str) -> None:
        """Starts a launch file: package, file, arguments."""
        self._start("launch file", ["roslaunch", "--skip-log-check", "--no-summary", *arguments])

    def wait_for(self, condition: Callable[[], Any], what: str, timeout: float = START_SECONDS) -> None:
        """Waits until a condition holds.

        :raises NodeDied: a node has ended meanwhile.
        :raises TimedOut: it does not hold in time (s).
        """
        end = time.monotonic() + timeout
        while not condition():
            for name, process in self._running:
                if process.poll() is not None:
                    raise NodeDied(f"while {what} was waited for, {name} has ended: {self._last_lines(name)}")
            if time.monotonic() > end:
                raise TimedOut(f"{what}: not within {timeout:g} s")
            time.sleep(_POLL)

    # -- inside ------------------------------------------------------------------------------------------------------

    def _start(self, name: str, command: Sequence[str]) -> None:
        with self._log(name).open("wb") as log:
            process = subprocess.Popen(
                command, stdin=subprocess.DEVNULL, stdout=log, stderr=subprocess.STDOUT, start_new_session=True
            )
        self._running.append((name, process))

    def _log(self, name: str) -> Path:
        return Path(self._home) / f"{name.strip('/').replace('/', '-')}.txt"

    def _last_lines(self, name: str) -> str:
        return " | ".join(self._log(name).read_text(errors="replace").strip().splitlines()[-3:]) or "it said nothing"

    def _master_answers(self) -> bool:
        try:
            with ServerProxy(f"http://localhost:{self._port}") as master:
                return bool(master.getPid("/replay"))
        except OSError:
            return False


def _end(process: subprocess.Popen[bytes]) -> None:
    """Ends a process and its group: asks, and after a while kills."""
    with contextlib.suppress(ProcessLookupError):
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGINT)
            try:
                process.wait(END_SECONDS)
            except subprocess.TimeoutExpired:
                os.killpg(process.pid, signal.SIGKILL)
        process.wait()


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("localhost", 0))
        return int(probe.getsockname()[1])
