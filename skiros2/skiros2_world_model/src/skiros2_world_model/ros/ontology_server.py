"""The services of ontologies: queries, statements, and the advisory lock."""

from __future__ import annotations

import logging
import socket
from collections.abc import Sequence
from typing import Protocol

import rosgraph
import rospy
from std_srvs.srv import SetBool, SetBoolRequest, SetBoolResponse

from skiros2_common.ros.node import spin
from skiros2_msgs import srv as srvs
from skiros2_world_model.core.changes import Statement
from skiros2_world_model.core.coordination import AdvisoryLock
from skiros2_world_model.core.knowledge_base import KnowledgeBase
from skiros2_world_model.ros.server_parameters import ontology_folder, triple_store, workspace_folder
from skiros2_world_model.ros.service_pool import service_handler

log = logging.getLogger(__name__)

#: The period of checks whether the owner of the lock is alive (s).
_OWNER_CHECK_PERIOD = 1.0


class Ontologies(Protocol):
    """A world model, or a knowledge base with only the ontologies."""

    def query(self, query: str, context: str = "", cut_prefix: bool = True) -> list[str]: ...
    def modify(self, statements: Sequence[Statement], author: str, context: str = "") -> object: ...


class OntologyServices:
    """`~ontology/query`, `~ontology/modify` and `~lock` of this node.

    :param ontologies: answers the queries and takes the statements.
    :param lock: the lock that `~lock` acquires and releases.
    """

    def __init__(self, ontologies: Ontologies, lock: AdvisoryLock) -> None:
        self._ontologies = ontologies
        self._lock = lock
        self._services = [
            rospy.Service("~ontology/query", srvs.WoQuery, service_handler(self._on_query)),
            rospy.Service("~ontology/modify", srvs.WoModify, service_handler(self._on_modify)),
            rospy.Service("~lock", SetBool, self._on_lock),
        ]

    def _on_query(self, request: srvs.WoQueryRequest) -> srvs.WoQueryResponse:
        return srvs.WoQueryResponse(self._ontologies.query(request.query_string, request.context, request.cut_prefix))

    def _on_modify(self, request: srvs.WoModifyRequest) -> srvs.WoModifyResponse:
        statements = [
            (s.relation.subjectId, s.relation.predicate, s.relation.objectId, s.value) for s in request.statements
        ]
        self._ontologies.modify(statements, request.author, request.context)
        return srvs.WoModifyResponse(True)

    def _on_lock(self, request: SetBoolRequest) -> SetBoolResponse:
        """Acquires the lock, waiting for it, or releases it. The lock of a node that has died is released.

        The owner is a node's name and URI: another process may have the same name, and a master that is down or was
        restarted does not know which nodes are alive.
        """
        if not request.data:
            done = self._lock.release()
            return SetBoolResponse(done, "" if done else "it is not locked")
        name = request._connection_header.get("callerid", "unknown")
        owner = f"{name} {_uri_of(name)}"
        while not self._lock.acquire(owner, _OWNER_CHECK_PERIOD):
            holder = self._lock.owner
            if rospy.is_shutdown():
                return SetBoolResponse(False, "the node is shutting down")
            if holder is not None and not _is_alive(holder) and self._lock.release(holder):
                log.warning("%s has died and held the lock: the lock is released", holder.partition(" ")[0])
        return SetBoolResponse(True, "")


def serve_ontologies() -> None:
    """Runs the ontology server node until its shutdown.

    :raises ConfigurationError: a folder is missing, or an ontology does not parse.
    """
    knowledge_base = KnowledgeBase(ontology_folder(), workspace_folder(), triple_store())
    _services = OntologyServices(knowledge_base, AdvisoryLock())
    log.info("ontologies are served")
    spin()


def _uri_of(node: str) -> str:
    """The URI of a node's slave API; "" when the master does not know it."""
    try:
        return str(rosgraph.Master(rospy.get_name()).lookupNode(node))
    except (rosgraph.MasterException, OSError):
        return ""


def _is_alive(owner: str) -> bool:
    """Whether the process of a lock's owner accepts connections; True when its URI is unknown."""
    _, _, uri = owner.partition(" ")
    if not uri:
        return True
    try:
        with socket.create_connection(rosgraph.network.parse_http_host_and_port(uri), 1.0):
            return True
    except OSError:
        return False
