"""Processes that a program has started, and their end."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
from collections.abc import Sequence
from pathlib import Path


def end_processes(processes: Sequence[subprocess.Popen[bytes]], timeout: float) -> None:
    """Ends processes and all that they have started: asks all, waits for the last one first, and kills what stays.

    :param timeout: how long each is waited for (s).
    """
    families = [descendants(process.pid) if process.poll() is None else [] for process in processes]
    for process in processes:
        process.send_signal(signal.SIGINT)  # no harm to one that has ended
    for process, family in reversed(list(zip(processes, families, strict=True))):
        try:
            process.wait(timeout)
        except subprocess.TimeoutExpired:
            family += descendants(process.pid)
            process.kill()
        process.wait()
        _kill(family)


def descendants(pid: int) -> list[int]:
    """The processes that a process has started, and those that these have."""
    try:
        children = [int(child) for child in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]
    except OSError:
        return []
    return children + [below for child in children for below in descendants(child)]


def _kill(pids: Sequence[int]) -> None:
    for pid in pids:
        with contextlib.suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)
