"""The running world model, for a command that asks it once."""

from __future__ import annotations

from typing import Any

import rosgraph

from skiros2_common.command_line.master import check_node


def connect(name: str, author: str, computing: bool = False) -> Any:
    """The world model node of that name, once it is known to be there; not followed, and not waited for.

    :param name: relative to the namespace of this process (`ROS_NAMESPACE`).
    :param author: who makes the changes.
    :param computing: whether relations that reasoners compute are asked for; the server's reasoners are loaded then.
    :raises Unavailable: nobody answers; it takes seconds at most to say so.
    """
    full = rosgraph.names.ns_join(rosgraph.names.get_ros_namespace(), name)
    check_node(full, "get", "world model")
    import rospy  # takes a quarter of a second, which is lost when there is no master

    from skiros2_world_model.ros.world_model_interface import WorldModelInterface, load_reasoners

    class OneShotInterface(WorldModelInterface):
        _server = full

        def _wait_for_server(self) -> None:
            """It was there a moment ago."""

        def _follow(self) -> None:
            """Changes, and what reasoners compute, are of no interest to one command."""

    if rosgraph.names.is_legal_base_name(author):
        rospy.names._set_caller_id(f"/{author}")  # a call or two need no node, but the server tells who loads a file
    if computing:
        load_reasoners(full)
    return OneShotInterface(author)
