"""Stopping child processes and their descendants."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
from collections.abc import Sequence
from pathlib import Path


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
    """The ids of all descendants of a process."""
    children: list[int] = []
    for file in Path(f"/proc/{pid}/task").glob("*/children"):  # of each thread
        with contextlib.suppress(OSError):
            children += map(int, file.read_text().split())
    return children + [pid for child in children for pid in descendants(child)]


def _kill(pids: Sequence[int]) -> None:
    for pid in pids:
        with contextlib.suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)
