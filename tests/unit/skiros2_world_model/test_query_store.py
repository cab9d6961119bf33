"""Queries run in processes of their own: what one of them does harms no other."""

from __future__ import annotations

import os
import signal
import socket
import threading
import time

import pyoxigraph as ox
import pytest

from skiros2_common.core.conditions import (
    AbstractConditionRelation,
    ConditionBase,
    ConditionOnType,
    ConditionProperty,
    ConditionRelation,
)
from skiros2_common.core.errors import TimedOut
from skiros2_common.core.operations import Add
from skiros2_common.core.params import Param, ParamHandler, ParamTypes
from skiros2_common.core.world_element import Element
from skiros2_task.core.world import WorldView
from skiros2_world_model.core.local_world_model import LocalWorldModel, source_ontologies
from skiros2_world_model.core.query_store import WorkerStore
from skiros2_world_model.core.query_worker import check_words
from skiros2_world_model.core.triple_store import Graphs, QueryError, QueryNotAllowed, QueryTooLarge
from skiros2_world_model.core.world_model import WorldModel

NESTED = "SELECT ?s " + "{" * 3000 + "?s ?p ?o" + "}" * 3000
PAIRS = "SELECT (COUNT(*) AS ?n) { ?a ?b ?c . ?d ?e ?f . ?g ?h ?i FILTER(?a != ?i) }"
COUNT = "SELECT (COUNT(*) AS ?n) { ?s ?p ?o }"


def node(name: str) -> ox.NamedNode:
    return ox.NamedNode("http://x.org/#" + name)


def filled(**limits: float) -> WorkerStore:
    store = WorkerStore(**limits)
    store.replace("one", [ox.Triple(node(f"s{i}"), node("p"), node("o")) for i in range(400)])
    store.prepare()
    store.sync()
    return store


def count(store: WorkerStore) -> int:
    return int(store.query(COUNT, "", {}).rows[0][0].value)


def holder_of(store: WorkerStore) -> int:
    assert store._holder is not None
    return store._holder.pid


def test_processes_work_although_sockets_have_a_default_timeout():
    """As in every node after `rospy.init_node`."""
    before = socket.getdefaulttimeout()
    socket.setdefaulttimeout(60.0)
    try:
        assert count(filled()) == 400
    finally:
        socket.setdefaulttimeout(before)


def test_nested_query_is_refused_and_the_next_one_answered():
    store = filled()
    holder = holder_of(store)
    for _ in range(3):
        with pytest.raises(QueryError, match="nested too deeply"):
            store.query(NESTED, "", {})
        assert count(store) == 400
    assert holder_of(store) == holder


def test_cross_products_end_at_their_deadline_while_others_are_answered():
    store = filled(seconds=1.0)
    ended: list[float] = []

    def ask_for_pairs() -> None:
        started = time.monotonic()
        with pytest.raises(TimedOut):
            store.query(PAIRS, "", {})
        ended.append(time.monotonic() - started)

    threads = [threading.Thread(target=ask_for_pairs) for _ in range(4)]
    for thread in threads:
        thread.start()
    while any(thread.is_alive() for thread in threads):
        assert count(store) == 400
    assert len(ended) == 4
    assert max(ended) < 5.0
    assert count(store) == 400


def test_query_needs_no_more_memory_than_allowed():
    store = filled(memory=100 << 20)
    doubled = " ".join(f"BIND(CONCAT(?v{i}, ?v{i}) AS ?v{i + 1})" for i in range(30))
    with pytest.raises(QueryTooLarge, match="needs more than 100 MB"):
        store.query(f"SELECT (STRLEN(?v30) AS ?n) {{ BIND('0123456789' AS ?v0) {doubled} }}", "", {})
    assert count(store) == 400


def test_rows_are_limited_in_number_and_size():
    with pytest.raises(QueryTooLarge, match="more than 1000 rows"):
        filled(rows=1000).query("SELECT ?a ?d { ?a ?b ?c . ?d ?e ?f }", "", {})
    with pytest.raises(QueryTooLarge, match="more than 1 MB"):
        filled(size=1 << 20).query("SELECT ?a ?d { ?a ?b ?c . ?d ?e ?f }", "", {})
    deep = "?o"
    for _ in range(20):
        deep = f"TRIPLE(?s, ?p, {deep})"
    with pytest.raises(QueryTooLarge, match="more than 8 deep"):
        filled().query(f"SELECT ({deep} AS ?x) {{ ?s ?p ?o }}", "", {})


@pytest.mark.parametrize(
    ("query", "reason"),
    [
        ("SELECT * { SERVICE <http://silent.example/sparql> { ?s ?p ?o } }", "SERVICE is not allowed"),
        ("SELECT * { service silent ?s { ?s ?p ?o } }", "SERVICE is not allowed"),
        ("LOAD <http://silent.example/data.ttl>", "LOAD is not allowed"),
        ("SELECT * FROM <http://silent.example/data.ttl> { ?s ?p ?o }", "FROM <http://silent.example/data.ttl> is not"),
        ("SELECT * FROM NAMED <file:///etc/passwd> { ?s ?p ?o }", "FROM <file:///etc/passwd> is not"),
        ("PREFIX x: <http://x/>\nSELECT * FROM x:y { ?s ?p ?o }", "FROM x:y is not"),
    ],
)
def test_query_beyond_the_world_model_is_refused_with_the_reason(query, reason):
    with pytest.raises(QueryNotAllowed, match=reason) as error:
        filled().query(query, "", {})
    assert error.value.code == "query_not_allowed"


@pytest.mark.parametrize(
    "query",
    [
        'SELECT ?service { ?service <http://x/SERVICE> \'SERVICE\', """LOAD " FROM <http://x>""" } # SERVICE',
        "PREFIX service: <http://x/> SELECT * { service:load service:service ?FROM } LIMIT 1",
        "SELECT * FROM <urn:skiros:context:scene> { ?s ?p 'it\\'s SERVICE' FILTER(?s < 3 && ?p > 2) }",
    ],
)
def test_words_in_names_texts_and_comments_are_allowed(query):
    check_words(query)


def test_worker_cannot_connect_to_a_host_whatever_the_query_says():
    with socket.create_server(("127.0.0.1", 0)) as server:
        server.setblocking(False)
        prefix = f"PREFIX h: <http://127.0.0.1:{server.getsockname()[1]}/>"
        # To the check of words, which does not parse, `<?b)SERVICE#>` is an IRI.
        query = f"{prefix} SELECT * {{ ?a ?b ?c FILTER(?a!=?b||?a<?b)SERVICE#>\nh:{{ ?x ?y ?z }} }}"
        check_words(query)
        with pytest.raises(QueryNotAllowed, match="reads this world model only"):
            filled().query(query, "", {})
        with pytest.raises(BlockingIOError):
            server.accept()


def test_killed_worker_is_replaced():
    store = filled()
    assert count(store) == 400
    (worker,) = store._idle
    os.kill(worker.pid, signal.SIGKILL)
    while worker.is_alive():
        time.sleep(0.001)
    assert count(store) == 400


def test_killed_holder_is_replaced_with_all_content():
    model = WorldModel(source_ontologies())
    model.transact([Add(Element("skiros:Product", "one"))], "test")
    query = "SELECT ?x { ?x a skiros:Product }"
    assert len(model.query(query)) == 1
    store = model.knowledge_base.store
    assert isinstance(store, WorkerStore)
    for found in (2, 3, 4):
        holder = store._holder
        assert holder is not None
        os.kill(holder.pid, signal.SIGKILL)
        while holder.is_alive():
            time.sleep(0.001)
        model.transact([Add(Element("skiros:Product", "another"))], "test")
        assert len(model.query(query)) == found
    assert model.query("ASK { skiros:Product a owl:Class }", "ontology") == ["true"]


def test_every_change_is_seen_by_the_next_query():
    store = filled()
    for i in range(50):
        store.update("one", [ox.Triple(node(f"s{i}"), node("p"), node("o"))], [])
        store.sync()
        assert count(store) == 399 - i
    store.replace("two", [ox.Triple(node(f"t{i}"), node("p"), node("o")) for i in range(6_000)])
    store.sync()
    assert count(store) == 6_350


def test_writers_do_not_wait_for_the_graphs():
    model = WorldModel(source_ontologies())
    model.transact([Add(Element("skiros:Product", f"p{i}")) for i in range(5_000)], "test")
    asked = threading.Thread(target=model.query, args=("ASK { ?s ?p ?o }",))
    asked.start()
    waited = []
    while asked.is_alive():
        started = time.monotonic()
        model.transact([Add(Element("skiros:Product", "another"))], "test")
        waited.append(time.monotonic() - started)
    assert len(waited) > 5  # made while the graphs were filled
    assert model.query("SELECT (COUNT(*) AS ?n) { ?x a skiros:Product }") == [str(5_000 + len(waited))]


def test_clients_get_the_ontology_without_a_process():
    model = WorldModel(source_ontologies())
    store = model.knowledge_base.store
    assert isinstance(store, WorkerStore)
    assert model.query("ASK {}", "ontology") == ["true"]
    assert store._holder is None


def test_planner_reads_classes_and_properties_from_memory():
    model = WorldModel(source_ontologies())
    wm, store = LocalWorldModel("test", model), model.knowledge_base.store
    assert isinstance(store, WorkerStore)
    view = WorldView(wm)
    found = view.classes(), view.relations(), view.boolean_properties()
    assert store._holder is None
    query = "SELECT ?x {{ ?x a owl:{} }}"
    assert {n for n in model.query(query.format("Class"), "ontology") if not n.startswith("_:")} <= found[0]
    assert set(model.query(query.format("ObjectProperty"), "ontology")) <= found[1]
    assert set(model.query("SELECT ?x { ?x rdfs:range xsd:boolean }", "ontology")) <= found[2]


def test_conditions_and_reasoners_read_from_memory():
    model = WorldModel(source_ontologies())
    wm, store = LocalWorldModel("test", model), model.knowledge_base.store
    assert isinstance(store, WorkerStore)
    place, part = Element("skiros:Location", "place"), Element("skiros:Part", "part")
    for element in (place, part):
        element.setProperty("skiros:DiscreteReasoner", ["AauSpatialReasoner"])
        wm.add_element(element)
    wm.set_relation(place.id, "skiros:contain", part.id, True)
    params = ParamHandler({key: Param(key, "", e, ParamTypes.Required) for key, e in (("A", place), ("B", part))})
    conditions: list[ConditionBase] = [
        ConditionRelation("c", "skiros:contain", "A", "B", True),
        AbstractConditionRelation("c", "skiros:contain", "A", "B", True),
        ConditionOnType("c", "A", "skiros:Location"),
        ConditionProperty("c", "skiros:Weight", "A", "=", 1.0, False),
    ]
    for condition in conditions:
        condition.evaluate(params, wm)
        condition.satisfied_for_inference(params, wm)
    assert wm.resolve_elements(Element("skiros:Location"))
    assert store._holder is None


def test_graphs_stay_as_fast_and_small_under_many_changes():
    graphs, subject = Graphs(), node("s")
    graphs.update("one", (), [ox.Triple(node(f"s{i}"), node("p"), node("o")) for i in range(100)])
    stores = set()
    for i in range(6_000):
        graphs.forget("one", [subject])
        graphs.update("one", (), [ox.Triple(subject, node("p"), ox.Literal(i))])
        stores.add(id(graphs.store))
    assert len(stores) > 1  # Oxigraph keeps what is removed
    assert len(graphs.triples("one")) == 101
    assert not graphs.is_worn
