"""The services of ontologies: queries, statements, and the advisory lock."""

from __future__ import annotations

import logging
import socket
from collections.abc import Sequence
from typing import Any, Protocol

import rosgraph
import rospy
from std_srvs.srv import SetBool, SetBoolResponse

from skiros2_common.ros.shutdown import spin
from skiros2_msgs import srv as srvs
from skiros2_world_model.core.advisory_lock import AdvisoryLock
from skiros2_world_model.core.changes import Statement
from skiros2_world_model.core.knowledge_base import KnowledgeBase
from skiros2_world_model.ros.errors import service_handler
from skiros2_world_model.ros.server_parameters import ontology_folder, triple_store, workspace_folder

log = logging.getLogger(__name__)

#: How often a taken lock is looked at for an owner that is gone (s).
_OWNER_CHECK_PERIOD = 1.0


class Ontologies(Protocol):
    """What the services need: a world model, or ontologies alone."""

    def query(self, query: str, context: str = "", cut_prefix: bool = True) -> list[str]: ...
    def modify(self, statements: Sequence[Statement], author: str, context: str = "") -> Any: ...


class OntologyServices:
    """`~ontology/query`, `~ontology/modify` and `~lock` of this node.

    :param ontologies: what they are about.
    :param lock: the lock that `~lock` takes and gives back.
    """

    def __init__(self, ontologies: Ontologies, lock: AdvisoryLock) -> None:
        self._ontologies = ontologies
        self._lock = lock
        self._services = [
            rospy.Service("~ontology/query", srvs.WoQuery, service_handler(self._on_query)),
            rospy.Service("~ontology/modify", srvs.WoModify, service_handler(self._on_modify)),
            rospy.Service("~lock", SetBool, self._on_lock),
        ]

    def _on_query(self, request: Any) -> Any:
        return srvs.WoQueryResponse(self._ontologies.query(request.query_string, request.context, request.cut_prefix))

    def _on_modify(self, request: Any) -> Any:
        statements = [
            (s.relation.subjectId, s.relation.predicate, s.relation.objectId, s.value) for s in request.statements
        ]
        self._ontologies.modify(statements, request.author, request.context)
        return srvs.WoModifyResponse(True)

    def _on_lock(self, request: Any) -> Any:
        """Takes the lock, waiting for it, or gives it back. A node that has died has given it back.

        The owner is a node's name and its URI: the name alone may be another life of it, and a master that is away, or
        new, does not know who lives.
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
                log.warning("%s had the lock and is gone: it is free", holder.partition(" ")[0])
        return SetBoolResponse(True, "")


def serve_ontologies() -> None:
    """The program of the ontology server node: until shutdown.

    :raises ConfigurationError: a folder is missing, or an ontology does not parse.
    """
    knowledge_base = KnowledgeBase(ontology_folder(), workspace_folder(), triple_store())
    _services = OntologyServices(knowledge_base, AdvisoryLock())
    log.info("ontologies are served")
    spin()


def _uri_of(node: str) -> str:
    """Where a node listens to others; "" when the master does not tell."""
    try:
        return str(rosgraph.Master(rospy.get_name()).lookupNode(node))
    except (rosgraph.MasterException, OSError):
        return ""


def _is_alive(owner: str) -> bool:
    """Whether a lock's owner still listens to others, as far as that is known."""
    _, _, uri = owner.partition(" ")
    if not uri:
        return True
    try:
        with socket.create_connection(rosgraph.network.parse_http_host_and_port(uri), 1.0):
            return True
    except OSError:
        return False
