"""Selects the window for launch files, and keeps its node alive."""

from __future__ import annotations

import os
import signal
import subprocess
from importlib.util import find_spec

import rospkg

from skiros2_gui.display import display_problem


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
    if why := display_problem():
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
