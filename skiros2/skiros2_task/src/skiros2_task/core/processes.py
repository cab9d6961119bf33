"""Process trees (Linux)."""

from __future__ import annotations

import contextlib
import ctypes
import os
import signal
from pathlib import Path

_PR_SET_CHILD_SUBREAPER = 36  # of linux/prctl.h


def adopt_orphans() -> None:
    """Makes this process the parent of its orphaned descendants.

    :raises OSError: prctl failed.
    """
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.prctl(_PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0) != 0:
        raise OSError(ctypes.get_errno(), "prctl(PR_SET_CHILD_SUBREAPER)")


def descendants(pid: int) -> list[int]:
    """Returns the descendants of a process in all sessions, parents first."""
    children: dict[int, list[int]] = {}
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            with contextlib.suppress(OSError, IndexError, ValueError):
                # The name in parentheses may contain any character; the parent is the second field after it.
                fields = (entry / "stat").read_text().rpartition(")")[2].split()
                children.setdefault(int(fields[1]), []).append(int(entry.name))
    found: list[int] = []
    waiting = [pid]
    while waiting:
        new = children.get(waiting.pop(), [])
        found += new
        waiting += new
    return found


def kill_tree(pid: int, itself: bool = True) -> None:
    """Kills a process with all its descendants. Processes that have ended are ignored.

    :param itself: whether to kill the process too. If not, it must not start processes meanwhile.
    """
    # All are stopped before the first is killed, so that none starts another one unseen.
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
