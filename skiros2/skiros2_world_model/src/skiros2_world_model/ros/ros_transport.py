"""The transport to a world model node."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Sequence
from typing import Any

import rospy

from skiros2_common.core.errors import FOREIGN_ERRORS
from skiros2_common.core.operations import ONTOLOGY, SCENE, Operation, Outcome, Statement, snapshot_number
from skiros2_common.core.revision import local_revision
from skiros2_common.core.world_element import Element
from skiros2_common.ros.master_watch import watch_master
from skiros2_common.ros.utils import makeStatementMsg
from skiros2_msgs import msg as msgs
from skiros2_msgs import srv as srvs
from skiros2_world_model.core.ontology import ALIVE_QUERY, STRUCTURE_QUERY, Ontology
from skiros2_world_model.core.ontology_client import table
from skiros2_world_model.core.replica import Snapshot
from skiros2_world_model.core.scene import ROOT
from skiros2_world_model.core.transport import Listener
from skiros2_world_model.core.wm_errors import WmException
from skiros2_world_model.ros.server_calls import RosHistory, RosScene, RosServer, Services
from skiros2_world_model.ros.wire import msg2change, msg2shared_element, operation2msg

log = logging.getLogger(__name__)

#: The name of the world model's node, relative to the client's namespace.
SERVER = "wm"

#: No element has this label: the answer has the snapshot id only.
_NOTHING = msgs.WmElement(type="skiros:Scene", label="(none)")


class _ShutDown(WmException, rospy.ROSInterruptException):
    """The node was shut down while it waited; `run_node` ends it without a traceback."""


class RosTransport:
    """The transport to a world model node. It survives restarts of the node and of the ROS master.

    :param author: the author of the changes.
    :param node: the name of the node.
    """

    #: The version of the scene is unknown: each read is a call.
    version = -1

    def __init__(self, author: str, node: str = SERVER) -> None:
        watch_master()
        self.author = author
        self.services = Services(node)
        self.history = RosHistory(self.services)
        self.scene = RosScene(self.services, self.history, lambda: self.ontology)
        self.server = RosServer(self.services)
        #: Called with each `WmMonitor`, in the thread of the subscription, after the listeners.
        self.monitor_cb: Callable[[msgs.WmMonitor], None] | None = None
        self.ontology_version = 0
        self._listeners: list[Listener] = []
        self._index: Ontology | None = None
        self._index_lock = threading.Lock()
        self._last_snapshot_id = ""
        self._monitor: Any = None

    # -- following the node ------------------------------------------------------------------------------------

    def follow(self) -> None:
        """Waits until the node answers, and subscribes to its changes."""
        while not rospy.is_shutdown():
            try:
                self.server.query(ALIVE_QUERY, True, ONTOLOGY)
                break
            except WmException:
                log.info("waiting for the world model, node %s", rospy.resolve_name(self.services.node))
        else:
            raise _ShutDown("the node was shut down while it waited for the world model")
        self._monitor = rospy.Subscriber(f"{self.services.node}/monitor", msgs.WmMonitor, self._on_monitor)

    def unfollow(self) -> None:
        """Ends the subscription."""
        self._monitor.unregister()

    def subscribe(self, listener: Listener) -> None:
        self._listeners = [*self._listeners, listener]

    def unsubscribe(self, listener: Listener) -> None:
        self._listeners = [known for known in self._listeners if known != listener]

    def _on_monitor(self, message: msgs.WmMonitor) -> None:
        """Handles a `WmMonitor`; called in the thread of the subscription."""
        # After a missed message, assume that it concerned the ontologies.
        is_next = message.prev_snapshot_id == self._last_snapshot_id
        self._last_snapshot_id = message.snapshot_id
        if message.action == message.RESET or not (is_next and (message.elements or message.relation)):
            self._invalidate_ontology()
        listeners = self._listeners
        if listeners:
            change = msg2change(message, SCENE)
            for listener in listeners:
                _call_logged(listener, change)
        if self.monitor_cb is not None:
            _call_logged(self.monitor_cb, message)

    # -- reading -----------------------------------------------------------------------------------------------

    @property
    def ontology(self) -> Ontology:
        index = self._index
        while index is None:
            with self._index_lock:
                changes = self.ontology_version
                index = self._index or self.fetch_ontology()
                if changes == self.ontology_version:
                    self._index = index
        return index

    @property
    def snapshot_id(self) -> str:
        return self.services.elements(srvs.WmGetRequest.RESOLVE, SCENE, _NOTHING)[1]

    def revisions(self) -> None:
        """None: each read is a call."""

    def catch_up(self) -> None:
        """No effect: each read is a call."""

    def snapshot(self) -> tuple[list[Element], str]:
        action, root = srvs.WmGetRequest.GET_RECURSIVE, msgs.WmElement(id=ROOT)
        return self.services.elements(action, SCENE, root, "skiros:sceneProperty")

    def fetch(self) -> Snapshot:
        answer = self.services.snapshot.call(srvs.WmSnapshotRequest(SCENE))
        self._invalidate_ontology()  # the scene may use newer ontologies
        number = snapshot_number(answer.snapshot_id)
        return Snapshot(answer.snapshot_id, number, [msg2shared_element(m, number) for m in answer.elements])

    def fetch_ontology(self) -> Ontology:
        """Fetches the structure of the ontologies."""
        _, rows = table(self.server.query_json(STRUCTURE_QUERY, ONTOLOGY))
        return Ontology((subj, pred, obj) for subj, pred, obj in rows)

    def _invalidate_ontology(self) -> None:
        self.ontology_version += 1
        self._index = None
        local_revision.advance()

    # -- writing -----------------------------------------------------------------------------------------------

    def transact(self, operations: Sequence[Operation], context: str) -> Outcome:
        messages = [operation2msg(o) for o in operations]
        request = srvs.WmTransactionRequest(self.author, context, messages)
        response = self.services.transaction.call(request, repeatable=False)
        return Outcome(list(response.ids), [msg2change(m, context) for m in response.changes])

    def modify(self, statements: Sequence[Statement], context: str) -> None:
        request = srvs.WoModifyRequest(self.author, context, [makeStatementMsg(*s) for s in statements])
        self.services.modify.call(request, repeatable=True)  # idempotent
        self._invalidate_ontology()

    def load(self, filename: str, context: str) -> None:
        self.services.file(srvs.WoLoadAndSaveRequest.LOAD, filename, context)


def _call_logged(listener: Callable[[Any], None], change: Any) -> None:
    """Calls a listener. Its exception is logged: the other listeners get the change, too."""
    try:
        listener(change)
    except FOREIGN_ERRORS:
        log.exception("a listener failed on a change of the world model")
