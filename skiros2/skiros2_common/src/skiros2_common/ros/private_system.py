"""A private ROS system: a master on a free port with the processes that a program starts."""

from __future__ import annotations

import contextlib
import os
import re
import shutil
import subprocess
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Self
from xmlrpc.client import ServerProxy

import rospy

from skiros2_common.command_line.master import XMLRPC_ERRORS
from skiros2_common.core.errors import Refused, SkirosError, TimedOut
from skiros2_common.core.processes import TerminationSignals, end_processes, free_port, is_free

#: The timeout for a process to end after SIGINT before it is killed (s). roslaunch gives its nodes 15 s.
STOP_TIMEOUT = 20.0
#: The timeout for the start of a part of the system (s).
START_TIMEOUT = 60.0

_POLL_PERIOD = 0.02  # s
_TERMINAL_CODES = re.compile(r"\x1b\[[0-9;?]*[a-zA-Z]|\x1b\][^\x07]*\x07")
#: A log line about a failure: a node's configuration error (`/wm: scene ...`), or words of roslaunch and others.
_FAILURE = re.compile(r"^/\w+: |error|failed|cannot|exception|unable", re.IGNORECASE)


class SystemDown(SkirosError):
    """A process of the system failed to start or has ended."""


class PrivateSystem:
    """A context manager for the main thread that sets `ROS_MASTER_URI` and `ROS_HOME` for this process and the
    processes it starts. A termination signal raises `Terminated`.

    Each process has its own session, so Ctrl-C reaches only the program, which then ends the processes in order.

    :param name: purpose of the system; part of the name of its temporary folder.
    :param logs: folder for the log of each process; None: a temporary one.
    :param port: of the master; 0 selects a free one.
    :param has_own_home: also set `HOME`, to separate the system from the user's settings.
    :ivar signals: the termination signals of this process; a program that uses Qt defers them while Qt runs.
    """

    def __init__(self, name: str, logs: Path | None = None, port: int = 0, has_own_home: bool = False) -> None:
        self.port = port or free_port()
        self._name = name
        self._logs = logs
        self._has_own_home = has_own_home
        self._home = ""
        self._running: dict[str, subprocess.Popen[bytes]] = {}
        self._is_node = False
        self.signals = TerminationSignals()
        self._at_exit = contextlib.ExitStack()

    def __enter__(self) -> Self:
        """Starts the master and waits for it.

        :raises Refused: the port is in use.
        :raises SystemDown: the master failed to start.
        :raises TimedOut: the master does not answer.
        """
        if not is_free(self.port):
            raise Refused(f"port {self.port} is in use; pass a free one, or none")
        with contextlib.ExitStack() as stack:
            stack.enter_context(self.signals)
            folder = tempfile.TemporaryDirectory(prefix=f"skiros2-{self._name}-", ignore_cleanup_errors=True)
            self._home = stack.enter_context(folder)
            stack.callback(os.environ.update, dict(os.environ))
            stack.callback(os.environ.clear)
            os.environ.update(self._environment())
            self.start("master", ["roscore", "-p", str(self.port)])
            stack.callback(self.end, "master")
            stack.callback(self._end_node)
            stack.callback(self._end_others)
            stack.callback(self.signals.ignore)
            self.wait_for(self._master_answers, "the master")
            self._at_exit = stack.pop_all()
        return self

    def __exit__(self, *error: Any) -> None:
        """Ends all processes, and the node of this process and the master last. Ignores signals meanwhile."""
        self._at_exit.__exit__(*error)

    def init_node(self, name: str) -> None:
        """Makes this process a node until the system ends. rospy allows it once per process."""
        rospy.init_node(name, disable_signals=True)
        self._is_node = True

    def start(self, name: str, command: Sequence[str]) -> None:
        """Starts a process without waiting for it.

        :param name: of the process in errors.
        :param command: program and arguments.
        :raises SystemDown: the program is not installed.
        :raises Refused: a process of this name is running.
        """
        if name in self._running:
            raise Refused(f"the {name} is already running")
        if shutil.which(command[0]) is None:
            raise SystemDown(f"the {name} cannot be started: there is no program {command[0]!r}; is ROS installed?")
        with self.signals.deferred(), self.log(name).open("wb") as log:
            self._running[name] = subprocess.Popen(
                command, stdin=subprocess.DEVNULL, stdout=log, stderr=subprocess.STDOUT, start_new_session=True
            )

    def launch(self, *arguments: str, name: str = "system") -> None:
        """Starts a launch file without waiting for its nodes.

        :param arguments: package, file, arguments.
        :param name: of the process in errors.
        """
        quiet = ("--skip-log-check", "--disable-title", "--no-summary")
        self.start(name, ["roslaunch", *quiet, *arguments])

    def end(self, name: str) -> None:
        """Ends the process of this name."""
        end_processes([self._running.pop(name)], STOP_TIMEOUT)

    def check(self) -> None:
        """:raises Terminated: a termination signal was received.
        :raises SystemDown: a process has ended; the text gives the reason found in its log.
        """
        self.signals.raise_received()
        for name, process in self._running.items():
            if process.poll() is not None:
                raise SystemDown(f"the {name} has ended: {self._failure_line(name)}")

    def wait_for(self, condition: Callable[[], Any], what: str, timeout: float = START_TIMEOUT) -> None:
        """Waits until a condition holds; checks it 50 times a second.

        :param what: the awaited event, as text.
        :param timeout: s.
        :raises SystemDown: a process has ended meanwhile.
        :raises TimedOut: the condition does not hold before the timeout.
        """
        deadline = time.monotonic() + timeout
        while not condition():
            self.check()
            if time.monotonic() > deadline:
                newest = list(self._running)[-1]
                raise TimedOut(f"{what}: not there after {timeout:.0f} s; {self._failure_line(newest)}")
            time.sleep(_POLL_PERIOD)

    def log(self, name: str) -> Path:
        """The file with a process's output."""
        return (self._logs or Path(self._home)) / f"{name.strip('/').replace('/', '-')}.log"

    # -- internals -----------------------------------------------------------------------------------------------------

    def _environment(self) -> dict[str, str]:
        return {
            "ROS_MASTER_URI": f"http://localhost:{self.port}",
            "ROS_HOME": self._home,
            "ROS_LOG_DIR": f"{self._home}/log",
            "ROS_HOSTNAME": "localhost",
            **({"HOME": self._home} if self._has_own_home else {}),
        }

    def _end_others(self) -> None:
        end_processes([process for name, process in self._running.items() if name != "master"], STOP_TIMEOUT)

    def _end_node(self) -> None:
        if self._is_node:
            rospy.signal_shutdown(f"the {self._name} has ended")

    def _master_answers(self) -> bool:
        try:
            with ServerProxy(f"http://localhost:{self.port}") as master:
                return bool(master.getPid(f"/{self._name}"))
        except XMLRPC_ERRORS:
            return False

    def _failure_line(self, name: str) -> str:
        """The first line about a failure in a process's log, otherwise the last line."""
        text = _TERMINAL_CODES.sub("", self.log(name).read_text(errors="replace"))
        lines = [line.strip() for line in text.splitlines() if line.strip()] or ["its log is empty"]
        line = next((line for line in lines if _FAILURE.search(line)), lines[-1])
        return line if self._logs is None else f"{line} (see {self.log(name)})"
