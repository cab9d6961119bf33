"""The service `~last_will`: stores the last wills of nodes and executes them when the nodes die; and its messages."""

from __future__ import annotations

import logging
import os
import threading
from collections.abc import Sequence

import rospy
from rosgraph.network import parse_http_host_and_port

from skiros2_common.core.errors import WrongValue
from skiros2_common.ros.utils import deserializePropertyMap, serializePropertyMap
from skiros2_msgs import msg as msgs
from skiros2_msgs import srv as srvs
from skiros2_world_model.core.last_will import CleanupAction, LastWill, LastWillStore, NodeProcess
from skiros2_world_model.ros.errors import service_handler
from skiros2_world_model.ros.node_watch import NodeWatch

log = logging.getLogger(__name__)


def last_will_request(actions: Sequence[CleanupAction]) -> srvs.WmLastWillRequest:
    """Creates a request of `WmLastWill` for the node of this process."""
    messages = [
        msgs.WmBequest(b.key, b.value, b.relation, b.below, serializePropertyMap(b.properties)) for b in actions
    ]
    return srvs.WmLastWillRequest(rospy.get_name(), rospy.get_node_uri(), os.getpid(), messages)


def msg2last_will(msg: srvs.WmLastWillRequest) -> LastWill:
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


class LastWillService:
    """The service, and a `NodeWatch` for each node with a last will, including those from the journal.

    :param wills: stores and executes the last wills.
    """

    def __init__(self, wills: LastWillStore) -> None:
        self._wills = wills
        self._watches: dict[str, tuple[NodeProcess, NodeWatch]] = {}
        self._lock = threading.Lock()
        with self._lock:
            for will in wills.all():
                self._watch(will).start()
        self._service = rospy.Service("~last_will", srvs.WmLastWill, service_handler(self._on_last_will))

    def _on_last_will(self, request: srvs.WmLastWillRequest) -> srvs.WmLastWillResponse:
        will = msg2last_will(request)
        with self._lock:
            if will.actions:
                self._wills.put(will)
                self._start_watch(will)
            else:
                self._wills.remove(will.owner)
                self._stop(will.owner)
        return srvs.WmLastWillResponse()

    def _start_watch(self, will: LastWill) -> None:
        """Starts watching the process of a last will, unless it is watched already."""
        process, watch = self._watches.get(will.owner, (None, None))
        if watch is not None and process == will.process and watch.is_alive():
            return
        watch = self._watch(will)
        try:
            watch.connect()
        except OSError as error:
            text = "%s cannot be reached at %s (%s): its last will is kept until a node of this name sets a new one"
            log.warning(text, will.owner, will.process.uri, error)
        else:
            watch.start()

    def _watch(self, will: LastWill) -> NodeWatch:
        self._stop(will.owner)
        owner, process = will.owner, will.process
        watch = NodeWatch(process.uri, process.pid, lambda: self._wills.execute(owner, process))
        self._watches[owner] = process, watch
        return watch

    def _stop(self, owner: str) -> None:
        if owner in self._watches:
            self._watches.pop(owner)[1].stop()
