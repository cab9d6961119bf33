"""Queries by hostile callers of the world model's node: all others are still answered."""

from __future__ import annotations

import asyncio
import contextlib
import socket
import threading
import time
from collections.abc import Callable

import pytest
import rospy

from skiros2_common.core.errors import TimedOut
from skiros2_gateway.core.problems import Rejected, TooMany
from skiros2_gateway.ros.queries import UserQueries
from skiros2_msgs import srv as srvs
from skiros2_world_model.core.wm_errors import WmException
from skiros2_world_model.ros.ontology_interface import OntologyInterface
from skiros2_world_model.ros.service_pool import ServicePool
from support.ros import Ros

pytestmark = pytest.mark.timeout(90)

NESTED = "SELECT ?s " + "{" * 3000 + "?s ?p ?o" + "}" * 3000
PAIRS = "SELECT (COUNT(*) AS ?n) { ?a ?b ?c . ?d ?e ?f . ?g ?h ?i FILTER(?a != ?i) }"


@pytest.fixture
def ask(ros: Ros, tmp_path) -> Callable[[str, str], str]:
    """Asks a node with queries of at most 1 s for a user; "": for this node."""
    params = {"workspace_dir": str(tmp_path), "query_seconds": 1.0, "query_budget": 3.0}
    ros.run("skiros2_world_model", "world_model_server_node", name="wm", params=params)
    ros.service("/wm/get", srvs.WmGet)
    pools: dict[str, ServicePool] = {}

    def ask(user: str, query: str) -> str:
        pool = pools.setdefault(user, ServicePool("/wm/ontology/sparql", srvs.WmSparql, user=user))
        return str(pool.call(srvs.WmSparqlRequest(query, "")).json)

    return ask


def refused(ask: Callable[[str, str], str], user: str, query: str) -> str:
    with pytest.raises(WmException) as error:
        ask(user, query)
    return str(error.value.code)


def test_nested_query_ends_no_node(ask):
    for _ in range(3):
        assert refused(ask, "mallory", NESTED) == "wrong_query"
        assert "boolean" in ask("alice", "ASK { ?s ?p ?o }")


def test_caller_uses_up_its_own_budget_only(ask):
    codes: list[str] = []

    def attack() -> None:
        while "budget_used_up" not in codes:
            codes.append(refused(ask, "mallory", PAIRS))

    threads = [threading.Thread(target=attack) for _ in range(2)]
    for thread in threads:
        thread.start()
    slowest, client = 0.0, OntologyInterface("tests")
    while any(thread.is_alive() for thread in threads):
        started = time.monotonic()
        assert "boolean" in ask("alice", "ASK { ?s ?p ?o }")
        assert client.query_ontology("ASK { skiros:Skill a owl:Class }") == ["true"]
        slowest = max(slowest, time.monotonic() - started)
    assert set(codes) == {"timed_out", "budget_used_up"}
    assert refused(ask, "mallory", "ASK { ?s ?p ?o }") == "budget_used_up"
    assert "boolean" in ask("", "ASK { ?s ?p ?o }")
    assert slowest < 5.0


def test_user_of_the_gateway_uses_up_its_own_budget_only(ask):
    """REST and agents' tools ask by `UserQueries`."""

    async def test() -> None:
        queries = UserQueries()
        service = "SELECT * { SERVICE <http://silent.example/> { ?s ?p ?o } }"
        for query, code in ((NESTED, "wrong_query"), (service, "query_not_allowed")):
            with pytest.raises(Rejected) as error:
                await queries.ask("mallory", query)
            assert [problem.code for problem in error.value.problems] == [code]
        three = await asyncio.gather(*(queries.ask("carol", PAIRS) for _ in range(3)), return_exceptions=True)
        assert [error for error in three if isinstance(error, TooMany)] == [three[2]]
        with pytest.raises(TooMany, match="mallory: its queries have used up 3 s"):
            while True:
                with contextlib.suppress(TimedOut):
                    await queries.ask("mallory", PAIRS)
        assert (await queries.ask("alice", "SELECT ?s { ?s ?p ?o } LIMIT 1"))["columns"] == ["s"]
        queries.close()

    asyncio.run(test())


def test_query_to_a_silent_host_is_refused_at_once(ask):
    with socket.create_server(("127.0.0.1", 0)) as silent:
        silent.setblocking(False)
        service = f"SELECT * {{ SERVICE <http://127.0.0.1:{silent.getsockname()[1]}/> {{ ?s ?p ?o }} }}"
        for _ in range(3):
            assert refused(ask, "mallory", service) == "query_not_allowed"
        with pytest.raises(BlockingIOError):
            silent.accept()
    assert "boolean" in ask("alice", "ASK { ?s ?p ?o }")
    assert not rospy.is_shutdown()
