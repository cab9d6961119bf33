"""Ends a launch with a reason, which is printed as the last line, after the shutdown lines of roslaunch."""

from __future__ import annotations

import contextlib
import os
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path
from typing import NoReturn

#: The maximum number of generations from roslaunch to a node: a launch-prefix adds some.
_MAX_GENERATIONS = 4

#: The variable in which `launch/node.sh` names the process of roslaunch.
_LAUNCHED_BY = "SKIROS2_LAUNCHED_BY"
#: The time that roslaunch has to end this process (s).
_GRACE_PERIOD = 60.0

#: Prints the text $2 when the process $1 has ended, at the latest after a minute; roslaunch gives its nodes 15 s.
_PRINT_AT_END = """
tries=6000
while [ $tries -gt 0 ] && { read -r _ _ state _ <"/proc/$1/stat"; } 2>/dev/null && [ "$state" != Z ]; do
    tries=$((tries - 1))
    sleep 0.01
done
printf '%s\\n' "$2" >&2
"""


def refuse(reason: object) -> NoReturn:
    """Ends a configuration check of a launch file: prints the reason in one line and exits with status 1."""
    sys.stderr.write(f"{reason}\n")
    sys.stderr.flush()
    repeat_after_roslaunch(str(reason))
    sys.exit(1)


def repeat_after_roslaunch(text: str) -> None:
    """Prints a text again after the end of the roslaunch that started this process, if there is one."""
    pid = os.getpid()
    with contextlib.suppress(OSError, ValueError):
        for _ in range(_MAX_GENERATIONS):
            pid = int(Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[1])
            words = Path(f"/proc/{pid}/cmdline").read_bytes().split(b"\0")[:2]
            if any(os.path.basename(word) == b"roslaunch" for word in words):
                _print_at_end(pid, text)
                return


def _print_at_end(pid: int, text: str) -> None:
    """Starts a process that prints a text on the screen of another process when that has ended."""
    try:
        screen = os.open(f"/proc/{pid}/fd/2", os.O_WRONLY | os.O_APPEND)
    except OSError:  # a socket
        screen = os.dup(2)
    child = subprocess.Popen(
        ["sh", "-c", _PRINT_AT_END, "launch_error", str(pid), text],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,  # roslaunch reads stdout of a check to its end
        stderr=screen,
        start_new_session=True,  # roslaunch ends the sessions of its nodes
    )
    os.close(screen)
    child.returncode = 0  # it is meant to outlive this process


def launched_by() -> int:
    """The process id of the roslaunch that would start this process again; 0 if there is none."""
    parent = os.getppid()
    return parent if os.environ.get(_LAUNCHED_BY) == str(parent) else 0


def end_launch() -> None:
    """Ends the launch of this process and waits for its own end. No effect outside a launch. For the main thread."""
    parent = launched_by()
    if parent:
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, signal.SIG_DFL)
        os.kill(parent, signal.SIGINT)
        time.sleep(_GRACE_PERIOD)  # were this process gone earlier, roslaunch would start it again


def speak_for_launch() -> socket.socket | None:
    """Returns a socket if this is the first process of its launch that calls this; keep it until the launch has ended.

    Nodes that end their launch for the same reason so print it once.
    """
    claim = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    try:
        claim.bind(f"\0skiros2-launch-{os.getppid()}")
    except OSError:
        claim.close()
        return None
    return claim
