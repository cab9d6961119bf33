"""Queries of the ROS master without a node and without importing rospy."""

from __future__ import annotations

import http.client
import socket
import xmlrpc.client
from typing import Any
from xml.parsers.expat import ExpatError

from skiros2_common.command_line.command import Unavailable

#: The exceptions of a failed XML-RPC call: no server answers, or another kind of server does.
XMLRPC_ERRORS = (OSError, ValueError, http.client.HTTPException, xmlrpc.client.Error, ExpatError)

#: The timeout for a response of a master or node (s).
TIMEOUT = 2.0


def ask_master(call: str, *arguments: Any) -> Any:
    """The result of a call of the master's API; None if the call fails.

    :raises Unavailable: no master answers.
    """
    uri = master_uri()
    try:
        return ask_node(uri, call, *arguments)
    except XMLRPC_ERRORS as error:
        reason = _reason(error)
        raise Unavailable(f"no ROS master answers at {uri} ({reason}); start one, or set ROS_MASTER_URI") from None


def master_uri() -> str:
    """The address of the master that the environment names."""
    import rosgraph  # not there without ROS

    return str(rosgraph.get_master_uri())


def check_node(node: str, service: str, what: str) -> None:
    """Checks that a node runs and offers a service.

    :param what: the kind of node for the message: "world model".
    :raises Unavailable: the master or the node does not answer.
    """
    address = ask_master("lookupNode", node)
    if not address or not ask_master("lookupService", f"{node}/{service}"):
        raise Unavailable(f"there is no {what} {node} on the master {master_uri()}")
    try:
        # A probe connection to the service would make the node report a failed connection.
        ask_node(str(address), "getPid")
    except XMLRPC_ERRORS as error:
        raise Unavailable(f"the {what} {node} does not answer at {address} ({_reason(error)})") from None


def ask_node(uri: str, call: str, *arguments: Any) -> Any:
    """The result of a call of a node's or the master's API; None if the call fails.

    :raises XMLRPC_ERRORS: nothing answers there.
    """
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
