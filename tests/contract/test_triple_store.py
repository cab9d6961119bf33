"""The triple store: one suite for the store in processes of its own and for an endpoint over HTTP."""

from __future__ import annotations

import threading

import pyoxigraph as ox
import pytest

from skiros2_common.core.errors import TimedOut, WrongValue
from skiros2_world_model.core.endpoint_store import EndpointStore
from skiros2_world_model.core.query_store import WorkerStore
from support.sparql_endpoint import SparqlEndpoint

NAMESPACES = {"x": "http://x.org/#", "rdf": "http://www.w3.org/1999/02/22-rdf-syntax-ns#"}
TYPE = ox.NamedNode(NAMESPACES["rdf"] + "type")


def node(name):
    return ox.NamedNode(NAMESPACES["x"] + name)


def triple(subject, predicate, obj):
    obj = node(obj) if isinstance(obj, str) else obj
    return ox.Triple(node(subject), TYPE if predicate == "a" else node(predicate), obj)


@pytest.fixture(params=["workers", "endpoint"])
def make(request):
    """Makes a store; further ones of an endpoint are on the same."""
    if request.param == "workers":
        yield WorkerStore
        return
    with SparqlEndpoint() as endpoint:
        yield lambda **limits: EndpointStore(endpoint.url, **limits)


@pytest.fixture
def store(make):
    return make()


def ask(store, query, context=""):
    store.prepare()
    store.sync()
    return store.query(query, context, NAMESPACES).rows


def content(store, context=""):
    return set(ask(store, "SELECT ?s ?p ?o { ?s ?p ?o FILTER(STRSTARTS(STR(?p), 'http')) "
                          "FILTER(!STRSTARTS(STR(?s), 'urn:skiros:session')) }", context))  # fmt: skip


def rows(*triples):
    return {(t.subject, t.predicate, t.object) for t in triples}


A, B, C = triple("a", "p", "b"), triple("b", "p", "c"), triple("c", "q", ox.Literal("text"))


def test_contexts_are_queried_separately_and_together(store):
    store.replace("one", [A, B])
    store.replace("two", [B, C])
    assert content(store, "one") == rows(A, B)
    assert content(store, "two") == rows(B, C)
    assert content(store) == rows(A, B, C)
    assert content(store, "none") == set()


def test_replace_removes_the_previous_triples(store):
    store.replace("one", [A])
    assert content(store, "one") == rows(A)
    store.replace("one", [C])
    assert content(store, "one") == rows(C)
    store.replace("one", [])
    assert content(store, "one") == set()


def test_triples_are_removed_and_added(store):
    store.replace("one", [A, B])
    store.update("one", [A, C], [C])
    store.extend("one", iter([A]))
    assert content(store, "one") == rows(A, B, C)
    store.update("one", [A], [])
    assert content(store, "one") == rows(B, C)


def test_rewritten_subjects_keep_their_relations(store):
    label, other = triple("a", "label", ox.Literal("old")), triple("b", "label", ox.Literal("kept"))
    blank = ox.Triple(node("a"), node("p"), ox.BlankNode("n"))
    store.replace("one", [A, triple("a", "a", "Old"), label, other, blank, B])
    new = [triple("a", "a", "New"), triple("a", "label", ox.Literal("new"))]
    store.rewrite("one", {node("a")}, {B}, set(new))
    assert content(store, "one") == rows(A, other, *new)
    store.rewrite("one", {node("a"), node("b")}, set(), set())
    assert content(store, "one") == rows(A)


@pytest.mark.parametrize(
    "term",
    [
        ox.Literal('quotes " and \\ and\nlines\ttabs'), ox.Literal("Grüße 漢字 😀"), ox.Literal("chat", language="fr"),
        ox.Literal("1.5", datatype=ox.NamedNode("http://www.w3.org/2001/XMLSchema#float")),
        ox.Literal("NaN", datatype=ox.NamedNode("http://www.w3.org/2001/XMLSchema#double")),
        ox.Literal("_:no blank node; } GRAPH"), ox.NamedNode("http://x.org/ä?b=c&d=%20#e"), ox.Literal(""),
    ],
    ids=str,
)  # fmt: skip
def test_term_is_returned_unchanged(store, term):
    there = ox.Triple(node("a"), node("p"), term)
    store.replace("one", [there])
    assert content(store, "one") == rows(there)
    store.update("one", [there], [A])
    assert content(store, "one") == rows(A)


def test_blank_nodes_are_returned_as_blank_nodes(store):
    n = ox.BlankNode("n1")
    restriction = [ox.Triple(node("a"), node("p"), n), ox.Triple(n, node("q"), ox.Literal("x"))]
    store.replace("one", restriction)
    store.extend("one", [A])
    (row,) = ask(store, "SELECT ?n { x:a x:p ?n . ?n x:q 'x' }", "one")
    assert isinstance(row[0], ox.BlankNode)
    store.update("one", restriction, [])
    assert content(store, "one") == rows(A)


def test_many_triples_are_stored(store):
    many = [triple(f"s{i}", "p", f"o{i}") for i in range(12_000)]
    store.replace("one", many)
    assert ask(store, "SELECT (COUNT(*) AS ?n) { ?s x:p ?o }", "one")[0][0].value == "12000"
    store.rewrite("one", {t.subject for t in many}, set(many[:7_000]), set())
    assert ask(store, "SELECT (COUNT(*) AS ?n) { ?s x:p ?o }", "one")[0][0].value == "5000"


def test_select_ask_construct_and_unbound_values(store):
    store.replace("one", [A, B, C])
    assert ask(store, "SELECT ?s ?t { ?s x:p x:c OPTIONAL { ?s x:none ?t } }") == [(node("b"), None)]
    assert ask(store, "ASK { x:a x:p+ x:c }")[0][0].value == "true"
    assert ask(store, "ASK { x:c x:p x:a }")[0][0].value == "false"
    assert ask(store, "CONSTRUCT { ?o x:inverse ?s } { ?s x:p ?o }", "one")[0][1] == node("inverse")
    assert ask(store, "PREFIX x: <http://y.org/#> SELECT ?s { ?s x:p ?o }") == []
    assert ask(store, "SELECT ?s { ?s x:none ?o }") == []


@pytest.mark.parametrize(
    ("query", "said"),
    [
        ("SELECT ?x\nWHERE { ?x x:p }", "line 2, column 17: expected"),
        ("SELECT ?x { ?x nobody:p ?y }", "line 1, column 24: unknown prefix"),
        ("INSERT DATA { x:a x:p x:b }", "line 1, column 10: "),
        ("DROP ALL", "line 1, column 9: "),
        ("", "line 1, column 1: "),
    ],
)
def test_invalid_query_is_refused_with_line_and_column(store, query, said):
    store.replace("one", [A])
    with pytest.raises(WrongValue, match=said) as error:
        ask(store, query)
    assert query in str(error.value)
    assert content(store, "one") == rows(A)


def test_query_with_too_many_rows_is_refused(make):
    store = make(rows=100)
    store.replace("one", [triple(f"s{i}", "p", "o") for i in range(101)])
    with pytest.raises(WrongValue, match="more than 100 rows; expected a LIMIT"):
        ask(store, "SELECT ?s { ?s x:p ?o }", "one")
    assert len(ask(store, "SELECT ?s { ?s x:p ?o } LIMIT 100", "one")) == 100


def test_threads_query_while_another_thread_writes(store):
    store.replace("one", [])
    failed = []

    def reads():
        try:
            for _ in range(10):
                # each s<i> comes with its t<i>
                assert ask(store, "SELECT ?s { ?s x:p ?o FILTER NOT EXISTS { ?o x:p ?s } }", "one") == []
        except Exception as error:
            failed.append(error)

    threads = [threading.Thread(target=reads) for _ in range(3)]
    for thread in threads:
        thread.start()
    for i in range(200):
        store.update("one", [], [triple(f"s{i}", "p", f"t{i}"), triple(f"t{i}", "p", f"s{i}")])
    for thread in threads:
        thread.join()
    assert not failed
    assert len(content(store, "one")) == 400


# -- limits of time -----------------------------------------------------------------------------------------------


ALL_PAIRS = "SELECT (COUNT(*) AS ?n) { ?a x:p ?b . ?c x:p ?d . ?e x:p ?f FILTER(?a != ?f) }"


def test_long_query_is_ended_without_blocking_others():
    store = WorkerStore(seconds=0.2)
    store.replace("one", [triple(f"s{i}", "p", "o") for i in range(180)])  # 180³ rows take a second or two
    for _ in range(5):
        with pytest.raises(TimedOut, match=r"ended after 0.2 s"):
            ask(store, ALL_PAIRS)
    store.update("one", [], [A])
    assert ask(store, "ASK { x:a x:p x:b }")[0][0].value == "true"


def test_query_of_an_endpoint_without_answer_times_out():
    with SparqlEndpoint() as endpoint:
        store = EndpointStore(endpoint.url, seconds=0.2)
        endpoint.silent = threading.Event()
        with pytest.raises(TimedOut, match=rf"{endpoint.url}: no answer within 0.2 s"):
            ask(store, "ASK {}")
        endpoint.silent.set()
        endpoint.silent = None
        assert ask(store, "ASK {}")[0][0].value == "true"
