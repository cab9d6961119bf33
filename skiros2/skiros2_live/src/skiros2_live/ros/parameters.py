"""The parameters of a cell that views need: descriptions of robots, and folders with meshes."""

from __future__ import annotations

import rospy


def robot_descriptions() -> dict[str, tuple[str, str]]:
    """Returns each parameter `robot_description` by name, with the `tf_prefix` beside it. Calls the master.

    :raises OSError: the master does not answer.
    :raises rospy.ROSException: it refuses.
    """
    names = [name for name in rospy.get_param_names() if name.rpartition("/")[2] == "robot_description"]
    return {
        name: (str(rospy.get_param(name, "")), str(rospy.get_param(f"{name.rpartition('/')[0]}/tf_prefix", "")))
        for name in names
    }


def mesh_folders() -> list[str]:
    """Returns the folders searched for meshes: the workspace of the world model. Calls the master."""
    try:
        folder = rospy.get_param("wm/workspace_dir", "")
    except (OSError, rospy.ROSException):
        return []  # without a master only absolute paths are found
    return [folder] if isinstance(folder, str) and folder else []
