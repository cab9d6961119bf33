"""Whether a window can be drawn here; and a screen that nobody sees, for programs that need one where it cannot."""

from __future__ import annotations

import contextlib
import ctypes
import os
import shutil
import subprocess
from collections.abc import Iterator

from skiros2_common.core.errors import Refused

#: Of the screen (pixels).
WIDTH, HEIGHT = 1600, 1000


def display_trouble() -> str:
    """Why no window can be drawn here, in words; "" where one can. Qt itself ends the program with a crash."""
    platform = os.environ.get("QT_QPA_PLATFORM", "")
    if platform.partition(":")[0] not in ("", "xcb") or os.environ.get("WAYLAND_DISPLAY"):
        return ""
    display = os.environ.get("DISPLAY", "")
    if not display:
        return "there is no display to open the window on: DISPLAY is not set"
    try:
        x11 = ctypes.CDLL("libX11.so.6")
    except OSError:  # Qt may do without it
        return ""
    x11.XOpenDisplay.restype = ctypes.c_void_p
    x11.XCloseDisplay.argtypes = [ctypes.c_void_p]
    opened = x11.XOpenDisplay(None)
    if not opened:
        return f"the display {display} (DISPLAY) cannot be opened"
    x11.XCloseDisplay(opened)
    return ""


@contextlib.contextmanager
def virtual_display() -> Iterator[str]:
    """Runs Xvfb, and has `DISPLAY` of this process and of its children name its screen meanwhile.

    :raises Refused: Xvfb is not installed, or does not start.
    """
    if shutil.which("Xvfb") is None:
        raise Refused("there is no display, and no Xvfb to stand in for one; install the package xvfb")
    before = os.environ.get("DISPLAY")
    read, write = os.pipe()
    command = ["Xvfb", "-displayfd", str(write), "-screen", "0", f"{WIDTH}x{HEIGHT}x24", "-nolisten", "tcp"]
    process = subprocess.Popen(
        [*command, "+extension", "GLX"], pass_fds=[write], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    os.close(write)
    try:
        with os.fdopen(read) as told:  # the number of a free screen, once it is ready; nothing when it ends
            number = told.readline().strip()
        if not number:
            raise Refused(f"Xvfb does not start: it ended with {process.wait()}")
        os.environ["DISPLAY"] = f":{number}"
        yield os.environ["DISPLAY"]
    finally:
        if before is None:
            os.environ.pop("DISPLAY", None)
        else:
            os.environ["DISPLAY"] = before
        process.terminate()
        process.wait()
