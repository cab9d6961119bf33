"""The services of ontologies: queries, statements, and the advisory lock; and the parameters of the server nodes."""

from __future__ import annotations

import json
import logging
import math
import socket
import sqlite3
import threading
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Protocol

import rosgraph
import rospkg
import rospy
from std_srvs.srv import SetBool, SetBoolRequest, SetBoolResponse

from skiros2_common.core.errors import ConfigurationError
from skiros2_common.core.operations import Statement
from skiros2_common.ros.node import spin
from skiros2_common.ros.parameters import number_param
from skiros2_msgs import srv as srvs
from skiros2_world_model.core.journal import KILLED, Journal
from skiros2_world_model.core.knowledge_base import AdvisoryLock, KnowledgeBase
from skiros2_world_model.core.query_budget import BUDGET_SECONDS, QueryBudgets
from skiros2_world_model.core.query_store import WorkerStore
from skiros2_world_model.core.triple_store import QUERY_BYTES, QUERY_MEMORY, QUERY_ROWS, QUERY_SECONDS, TripleStore
from skiros2_world_model.ros.service_pool import ON_BEHALF_OF, service_handler

log = logging.getLogger(__name__)

_SWITCH = {"true": True, "1": True, "": True, "false": False, "0": False}
_MEGABYTE = 1 << 20

#: The period in which the parameter for syncs is followed (s).
_SYNC_PERIOD = 1.0


def ontology_folder() -> Path:
    """The folder of the package's own ontologies.

    :raises ConfigurationError: the package `skiros2` cannot be found.
    """
    try:
        return Path(rospkg.RosPack().get_path("skiros2")) / "ontologies"
    except rospkg.ResourceNotFound:
        raise ConfigurationError("package skiros2 cannot be found: source the set-up file of its workspace") from None


def workspace_folder() -> Path:
    """`~workspace_dir`, the folder of the user's ontologies and scenes; default: the package's own."""
    text = str(rospy.get_param("~workspace_dir", "")).strip()
    return Path(text).expanduser() if text else ontology_folder()


def open_journal(workspace: Path, initial: Sequence[tuple[str, str]]) -> Journal | None:
    """Opens the journal of this node; None when it is disabled.

    Parameters: `~journal` (true, false, or a file; default true: a file for each master and node name),
    `~journal_recover`, `~journal_days`, `~journal_megabytes`, `~journal_sync`; see docs/world_model.md.

    :param workspace, initial: the initial files, which identify the origin of the journal.
    :raises ConfigurationError: a parameter is invalid, or another node uses the journal.
    """
    wanted = str(rospy.get_param("~journal", True)).strip()
    if not _SWITCH.get(wanted.lower(), True):
        return None
    path = _default_path() if wanted.lower() in _SWITCH else Path(wanted).expanduser()
    return Journal(
        path,
        json.dumps([str(workspace.absolute()), initial]),
        str(rospy.get_param("~journal_recover", KILLED)).strip(),
        number_param("~journal_days", 30.0, minimum=0.0, maximum=math.inf),
        int(number_param("~journal_megabytes", 1024.0, minimum=0.0) * _MEGABYTE),
        _syncs(),
    )


def follow_sync(journal: Journal) -> None:
    """Follows the parameter `~journal_sync` in a thread: a gateway sets it when it starts, perhaps later."""

    def follow() -> None:
        while not rospy.is_shutdown():
            time.sleep(_SYNC_PERIOD)
            try:
                wanted = _syncs()
                if wanted != journal.full_sync:
                    journal.full_sync = wanted
                    log.info("each change is %s", "synced to disk" if wanted else "no longer synced to disk")
            except (OSError, rospy.ROSException, sqlite3.Error) as error:
                log.debug("~journal_sync cannot be followed: %s", error)

    threading.Thread(target=follow, name="journal sync", daemon=True).start()


def _syncs() -> bool:
    """Whether each change is to be synced to disk. The master publishes the parameter to this node."""
    return bool(rospy.get_param_cached("~journal_sync", False))


def _default_path() -> Path:
    """A file for each master and node name."""
    host, port = rosgraph.network.parse_http_host_and_port(rosgraph.get_master_uri())
    return Path(rospkg.get_ros_home()) / "skiros2" / f"{host}_{port}{rospy.get_name()}.journal"


def triple_store() -> TripleStore:
    """Creates the triple store of this node: in processes of its own, or the endpoint `~sparql_endpoint`.

    Parameters: `~sparql_endpoint`, `~sparql_update_endpoint` (URLs; default: none, and the same), `~query_seconds`,
    `~query_rows`, `~query_answer_megabytes`, `~query_megabytes`.

    :raises ConfigurationError: a parameter is invalid, or the endpoint is not available.
    """
    seconds = number_param("~query_seconds", QUERY_SECONDS, above=0.0)
    rows = int(number_param("~query_rows", QUERY_ROWS, above=0.0))
    query_url, update_url = _text("~sparql_endpoint"), _text("~sparql_update_endpoint")
    if query_url:
        from skiros2_world_model.core.endpoint_store import EndpointStore  # slow to import

        return EndpointStore(query_url, update_url, seconds, rows)
    if update_url:
        given, missing = map(rospy.resolve_name, ("~sparql_update_endpoint", "~sparql_endpoint"))
        raise ConfigurationError(f"parameter {given} is {update_url!r}, but {missing} is not set")
    size = number_param("~query_answer_megabytes", QUERY_BYTES / _MEGABYTE, above=0.0)
    memory = number_param("~query_megabytes", QUERY_MEMORY / _MEGABYTE, above=0.0)
    return WorkerStore(seconds, rows, int(size * _MEGABYTE), int(memory * _MEGABYTE))


def query_budgets() -> QueryBudgets:
    """The budgets of this node's callers: `~query_budget` (s).

    :raises ConfigurationError: the parameter is invalid.
    """
    return QueryBudgets(number_param("~query_budget", BUDGET_SECONDS, above=0.0))


def _text(name: str) -> str:
    return str(rospy.get_param(name, "")).strip()


#: The period of checks whether the owner of the lock is alive (s).
_OWNER_CHECK_PERIOD = 1.0


class Ontologies(Protocol):
    """A world model, or a knowledge base with only the ontologies."""

    def query(self, query: str, context: str = "", cut_prefix: bool = True, *, caller: str = "") -> list[str]: ...
    def query_json(self, query: str, context: str = "", *, caller: str = "") -> str: ...
    def modify(self, statements: Sequence[Statement], author: str, context: str = "") -> object: ...


class OntologyServices:
    """`~ontology/query`, `~ontology/sparql`, `~ontology/modify` and `~lock` of this node.

    :param ontologies: answers the queries and takes the statements.
    :param lock: the lock that `~lock` acquires and releases.
    """

    def __init__(self, ontologies: Ontologies, lock: AdvisoryLock) -> None:
        self._ontologies = ontologies
        self._lock = lock
        self._services = [
            rospy.Service("~ontology/query", srvs.WoQuery, service_handler(self._on_query)),
            rospy.Service("~ontology/sparql", srvs.WmSparql, service_handler(self._on_sparql)),
            rospy.Service("~ontology/modify", srvs.WoModify, service_handler(self._on_modify)),
            rospy.Service("~lock", SetBool, self._on_lock),
        ]

    def _on_query(self, request: srvs.WoQueryRequest) -> srvs.WoQueryResponse:
        text, context = request.query_string, request.context
        answer = self._ontologies.query(text, context, request.cut_prefix, caller=_caller(request))
        return srvs.WoQueryResponse(answer)

    def _on_sparql(self, request: srvs.WmSparqlRequest) -> srvs.WmSparqlResponse:
        answer = self._ontologies.query_json(request.query, request.context, caller=_caller(request))
        return srvs.WmSparqlResponse(answer)

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


def _caller(request: Any) -> str:
    """The node that calls a service, and the user for whom it says to call."""
    header = request._connection_header
    return f"{header.get('callerid', 'unknown')} {header.get(ON_BEHALF_OF, '')}".strip()


def serve_ontologies() -> None:
    """Runs the ontology server node until its shutdown.

    :raises ConfigurationError: a folder is missing, or an ontology does not parse.
    """
    knowledge_base = KnowledgeBase(ontology_folder(), workspace_folder(), triple_store())
    knowledge_base.budgets = query_budgets()
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
