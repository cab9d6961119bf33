"""Processes and those that they started."""

from __future__ import annotations

import contextlib
import ctypes
import os
import signal
from pathlib import Path

_PR_SET_CHILD_SUBREAPER = 36  # of linux/prctl.h


def adopt_orphans() -> None:
    """Makes processes under this one, whose parent ends before them, children of this one (Linux).

    :raises OSError: the kernel refuses.
    """
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.prctl(_PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0) != 0:
        raise OSError(ctypes.get_errno(), "prctl(PR_SET_CHILD_SUBREAPER)")


def descendants(pid: int) -> list[int]:
    """The processes under one, children first, whatever session they are in (Linux)."""
    children: dict[int, list[int]] = {}
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            with contextlib.suppress(OSError, IndexError, ValueError):
                # The name, in parentheses, may hold anything; the parent is the second field after it.
                fields = (entry / "stat").read_text().rpartition(")")[2].split()
                children.setdefault(int(fields[1]), []).append(int(entry.name))
    found: list[int] = []
    waiting = [pid]
    while waiting:
        below = children.get(waiting.pop(), [])
        found += below
        waiting += below
    return found


def kill_tree(pid: int, itself: bool = True) -> None:
    """Ends a process's descendants, and with `itself` the process, at once. What is gone already does not matter.

    :param itself: False for a process that starts nothing meanwhile, such as the caller.
    """
    # All are stopped before the first is killed, so that none can start another that is not seen.
    stopped = [pid] if itself else []
    for child in stopped:
        _signal(child, signal.SIGSTOP)
    while new := [child for child in descendants(pid) if child not in stopped]:
        for child in new:
            _signal(child, signal.SIGSTOP)
        stopped += new
    for child in stopped:
        _signal(child, signal.SIGKILL)


def _signal(pid: int, number: signal.Signals) -> None:
    with contextlib.suppress(ProcessLookupError):
        os.kill(pid, number)
