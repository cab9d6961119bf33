"""Which window there is to open. The launch files start this with `gui:=true`."""

from __future__ import annotations

import os
from importlib.util import find_spec

import rospkg


def window_command() -> list[str] | None:
    """The command that opens the window as an rqt plugin; None where rqt or the plugin is not installed."""
    if find_spec("skiros2_gui.gui") is None:
        return None
    try:
        rospkg.RosPack().get_path("rqt_gui")
    except rospkg.ResourceNotFound:
        return None
    return ["rosrun", "rqt_gui", "rqt_gui", "-s", "gui.skiros"]


def main() -> None:
    """Becomes the window. Where there is none it says so and waits, because roslaunch would start it anew."""
    command = window_command()
    if command is None:
        print("skiros2_gui: no window is installed; everything else runs without it", flush=True)
        command = ["sleep", "infinity"]
    os.execvp(command[0], command)
