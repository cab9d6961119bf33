"""Checks for a display, and virtual displays for programs that need one."""

from __future__ import annotations

import contextlib
import ctypes
import os
import shutil
import subprocess
from collections.abc import Iterator
from types import TracebackType
from typing import Self

from skiros2_common.core.errors import Refused


def display_problem() -> str:
    """Returns why no window can be shown here; "" if one can. Qt would abort the process."""
    platform = os.environ.get("QT_QPA_PLATFORM", "")
    if platform.partition(":")[0] not in ("", "xcb") or os.environ.get("WAYLAND_DISPLAY"):
        return ""
    display = os.environ.get("DISPLAY", "")
    if not display:
        return "there is no display to open the window on: DISPLAY is not set"
    try:
        x11 = ctypes.CDLL("libX11.so.6")
    except OSError:  # another platform plugin may work
        return ""
    x11.XOpenDisplay.restype = ctypes.c_void_p
    x11.XCloseDisplay.argtypes = [ctypes.c_void_p]
    opened = x11.XOpenDisplay(None)
    if not opened:
        return f"the display {display} (DISPLAY) cannot be opened"
    x11.XCloseDisplay(opened)
    return ""


class VirtualDisplay:
    """Runs Xvfb on a free display number; a context manager.

    :param size: width and height (pixels).
    """

    def __init__(self, size: tuple[int, int] = (1600, 1000)) -> None:
        self._size = size
        self._server: subprocess.Popen[bytes] | None = None
        #: The value of `DISPLAY`, such as `:101`.
        self.name = ""

    def __enter__(self) -> Self:
        """:raises Refused: Xvfb is not installed, or does not start."""
        if shutil.which("Xvfb") is None:
            raise Refused("there is no display, and Xvfb is not installed; install the package xvfb")
        width, height = self._size
        read, write = os.pipe()
        command = ["Xvfb", "-displayfd", str(write), "-screen", "0", f"{width}x{height}x24"]
        self._server = subprocess.Popen(
            [*command, "+extension", "GLX", "-nolisten", "tcp", "-noreset"],
            pass_fds=[write], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )  # fmt: skip
        os.close(write)
        with os.fdopen(read) as pipe:  # Xvfb writes its display number when it is ready
            number = pipe.readline().strip()
        if not number:
            raise Refused(f"Xvfb does not start: it ended with {self._server.wait()}")
        self.name = f":{number}"
        return self

    def __exit__(self, kind: type | None, error: BaseException | None, trace: TracebackType | None) -> None:
        if self._server is not None:
            self._server.terminate()
            self._server.wait()


@contextlib.contextmanager
def virtual_display() -> Iterator[None]:
    """Sets `DISPLAY` of this process and its children to a virtual display.

    :raises Refused: Xvfb is not installed, or does not start.
    """
    before = os.environ.get("DISPLAY")
    with VirtualDisplay() as display:
        os.environ["DISPLAY"] = display.name
        try:
            yield
        finally:
            if before is None:
                del os.environ["DISPLAY"]
            else:
                os.environ["DISPLAY"] = before
