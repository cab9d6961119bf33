"""What a ROS master knows, asked without being a node, and without importing rospy."""

from __future__ import annotations

import socket
import urllib.parse
import xmlrpc.client
from typing import Any

import rosgraph

from skiros2_common.core.errors import SkirosError

#: How long a master or a server may take to take a call (s).
PATIENCE = 0.8


class NotThere(SkirosError):
    """There is no master, or not the node that is asked for."""


def ask_master(call: str, *arguments: Any) -> Any:
    """What the master answers to a call of its API; None when it knows no answer.

    :raises NotThere: no master answers.
    """
    uri = rosgraph.get_master_uri()
    before = socket.getdefaulttimeout()
    socket.setdefaulttimeout(PATIENCE)
    try:
        with xmlrpc.client.ServerProxy(uri) as master:
            code, _, value = getattr(master, call)("/command_line", *arguments)
    except (OSError, ValueError, xmlrpc.client.Error) as error:
        raise NotThere(f"no ROS master answers at {uri} ({_reason(error)}); start one, or set ROS_MASTER_URI") from None
    finally:
        socket.setdefaulttimeout(before)
    return value if code == 1 else None


def check_service(service: str, what: str) -> None:
    """Makes sure that a service is there and its node alive; it takes less than a second.

    :param what: whose service it is, for the message: "world model /wm".
    :raises NotThere: there is no master, or nobody on it who answers.
    """
    address = ask_master("lookupService", service)
    if not address:
        raise NotThere(f"there is no {what} on the master {rosgraph.get_master_uri()}")
    parts = urllib.parse.urlparse(str(address))
    try:
        socket.create_connection((parts.hostname, parts.port), PATIENCE).close()
    except OSError as error:
        raise NotThere(f"the {what} does not answer at {address} ({_reason(error)})") from None


def _reason(error: Exception) -> str:
    return str(getattr(error, "strerror", None) or error)
