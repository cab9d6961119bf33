"""Checks for a display; selects the window for launch files, and keeps its node alive."""

from __future__ import annotations

import ctypes
import os
import signal
import subprocess
from importlib.util import find_spec

import rospkg


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


def missing_binding() -> str:
    """Returns which module the window lacks; "" if none. Debian 13 has no package of it."""
    return "" if find_spec("python_qt_binding") else "the Python module python_qt_binding is not installed"


def rqt_command() -> list[str] | None:
    """Returns the command that opens the window in rqt; None if rqt is not installed."""
    if find_spec("rqt_gui_py") is None:
        return None
    try:
        rospkg.RosPack().get_path("rqt_gui")
    except rospkg.ResourceNotFound:
        return None
    return ["rosrun", "rqt_gui", "rqt_gui", "-s", "gui.skiros"]


def launch(standalone: list[str]) -> int:
    """Opens the window for a launch file: in rqt if it is installed, else with the given command.

    Returns the exit status if the window has failed, so that roslaunch restarts it. Without a display, and after the
    user has closed the window, it logs one line and sleeps until the end of the launch: roslaunch would open the window
    again otherwise.
    """
    if why := missing_binding() or display_problem():
        _wait(f"{why}; everything else runs without the window")
    interrupts: list[int] = []
    signal.signal(signal.SIGINT, lambda number, _: interrupts.append(number))  # the window receives it too
    status = subprocess.call(rqt_command() or standalone)
    if status == 0 and not interrupts:
        _wait("the window was closed; to open it again: rosrun skiros2_gui skiros_gui")
    return status


def _wait(line: str) -> None:
    os.write(1, f"skiros2_gui: {line}\n".encode())
    os.execvp("sleep", ["sleep", "infinity"])
