"""Shows why a launch was refused as its last line, below the lines that roslaunch itself prints when it ends.

Run as a program by `repeat_after_roslaunch`, on the standard library alone: PID TEXT. Says "ready" on stdout, waits
until the roslaunch process of that id has printed its last line, and prints the text where that process printed.
"""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
import time
from pathlib import Path
from typing import NoReturn

#: How long roslaunch may take to end (s); it gives its nodes 15 s and more.
_PATIENCE = 60.0

#: How often it is looked at (s): a shell shows its prompt as soon as roslaunch has ended.
_PERIOD = 0.002

#: How many processes may lie between a node and roslaunch: a launch-prefix and what it starts.
_MOST_BETWEEN = 4


def refuse(reason: object) -> NoReturn:
    """Ends a program that checks the configuration for a launch file: with the reason, in one line, and status 1."""
    sys.stderr.write(f"{reason}\n")
    sys.stderr.flush()
    repeat_after_roslaunch(str(reason))
    sys.exit(1)


def repeat_after_roslaunch(text: str) -> None:
    """Has a text printed once more when the roslaunch that started this process has ended; without one nothing."""
    roslaunch = _roslaunch_above()
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
        child.returncode = 0  # it outlives this process on purpose


def _roslaunch_above() -> int | None:
    """The id of the roslaunch process that this process descends from."""
    pid = os.getpid()
    with contextlib.suppress(OSError, ValueError):
        for _ in range(_MOST_BETWEEN):
            pid = int(Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[1])
            words = Path(f"/proc/{pid}/cmdline").read_bytes().split(b"\0")[:2]
            if any(os.path.basename(word) == b"roslaunch" for word in words):
                return pid
    return None


def _wait(pid: int) -> None:
    """Returns when the process has ended, or has written the traceback of its end into its log file: it does so after
    its last line."""
    log = _log_of(pid)
    deadline = time.monotonic() + _PATIENCE
    while _runs(pid) and time.monotonic() < deadline:
        if log is not None and _has_traceback(*log):
            return
        time.sleep(_PERIOD)


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
    """Where a process prints its errors, opened; where that is impossible (a socket), where this one does."""
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
