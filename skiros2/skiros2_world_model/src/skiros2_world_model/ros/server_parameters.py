"""The private parameters of the world model and ontology nodes: folders, journal, triple store."""

from __future__ import annotations

import json
import logging
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import rosgraph
import rospkg
import rospy

from skiros2_common.core.errors import ConfigurationError
from skiros2_world_model.core.journal import KILLED, Journal
from skiros2_world_model.core.triple_store import QUERY_ROWS, QUERY_SECONDS, OxigraphStore, TripleStore

log = logging.getLogger(__name__)

_SWITCH = {"true": True, "1": True, "": True, "false": False, "0": False}
_MEGABYTE = 1 << 20


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
        _number("~journal_days", 30.0),
        int(_number("~journal_megabytes", 1024.0) * _MEGABYTE),
        bool(rospy.get_param("~journal_sync", False)),
    )


def _default_path() -> Path:
    """A file for each master and node name."""
    host, port = rosgraph.network.parse_http_host_and_port(rosgraph.get_master_uri())
    return Path(rospkg.get_ros_home()) / "skiros2" / f"{host}_{port}{rospy.get_name()}.journal"


def _number(name: str, default: float) -> float:
    value: Any = rospy.get_param(name, default)
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not value >= 0:
        raise ConfigurationError(f"parameter {rospy.resolve_name(name)} is {value!r}, expected a number from 0 on")
    return float(value)


def triple_store() -> TripleStore:
    """Creates the triple store of this node: in memory, or the endpoint `~sparql_endpoint`.

    Parameters: `~sparql_endpoint`, `~sparql_update_endpoint` (URLs; default: none, and the same), `~query_seconds`,
    `~query_rows`.

    :raises ConfigurationError: a parameter is invalid, or the endpoint is not available.
    """
    seconds, rows = _positive("~query_seconds", QUERY_SECONDS), int(_positive("~query_rows", QUERY_ROWS))
    query_url, update_url = _text("~sparql_endpoint"), _text("~sparql_update_endpoint")
    if query_url:
        from skiros2_world_model.core.endpoint_store import EndpointStore  # slow to import

        return EndpointStore(query_url, update_url, seconds, rows)
    if update_url:
        given, missing = map(rospy.resolve_name, ("~sparql_update_endpoint", "~sparql_endpoint"))
        raise ConfigurationError(f"parameter {given} is {update_url!r}, but {missing} is not set")
    return OxigraphStore(seconds, rows)


def _text(name: str) -> str:
    return str(rospy.get_param(name, "")).strip()


def _positive(name: str, default: float) -> float:
    value = rospy.get_param(name, default)
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not value > 0:
        raise ConfigurationError(f"parameter {rospy.resolve_name(name)} is {value!r}, expected a number above 0")
    return float(value)
