"""Whether the ROS master answers, asked with a time limit, and without being a node."""

from __future__ import annotations

import http.client
import xmlrpc.client
from typing import Any

import rosgraph

from skiros2_common.core.xmlrpc_errors import XMLRPC_ERRORS

#: How long the master may take to answer (s).
PATIENCE = 2.0


class _Transport(xmlrpc.client.Transport):
    """With a time limit, which Python's own has not."""

    def make_connection(self, host: Any) -> http.client.HTTPConnection:
        connection = super().make_connection(host)
        connection.timeout = PATIENCE
        return connection


def master_answers() -> bool:
    """Whether the master that `ROS_MASTER_URI` names answers. Takes `PATIENCE` at most, but for the name's lookup."""
    try:
        with xmlrpc.client.ServerProxy(rosgraph.get_master_uri(), transport=_Transport()) as master:
            return bool(master.getPid("/skiros_gui")[0] == 1)
    except (*XMLRPC_ERRORS, TypeError, IndexError):  # or somebody else listens there
        return False
