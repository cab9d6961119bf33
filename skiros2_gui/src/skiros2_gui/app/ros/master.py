"""Checks with a timeout whether the ROS master answers; needs no node."""

from __future__ import annotations

import http.client
import xmlrpc.client
from typing import Any

import rosgraph

from skiros2_common.command_line.master import XMLRPC_ERRORS

#: s.
TIMEOUT = 2.0


class _Transport(xmlrpc.client.Transport):
    """An XML-RPC transport with a timeout."""

    def make_connection(self, host: Any) -> http.client.HTTPConnection:
        connection = super().make_connection(host)
        connection.timeout = TIMEOUT
        return connection


def master_answers() -> bool:
    """Returns whether the master at `ROS_MASTER_URI` answers within `TIMEOUT` (name resolution not included)."""
    try:
        with xmlrpc.client.ServerProxy(rosgraph.get_master_uri(), transport=_Transport()) as master:
            return bool(master.getPid("/skiros_gui")[0] == 1)
    except (*XMLRPC_ERRORS, TypeError, IndexError):  # the last two: not a master
        return False
