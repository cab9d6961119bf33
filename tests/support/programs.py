"""Child processes: live output, end and cleanup."""

from __future__ import annotations

import contextlib
import os
import re
import signal
import subprocess
import threading
import time
from collections.abc import Mapping, Sequence
from pathlib import Path

from support.forks import Fork, ForkServer, is_readable

#: What terminals take for colours and titles; roslaunch and rospy print it also when there is none.
_TERMINAL_CODES = re.compile(r"\x1b\[[0-9;?]*[a-zA-Z]|\x1b\][^\x07]*\x07")

#: Interrupts a program when the thread that has started it ends, also by a kill: stopped tests leave nothing.
_WITH_PARENT = ("setpriv", "--pdeathsig", "INT", "--")

#: What tests wait for takes a second or two; beside much other load, longer (s).
PATIENCE = 60.0

#: roslaunch gives its nodes 15 s for a clean end, then 2 s more.
STOP_TIMEOUT = 20.0


class Program:
    """A started program, in a process group of its own, with stdout and stderr read together, line by line.

    :param command: the program and its arguments.
    :param env: its whole environment; by default this process's.
    :param cwd: the folder it runs in.
    :param forks: starts it, instead of the system; see support/forks.py.
    """

    def __init__(
        self,
        command: Sequence[str],
        env: Mapping[str, str] | None = None,
        cwd: Path | None = None,
        forks: ForkServer | None = None,
    ) -> None:
        self.command = [str(part) for part in command]
        self._lines: list[str] = []
        self._change = threading.Condition()
        self._closed = False
        read, write = os.pipe()
        self._process: Fork | subprocess.Popen[str]
        if forks is not None:
            self._process = forks.start(self.command, env or os.environ, cwd, write, write)
        else:
            self._process = subprocess.Popen(
                [*_WITH_PARENT, *self.command],
                env=None if env is None else dict(env),
                cwd=cwd,
                stdin=subprocess.DEVNULL,
                stdout=write,
                stderr=write,
                text=True,
                start_new_session=True,
            )
        os.close(write)
        name = f"output of {self.command[0]}"
        self._reader = threading.Thread(target=self._read, args=(read,), name=name, daemon=True)
        self._reader.start()

    @property
    def pid(self) -> int:
        return self._process.pid

    @property
    def status(self) -> int | None:
        """The exit status, negative for a signal; None while it runs."""
        return self._process.poll()

    @property
    def running(self) -> bool:
        return self.status is None

    @property
    def output(self) -> str:
        """What it has printed so far, without colours."""
        with self._change:
            return "\n".join(self._lines)

    def wait_for_line(self, pattern: str, timeout: float = PATIENCE) -> re.Match[str]:
        """Waits until it has printed a line in which the pattern is found, and returns the match.

        :raises AssertionError: it ended without, or the time (s) is over; with all that it has printed.
        """
        expression = re.compile(pattern)
        seen = 0
        end = time.monotonic() + timeout
        with self._change:
            while True:
                for line in self._lines[seen:]:
                    if match := expression.search(line):
                        return match
                seen = len(self._lines)
                left = end - time.monotonic()
                if self._closed or left <= 0:
                    why = "ended" if self._closed else f"ran for {timeout:g} s"
                    raise AssertionError(
                        f"{self} {why} without a line like {pattern!r}; it printed:\n{self.output_tail()}"
                    )
                self._change.wait(left)

    def wait(self, timeout: float = PATIENCE) -> int:
        """Waits for its end and returns the exit status.

        :raises AssertionError: it has not ended within that time (s).
        """
        try:
            status = self._process.wait(timeout)
        except subprocess.TimeoutExpired:
            raise AssertionError(f"{self} has not ended in {timeout:g} s; it printed:\n{self.output_tail()}") from None
        self._reader.join(5.0)
        return status

    def interrupt(self) -> None:
        """As Ctrl-C in a terminal: SIGINT to its whole process group."""
        self.signal(signal.SIGINT)

    def signal(self, number: int) -> None:
        """Sends a signal to its whole process group; nothing when that has ended."""
        if self.running:
            os.killpg(self.pid, number)

    def stop(self, timeout: float = STOP_TIMEOUT) -> None:
        """Ends the program and its descendants by SIGINT; kills those that remain after the timeout (s)."""
        family = descendants(self.pid) if self.running else []
        self.interrupt()
        try:
            self._process.wait(timeout)
        except subprocess.TimeoutExpired:
            family += descendants(self.pid)
            self.signal(signal.SIGKILL)
            self._process.wait()
        for process in family:
            process.kill()
        for process in family:
            process.wait()
        self._reader.join(5.0)

    def output_tail(self, lines: int = 80) -> str:
        with self._change:
            return "\n".join(self._lines[-lines:])

    def __str__(self) -> str:
        return " ".join(os.path.basename(part) if index == 0 else part for index, part in enumerate(self.command))

    def _read(self, descriptor: int) -> None:
        with open(descriptor, errors="replace") as output:
            for line in output:
                with self._change:
                    self._lines.append(_TERMINAL_CODES.sub("", line.rstrip("\n")))
                    self._change.notify_all()
        with self._change:
            self._closed = True
            self._change.notify_all()


class ProcessId:
    """A process, distinguished by its start time from a later one with the same id."""

    def __init__(self, pid: int) -> None:
        self.pid = pid
        self._started = _started_at(pid)

    @property
    def running(self) -> bool:
        return self._started is not None and _started_at(self.pid) == self._started

    def kill(self) -> None:
        if self.running:
            with contextlib.suppress(ProcessLookupError):
                os.kill(self.pid, signal.SIGKILL)

    def wait(self, timeout: float = 10.0) -> None:
        """Waits until it has ended. It need not be a child of this process.

        :raises AssertionError: it has not ended within that time (s).
        """
        with contextlib.suppress(ProcessLookupError):
            descriptor = os.pidfd_open(self.pid)
            try:
                if self.running and not is_readable(descriptor, timeout):
                    raise AssertionError(f"{self} has not ended in {timeout:g} s")
            finally:
                os.close(descriptor)

    def __repr__(self) -> str:
        try:
            command = Path(f"/proc/{self.pid}/cmdline").read_bytes().replace(b"\0", b" ").decode().strip()
        except OSError:
            command = "(ended)"
        return f"{self.pid} {command}"


def descendants(pid: int) -> list[ProcessId]:
    """The processes that a process has started, those which they have started, and so on."""
    children: dict[int, list[int]] = {}
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit() and (fields := _stat(int(entry.name))):
            children.setdefault(int(fields[1]), []).append(int(entry.name))
    found: list[int] = []
    heads = [pid]
    while heads:
        heads = [child for head in heads for child in children.get(head, [])]
        found += heads
    return [ProcessId(number) for number in found]


def _stat(pid: int) -> list[str] | None:
    """The fields of /proc/PID/stat after the name: state, parent, ...; None for one that has ended.

    A killed one has ended when its last thread has: one that is still writing to the disk keeps the connections open.
    """
    try:
        text = Path(f"/proc/{pid}/stat").read_text()
        threads = len(os.listdir(f"/proc/{pid}/task"))
    except OSError:
        return None
    fields = text.rpartition(")")[2].split()
    return None if fields[0] in "ZX" and threads <= 1 else fields


def _started_at(pid: int) -> str | None:
    fields = _stat(pid)
    return fields[19] if fields else None
