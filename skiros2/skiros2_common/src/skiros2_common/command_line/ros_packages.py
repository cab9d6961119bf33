"""Finds the folders of ROS packages; also where ROS is not installed."""

from __future__ import annotations

from pathlib import Path


def package_folder(name: str) -> Path | None:
    """Returns the folder of a ROS package; None if there is no such package, or no ROS."""
    try:
        import rospkg
    except ModuleNotFoundError:
        return None
    try:
        return Path(rospkg.RosPack().get_path(name))
    except rospkg.ResourceNotFound:
        return None
