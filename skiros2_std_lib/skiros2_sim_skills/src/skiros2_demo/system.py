"""A system of its own for the demo: a master on a free port, a recorder, and what the launch file starts.

All processes are in sessions of their own, so that Ctrl-C reaches only the demo, which then ends them in order.
"""

from __future__ import annotations

import contextlib
import os
import re
import shutil
import signal
import socket
import subprocess
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import Any
from xmlrpc.client import ServerProxy

from skiros2_common.core.errors import Refused, SkirosError, TimedOut

#: How long a process may take to end when asked to (s), before it is killed. roslaunch gives its nodes 15 s.
END_TIMEOUT = 20.0
#: How long a part of the system may take to start (s).
START_TIMEOUT = 60.0
#: How long the recorder may lag behind what is published (s).
RECORDER_LAG = 1.0
#: What asks the demo to end.
END_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)

_TERMINAL_CODES = re.compile(r"\x1b\[[0-9;?]*[a-zA-Z]|\x1b\][^\x07]*\x07")
#: A node that names a mistake in its configuration (`/wm: scene ...`), or words of roslaunch and others for a failure.
_FAILURE = re.compile(r"^/\w+: |error|failed|cannot|exception|unable", re.IGNORECASE)


class SystemDown(SkirosError):
    """A part of the system could not start, or has ended."""


class System:
    """A running system; a context manager. Sets `ROS_MASTER_URI` and `ROS_HOME` for this process and its children.

    :param folder: where the bag goes, and a log of each process.
    :param port: the master's; 0 takes a free one.
    """

    def __init__(self, folder: Path, port: int = 0) -> None:
        self.bag = folder / "run.bag"
        self.port = port or _free_port()
        self._folder = folder
        self._home = ""
        self._environment: dict[str, str | None] = {}
        self._running: list[tuple[str, subprocess.Popen[bytes]]] = []

    def __enter__(self) -> System:
        """:raises Refused: the port is in use."""
        if not _is_free(self.port):
            raise Refused(f"port {self.port} is in use; give a free one, or none")
        entered = False
        try:
            self._prepare()
            entered = True
        finally:
            if not entered:
                self.__exit__(None, None, None)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Ends all processes, the last one first. The bag and the logs stay. Signals do not hold this up."""
        handlers = {number: signal.signal(number, signal.SIG_IGN) for number in END_SIGNALS}
        while self._running:
            _, process = self._running.pop()
            _end(process)
        _kill(_descendants(os.getpid()))  # one that a signal came upon when it was just started
        if self._home:
            shutil.rmtree(self._home, ignore_errors=True)
        for key, value in self._environment.items():
            if value is None:
                os.environ.pop(key, None)
            else:
                os.environ[key] = value
        for number, handler in handlers.items():
            signal.signal(number, handler)

    def start_master(self) -> None:
        """Starts the master and waits for it.

        :raises SystemDown: it ends.
        :raises TimedOut: it does not answer.
        """
        self._start("master", ["roscore", "-p", str(self.port)])
        self.wait_for(self._master_answers, "the master")

    def start_recording(self, robot: str) -> None:
        """Starts a recorder of all that a run needs, and waits until it listens.

        :param robot: the skill manager whose tasks it awaits.
        :raises SystemDown: it ends.
        :raises TimedOut: it does not get ready.
        """
        command = ["rosrun", "skiros2_bags", "record", "--force", "--no-check", "-o", str(self.bag), "--robots", robot]
        self._start("recorder", command)
        self.wait_for(lambda: "recording to" in self._log("recorder").read_text(errors="replace"), "the recorder")

    def launch(self, package: str, file: str, *arguments: str) -> None:
        """Starts a launch file. Does not wait for its nodes."""
        quiet = ("--skip-log-check", "--disable-title", "--no-summary")
        self._start("system", ["roslaunch", *quiet, package, file, *arguments])

    def stop_recording(self) -> None:
        """Ends the recorder, so that the bag is whole."""
        # A recorder tells nobody what it has got. What was published last is with it in milliseconds, on a busy machine
        # in more. The nodes cannot end first: they take their skills out of the world, which is no part of the run.
        time.sleep(RECORDER_LAG)
        recorder = next(started for started in self._running if started[0] == "recorder")
        _end(recorder[1])
        self._running.remove(recorder)

    def check(self) -> None:
        """:raises SystemDown: one of the processes has ended; the text has why, as far as its log tells."""
        for name, process in self._running:
            if process.poll() is not None:
                raise SystemDown(f"the {name} has ended: {self._complaint(name)} (see {self._log(name)})")

    def wait_for(self, condition: Callable[[], Any], what: str, timeout: float = START_TIMEOUT) -> None:
        """Waits until a condition holds; looks 20 times a second.

        :param what: what is waited for, in words.
        :raises SystemDown: a process has ended meanwhile.
        :raises TimedOut: it does not hold within `timeout` (s).
        """
        deadline = time.monotonic() + timeout
        while not condition():
            self.check()
            if time.monotonic() > deadline:
                name = self._running[-1][0]
                raise TimedOut(
                    f"{what}: not there after {timeout:.0f} s; {self._complaint(name)} (see {self._log(name)})"
                )
            time.sleep(0.05)

    # -- inside --------------------------------------------------------------------------------------------------------

    def _prepare(self) -> None:
        self._folder.mkdir(parents=True, exist_ok=True)
        for old in (self.bag, self.bag.with_suffix(".bag.active")):
            old.unlink(missing_ok=True)
        self._home = tempfile.mkdtemp(prefix="skiros2-demo-")
        wanted = {
            "ROS_MASTER_URI": f"http://localhost:{self.port}",
            "ROS_HOME": self._home,
            "ROS_LOG_DIR": f"{self._home}/log",
            "ROS_HOSTNAME": "localhost",
        }
        self._environment = {key: os.environ.get(key) for key in wanted}
        os.environ.update(wanted)

    def _start(self, name: str, command: list[str]) -> None:
        if shutil.which(command[0]) is None:
            raise SystemDown(f"the {name} cannot be started: there is no program {command[0]!r}; is ROS installed?")
        with self._log(name).open("wb") as log:
            process = subprocess.Popen(
                command, stdin=subprocess.DEVNULL, stdout=log, stderr=subprocess.STDOUT, start_new_session=True
            )
        self._running.append((name, process))

    def _master_answers(self) -> bool:
        try:
            return bool(self._ask_master("getPid"))
        except OSError:
            return False

    def _ask_master(self, call: str) -> Any:
        with ServerProxy(f"http://localhost:{self.port}") as master:
            _, _, answer = getattr(master, call)("/demo")
        return answer

    def _log(self, name: str) -> Path:
        return self._folder / f"{name}.log"

    def _complaint(self, name: str) -> str:
        """The first line of a process's log that speaks of a failure, or the last of all."""
        text = _TERMINAL_CODES.sub("", self._log(name).read_text(errors="replace"))
        lines = [line.strip() for line in text.splitlines() if line.strip()] or ["it said nothing"]
        return next((line for line in lines if _FAILURE.search(line)), lines[-1])


def _end(process: subprocess.Popen[bytes]) -> None:
    """Ends a process and all that it has started: asks, and after a while kills."""
    family = [process.pid, *_descendants(process.pid)]
    if process.poll() is None:
        process.send_signal(signal.SIGINT)
        try:
            process.wait(END_TIMEOUT)
        except subprocess.TimeoutExpired:
            family += _descendants(process.pid)
            process.kill()
    process.wait()
    _kill(family[1:])


def _kill(pids: list[int]) -> None:
    for pid in pids:
        with contextlib.suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)


def _descendants(pid: int) -> list[int]:
    """The processes that a process has started, and those that these have."""
    try:
        children = [int(child) for child in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]
    except OSError:
        return []
    return children + [below for child in children for below in _descendants(child)]


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("localhost", 0))
        return int(probe.getsockname()[1])


def _is_free(port: int) -> bool:
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind(("", port))
        except OSError:
            return False
    return True
