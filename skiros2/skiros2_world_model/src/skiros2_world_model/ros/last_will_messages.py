"""Messages of the service `~last_will`."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import Any

import rospy
from rosgraph.network import parse_http_host_and_port

from skiros2_common.core.errors import WrongValue
from skiros2_common.ros.utils import deserializePropertyMap, serializePropertyMap
from skiros2_msgs import msg as msgs
from skiros2_msgs import srv as srvs
from skiros2_world_model.core.last_will import CleanupAction, LastWill, NodeProcess


def last_will_request(actions: Sequence[CleanupAction]) -> Any:
    """Creates a request of `WmLastWill` for the node of this process."""
    left = [
        msgs.WmBequest(b.key, b.value, b.relation, b.below, serializePropertyMap(b.properties)) for b in actions
    ]
    return srvs.WmLastWillRequest(rospy.get_name(), rospy.get_node_uri(), os.getpid(), left)


def msg2last_will(msg: Any) -> LastWill:
    """Converts a request of `WmLastWill` to a last will.

    :raises SkirosError: the request is invalid.
    """
    try:
        parse_http_host_and_port(msg.node_uri)
    except ValueError as error:
        text = f"the last will of {msg.owner!r}: node_uri is {msg.node_uri!r}, expected http://HOST:PORT/: {error}"
        raise WrongValue(text) from None
    actions = [
        CleanupAction(b.key, b.value, b.relation, b.below, deserializePropertyMap(b.properties)) for b in msg.bequests
    ]
    return LastWill(msg.owner, NodeProcess(msg.node_uri, msg.pid), actions)
