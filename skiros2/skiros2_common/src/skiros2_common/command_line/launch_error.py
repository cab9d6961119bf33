"""Prints the reason of a failed launch as the last line, after the shutdown lines of roslaunch.

`repeat_after_roslaunch` runs this file as a program with the arguments PID TEXT, on the standard library only. It
prints "ready" to stdout, waits for the last line of the roslaunch process PID, and prints TEXT to its stderr.
"""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
import time
from pathlib import Path
from typing import NoReturn

#: The timeout for roslaunch to end (s); it gives its nodes at least 15 s.
_TIMEOUT = 60.0

#: The polling period (s); short, because the shell prints its prompt as soon as roslaunch ends.
_POLL_PERIOD = 0.002

#: The maximum number of generations from roslaunch to a node: a launch-prefix adds some.
_MAX_GENERATIONS = 4


def refuse(reason: object) -> NoReturn:
    """Ends a configuration check of a launch file: prints the reason in one line and exits with status 1."""
    sys.stderr.write(f"{reason}\n")
    sys.stderr.flush()
    repeat_after_roslaunch(str(reason))
    sys.exit(1)


def repeat_after_roslaunch(text: str) -> None:
    """Prints a text again after the end of the roslaunch that started this process, if there is one."""
    roslaunch = _roslaunch_ancestor()
    if roslaunch is None:
        return
    with contextlib.suppress(OSError):
        child = subprocess.Popen(
            [sys.executable, "-I", "-S", __file__, str(roslaunch), text],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,  # roslaunch reads stdout of a check to its end
            start_new_session=True,  # roslaunch ends the sessions of its nodes
        )
        assert child.stdout is not None
        child.stdout.readline()
        child.stdout.close()
        child.returncode = 0  # it is meant to outlive this process


def _roslaunch_ancestor() -> int | None:
    """The id of the roslaunch process among the ancestors of this process."""
    pid = os.getpid()
    with contextlib.suppress(OSError, ValueError):
        for _ in range(_MAX_GENERATIONS):
            pid = int(Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[1])
            words = Path(f"/proc/{pid}/cmdline").read_bytes().split(b"\0")[:2]
            if any(os.path.basename(word) == b"roslaunch" for word in words):
                return pid
    return None


def _wait(pid: int) -> None:
    """Waits until the process has ended or has logged its final traceback, which it does after its last line."""
    log = _log_of(pid)
    deadline = time.monotonic() + _TIMEOUT
    while _runs(pid) and time.monotonic() < deadline:
        if log is not None and _has_traceback(*log):
            return
        time.sleep(_POLL_PERIOD)


def _runs(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def _log_of(pid: int) -> tuple[Path, int] | None:
    """The log file of a roslaunch process, and its size (bytes)."""
    with contextlib.suppress(OSError):
        for entry in Path(f"/proc/{pid}/fd").iterdir():
            target = Path(os.readlink(entry))
            if target.name.startswith("roslaunch-") and target.suffix == ".log":
                return target, target.stat().st_size
    return None


def _has_traceback(log: Path, start: int) -> bool:
    with contextlib.suppress(OSError), log.open("rb") as lines:
        lines.seek(start)
        return b"Traceback" in lines.read()
    return False


def _screen_of(pid: int) -> int:
    """A file descriptor of a process's stderr; this process's stderr if that cannot be opened (a socket)."""
    try:
        return os.open(f"/proc/{pid}/fd/2", os.O_WRONLY | os.O_APPEND)
    except OSError:
        return 2


def _main(pid: int, text: str) -> None:
    screen = _screen_of(pid)
    os.write(1, b"ready\n")
    os.close(1)
    _wait(pid)
    with contextlib.suppress(OSError):
        os.write(screen, f"{text}\n".encode())


if __name__ == "__main__":
    _main(int(sys.argv[1]), sys.argv[2])
