"""The running world model, for a command that asks it once."""

from __future__ import annotations

import socket
import urllib.parse
import xmlrpc.client
from typing import Any

import rosgraph

from skiros2_common.core.errors import SkirosError

#: How long a master or a server may take to take a call (s).
_PATIENCE = 0.8


class NotThere(SkirosError):
    """There is no master, or no world model on it."""


def connect(name: str, author: str) -> Any:
    """The world model node of that name, once it is known to be there; not followed, and not waited for.

    :param name: relative to the namespace of this process (`ROS_NAMESPACE`).
    :param author: who makes the changes.
    :raises NotThere: nobody answers; it takes less than a second to say so.
    """
    full = rosgraph.names.ns_join(rosgraph.names.get_ros_namespace(), name)
    _check(full)
    import rospy  # takes a quarter of a second, which is lost when there is no master

    from skiros2_world_model.ros.world_model_interface import WorldModelInterface

    class OnceAsked(WorldModelInterface):
        _server = full

        def _wait_for_server(self) -> None:
            """It was there a moment ago."""

        def _follow(self) -> None:
            """Changes, and what reasoners compute, are of no interest to one command."""

    if rosgraph.names.is_legal_base_name(author):
        rospy.names._set_caller_id(f"/{author}")  # a call or two need no node, but the server tells who loads a file
    return OnceAsked(author)


def _check(name: str) -> None:
    uri = rosgraph.get_master_uri()
    try:
        service = _lookup(uri, f"{name}/get")
    except (OSError, ValueError, xmlrpc.client.Error) as error:
        raise NotThere(f"no ROS master answers at {uri} ({_reason(error)}); start one, or set ROS_MASTER_URI") from None
    if not service:
        raise NotThere(f"there is no world model {name} on the master {uri}")
    address = urllib.parse.urlparse(service)
    try:
        socket.create_connection((address.hostname, address.port), _PATIENCE).close()
    except OSError as error:
        raise NotThere(f"the world model {name} does not answer at {service} ({_reason(error)})") from None


def _lookup(uri: str, service: str) -> str:
    """The address of a service; "" when there is none."""
    before = socket.getdefaulttimeout()
    socket.setdefaulttimeout(_PATIENCE)
    try:
        with xmlrpc.client.ServerProxy(uri) as master:
            code, _, address = master.lookupService("/wm_command", service)  # type: ignore[misc, str-unpack]
    finally:
        socket.setdefaulttimeout(before)
    return str(address) if code == 1 else ""


def _reason(error: Exception) -> str:
    return str(getattr(error, "strerror", None) or error)
