"""Termination signals, the end of child processes, and free TCP ports, for programs that start others."""

from __future__ import annotations

import contextlib
import os
import random
import signal
import socket
import subprocess
from collections.abc import Iterator, Sequence
from pathlib import Path
from types import FrameType, TracebackType
from typing import Any

from skiros2_common.core.errors import Refused

TERMINATION_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)

#: The ports to select from: below the ephemeral ones (32768 to 60999 on Linux), so that the system does not assign a
#: free port to another program before the server binds it.
_PORTS = range(15000, 32000)
_TRIES = 100


class Terminated(KeyboardInterrupt):
    """The program received a termination signal.

    :ivar number: the signal.
    """

    def __init__(self, number: int) -> None:
        super().__init__(f"terminated by {signal.Signals(number).name}")
        self.number = number


class TerminationSignals:
    """A context manager for the main thread: the first termination signal raises `Terminated`.

    Later signals, and signals that the program already ignores (nohup), are ignored. Code that prints exceptions and
    continues, such as Qt's calls of virtual methods and Python's of finalisers, would swallow it: run such code within
    `deferred`, and call `raise_received` regularly.
    """

    def __init__(self) -> None:
        self._handlers: dict[int, Any] = {}
        self._received: int | None = None
        self._deferrals = 0

    def __enter__(self) -> TerminationSignals:
        """:raises ValueError: this is not the main thread."""
        for number in TERMINATION_SIGNALS:
            if signal.getsignal(number) != signal.SIG_IGN:
                self._handlers[number] = signal.signal(number, self._end)
        return self

    def __exit__(self, kind: type | None, error: BaseException | None, trace: TracebackType | None) -> None:
        for number, handler in self._handlers.items():
            signal.signal(number, handler)

    @contextlib.contextmanager
    def deferred(self) -> Iterator[None]:
        """A context manager that defers signals: one received inside is raised at the end of the outermost one."""
        self._deferrals += 1
        try:
            yield
        finally:
            self._deferrals -= 1
        if not self._deferrals:
            self.raise_received()

    def raise_received(self) -> None:
        """:raises Terminated: a signal was received. Also within `deferred`."""
        if self._received is not None:
            raise Terminated(self._received)

    def ignore(self) -> None:
        """Ignores further signals, because the program is ending."""
        self._deferrals += 1

    def _end(self, number: int, _: FrameType | None) -> None:
        if self._received is None:
            self._received = number
            if not self._deferrals:
                raise Terminated(number)


def exit_status(interrupt: KeyboardInterrupt) -> int:
    """The exit status of a program that a signal ended, by the convention of shells."""
    return 128 + (interrupt.number if isinstance(interrupt, Terminated) else signal.SIGINT)


def end_processes(processes: Sequence[subprocess.Popen[bytes]], timeout: float) -> None:
    """Stops processes and their descendants: sends SIGINT to all, waits in reverse order, and kills the remaining ones.

    :param timeout: the wait for each process (s).
    """
    trees = [descendants(process.pid) if process.poll() is None else [] for process in processes]
    for process in processes:
        process.send_signal(signal.SIGINT)  # ignored by a process that has ended
    for process, descendant_ids in reversed(list(zip(processes, trees, strict=True))):
        try:
            process.wait(timeout)
        except subprocess.TimeoutExpired:
            descendant_ids += descendants(process.pid)
            process.kill()
        process.wait()
        _kill(descendant_ids)


def descendants(pid: int) -> list[int]:
    """The ids of all descendants of a process, without those that end meanwhile."""
    children: list[int] = []
    threads: list[Path] = []
    with contextlib.suppress(OSError):
        threads += Path(f"/proc/{pid}/task").iterdir()
    for thread in threads:
        with contextlib.suppress(OSError):
            children += map(int, (thread / "children").read_text().split())
    return children + [pid for child in children for pid in descendants(child)]


def _kill(pids: Sequence[int]) -> None:
    for pid in pids:
        with contextlib.suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)


def free_port() -> int:
    """A free port.

    :raises Refused: no free port was found.
    """
    for port in random.SystemRandom().sample(_PORTS, _TRIES):
        if is_free(port):
            return port
    raise Refused(f"none of {_TRIES} random ports from {_PORTS[0]} to {_PORTS[-1]} is free")


def is_free(port: int) -> bool:
    """Whether a server could bind the port."""
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind(("", port))
        except OSError:
            return False
    return True
