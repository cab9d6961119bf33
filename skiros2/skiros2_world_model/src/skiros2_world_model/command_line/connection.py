"""The connection of a command to a running world model."""

from __future__ import annotations

from typing import Any

import rosgraph

from skiros2_common.command_line.master import check_node


def connect(name: str, author: str, computing: bool = False) -> Any:
    """Connects to a running world model node, without subscribing to its changes.

    :param name: relative to the namespace of this process (`ROS_NAMESPACE`).
    :param author: the author of the changes.
    :param computing: loads the server's reasoners, for relations that they compute.
    :raises Unavailable: the node does not answer within a few seconds.
    """
    full = rosgraph.names.ns_join(rosgraph.names.get_ros_namespace(), name)
    check_node(full, "get", "world model")
    import rospy  # slow to import, so only after the check

    from skiros2_world_model.ros.world_model_interface import WorldModelInterface, load_reasoners

    class OneShotInterface(WorldModelInterface):
        _server = full

        def _wait_for_server(self) -> None:
            """`check_node` has found the server."""

        def _follow(self) -> None:
            """A single command needs no updates."""

    if rosgraph.names.is_legal_base_name(author):
        rospy.names._set_caller_id(f"/{author}")  # no node is started, but the server logs this name
    if computing:
        load_reasoners(full)
    return OneShotInterface(author)
