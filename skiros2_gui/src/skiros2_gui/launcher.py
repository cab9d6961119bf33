"""Which window there is to open."""

from __future__ import annotations

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
