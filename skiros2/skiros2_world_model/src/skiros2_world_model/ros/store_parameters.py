"""The store that the private parameters of a node ask for."""

from __future__ import annotations

import rospy

from skiros2_common.core.errors import ConfigurationError
from skiros2_world_model.core.triple_store import QUERY_ROWS, QUERY_SECONDS, OxigraphStore, TripleStore


def triple_store() -> TripleStore:
    """The store that answers SPARQL for this node: in memory, or the endpoint `~sparql_endpoint`.

    `~sparql_endpoint`, `~sparql_update_endpoint` (URLs; default: none, and the same), `~query_seconds`, `~query_rows`.

    :raises ConfigurationError: a parameter is of no use, or the endpoint is not there.
    """
    seconds, rows = _positive("~query_seconds", QUERY_SECONDS), int(_positive("~query_rows", QUERY_ROWS))
    query_url, update_url = _text("~sparql_endpoint"), _text("~sparql_update_endpoint")
    if query_url:
        from skiros2_world_model.core.endpoint_store import EndpointStore  # takes time, as rdflib does

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
