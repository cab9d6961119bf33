"""The adapter of the ontology port over ROS."""

from __future__ import annotations

import logging
import threading
from collections.abc import Sequence

import rospy
from std_srvs.srv import SetBool, SetBoolRequest

from skiros2_common.core.revision import local_revision
from skiros2_common.ros.master_watch import watch_master
from skiros2_common.ros.utils import makeStatementMsg
from skiros2_msgs import msg as msgs
from skiros2_msgs import srv as srvs
from skiros2_world_model.core.changes import ONTOLOGY, Statement
from skiros2_world_model.core.ontology import ALIVE_QUERY, STRUCTURE_QUERY, Ontology
from skiros2_world_model.core.ontology_client import OntologyAbstractInterface, table
from skiros2_world_model.core.world_model_abstract_interface import WmException
from skiros2_world_model.ros.service_pool import LONG_ANSWER, ServicePool

log = logging.getLogger(__name__)

#: The name of the world model's node, relative to the client's namespace.
SERVER = "wm"


class _ShutDown(WmException, rospy.ROSInterruptException):
    """The node was shut down while it waited; `run_node` ends it without a traceback."""


class OntologyInterface(OntologyAbstractInterface):
    """The ontologies, and the RDF view of all contexts, of the node `wm` in this node's namespace.

    The constructor blocks until the server answers. The interface survives restarts of the server and the ROS master.

    :param author_name: the author of the changes.
    """

    #: The name of the server's node.
    _server = SERVER

    def __init__(self, author_name: str = "test") -> None:
        watch_master()
        super().__init__()
        self._author_name = author_name
        self._query_service = ServicePool(f"{self._server}/ontology/query", srvs.WoQuery)
        self._sparql_service = ServicePool(f"{self._server}/ontology/sparql", srvs.WmSparql)
        self._modify_service = ServicePool(f"{self._server}/ontology/modify", srvs.WoModify)
        files = f"{self._server}/load_and_save"
        self._file_service = ServicePool(files, srvs.WoLoadAndSave, answer_timeout=LONG_ANSWER)
        self._lock_service = ServicePool(f"{self._server}/lock", SetBool, answer_timeout=None)
        self._index: Ontology | None = None
        self._index_lock = threading.Lock()
        self._ontology_changes = 0
        self._last_snapshot_id = ""
        self._wait_for_server()
        self._follow()

    def is_connected(self) -> bool:
        return self._query_service.is_there()

    def lock(self) -> bool:
        answer = self._lock_service.call(SetBoolRequest(True))
        if not answer.success:
            raise WmException(f"the world model cannot be locked: {answer.message}")
        return True

    def unlock(self) -> bool:
        return bool(self._lock_service.call(SetBoolRequest(False)).success)

    def load(self, filename: str = "", context: str = "scene") -> bool:
        return self._files(srvs.WoLoadAndSaveRequest.LOAD, filename, context)

    def save(self, filename: str = "", context: str = "scene") -> bool:
        return self._files(srvs.WoLoadAndSaveRequest.SAVE, filename, context)

    # -- the primitives of `OntologyAbstractInterface` ---------------------------------------------------------

    @property
    def _ontology(self) -> Ontology:
        index = self._index
        while index is None:
            with self._index_lock:
                changes = self._ontology_changes
                index = self._index or self._fetch_ontology()
                if changes == self._ontology_changes:
                    self._index = index
        return index

    def _query(self, query: str, cut_prefix: bool, context: str) -> list[str]:
        request = srvs.WoQueryRequest(query, context, cut_prefix)
        return list(self._query_service.call(request).answer)

    def _query_json(self, query: str, context: str) -> str:
        return str(self._sparql_service.call(srvs.WmSparqlRequest(query, context)).json)

    def _modify(self, statements: Sequence[Statement], context: str) -> None:
        request = srvs.WoModifyRequest(self._author_name, context, [makeStatementMsg(*s) for s in statements])
        self._modify_service.call(request, repeatable=True)  # idempotent
        self._invalidate_ontology()

    def _follow(self) -> None:
        """Subscribes to the changes of the server."""
        self._monitor = rospy.Subscriber(f"{self._server}/monitor", msgs.WmMonitor, self._on_monitor)

    def _on_monitor(self, message: msgs.WmMonitor) -> None:
        """Handles a `WmMonitor`; called in the thread of the subscription."""
        # After a missed message, assume that it concerned the ontologies.
        is_next = message.prev_snapshot_id == self._last_snapshot_id
        self._last_snapshot_id = message.snapshot_id
        if message.action == message.RESET or not (is_next and (message.elements or message.relation)):
            self._invalidate_ontology()

    def _invalidate_ontology(self) -> None:
        self._ontology_changes += 1
        self._index = None
        local_revision.advance()

    def _fetch_ontology(self) -> Ontology:
        _, rows = table(self._query_json(STRUCTURE_QUERY, ONTOLOGY))
        return Ontology((subj, pred, obj) for subj, pred, obj in rows)

    def _files(self, action: str, filename: str, context: str) -> bool:
        return bool(self._file_service.call(srvs.WoLoadAndSaveRequest(action, filename, context), repeatable=False).ok)

    def _wait_for_server(self) -> None:
        waited = 0.0
        while not rospy.is_shutdown():
            try:
                self._query(ALIVE_QUERY, True, ONTOLOGY)
                return
            except WmException:
                waited += self._query_service.timeout
                log.info("waiting for the world model, node %s", rospy.resolve_name(self._server))
        raise _ShutDown("the node was shut down while it waited for the world model")
