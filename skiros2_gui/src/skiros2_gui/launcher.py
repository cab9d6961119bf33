"""Which window there is to open, and how it behaves in a launch file."""

from __future__ import annotations

import os
import signal
import subprocess
from importlib.util import find_spec

import rospkg

from skiros2_gui.display import display_trouble


def rqt_command() -> list[str] | None:
    """The command that opens the window as an rqt plugin; None where rqt is not installed."""
    if find_spec("rqt_gui_py") is None:
        return None
    try:
        rospkg.RosPack().get_path("rqt_gui")
    except rospkg.ResourceNotFound:
        return None
    return ["rosrun", "rqt_gui", "rqt_gui", "-s", "gui.skiros"]


def launch(standalone: list[str]) -> int:
    """Opens the window for a launch file: as an rqt plugin where rqt is installed, else by the command given.

    Returns what the launch file's node is to end with, after the window has failed (then it is started anew). Where
    there is no display, and once the window has been closed, it does not return: a line says so, and it waits for the
    end of the launch, because roslaunch would open the window again at once.
    """
    if why := display_trouble():
        _wait(f"{why}; everything else runs without the window")
    interrupts: list[int] = []
    signal.signal(signal.SIGINT, lambda number, _: interrupts.append(number))  # the window gets it too, and ends
    status = subprocess.call(rqt_command() or standalone)
    if status == 0 and not interrupts:
        _wait("the window was closed; to open it again: rosrun skiros2_gui skiros_gui")
    return status


def _wait(line: str) -> None:
    os.write(1, f"skiros2_gui: {line}\n".encode())
    os.execvp("sleep", ["sleep", "infinity"])
