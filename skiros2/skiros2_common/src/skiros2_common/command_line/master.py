"""What a ROS master knows, asked without being a node, and without importing rospy."""

from __future__ import annotations

import socket
import xmlrpc.client
from typing import Any

import rosgraph

from skiros2_common.core.errors import SkirosError
from skiros2_common.core.xmlrpc_errors import XMLRPC_ERRORS

#: How long a master or a node may take to answer (s).
TIMEOUT = 2.0


class Unavailable(SkirosError):
    """There is no master, or not the node that is asked for."""


def ask_master(call: str, *arguments: Any) -> Any:
    """What the master answers to a call of its API; None when it knows no answer.

    :raises Unavailable: no master answers.
    """
    uri = rosgraph.get_master_uri()
    try:
        return _ask(uri, call, *arguments)
    except XMLRPC_ERRORS as error:
        reason = _reason(error)
        raise Unavailable(f"no ROS master answers at {uri} ({reason}); start one, or set ROS_MASTER_URI") from None


def check_node(node: str, service: str, what: str) -> None:
    """Makes sure that a node is there, lives and offers a service.

    :param what: what the node is, for the message: "world model".
    :raises Unavailable: there is no master, or nobody on it who answers.
    """
    address = ask_master("lookupNode", node)
    if not address or not ask_master("lookupService", f"{node}/{service}"):
        raise Unavailable(f"there is no {what} {node} on the master {rosgraph.get_master_uri()}")
    try:
        # A connection to the service that says nothing would be reported by the node as a failed one.
        _ask(str(address), "getPid")
    except XMLRPC_ERRORS as error:
        raise Unavailable(f"the {what} {node} does not answer at {address} ({_reason(error)})") from None


def _ask(uri: str, call: str, *arguments: Any) -> Any:
    """The answer of a master or node; None when it is none."""
    before = socket.getdefaulttimeout()
    socket.setdefaulttimeout(TIMEOUT)
    try:
        with xmlrpc.client.ServerProxy(uri) as server:
            code, _, value = getattr(server, call)("/command_line", *arguments)
    finally:
        socket.setdefaulttimeout(before)
    return value if code == 1 else None


def _reason(error: Exception) -> str:
    return str(getattr(error, "strerror", None) or error)
