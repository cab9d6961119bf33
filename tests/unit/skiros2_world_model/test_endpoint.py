"""A world model whose triple store is a SPARQL endpoint over HTTP."""

import contextlib
import threading

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from skiros2_common.core.errors import ConfigurationError, Refused, SkirosError
from skiros2_common.core.processes import free_port
from skiros2_common.core.world_element import Element
from skiros2_world_model.core.endpoint_store import EndpointStore
from skiros2_world_model.core.local_world_model import LocalWorldModel, source_ontologies
from skiros2_world_model.core.world_model import WorldModel
from support.fuzz import examples
from support.sparql_endpoint import SparqlEndpoint
from unit.skiros2_world_model.test_graph_sync import OPERATIONS, graph, graph_of_the_text

BOXES = "SELECT ?x { ?x rdf:type/rdfs:subClassOf* skiros:Container }"
OWN = """PREFIX owl: <http://www.w3.org/2002/07/owl#> PREFIX rdfs: <http://www.w3.org/2000/01/rdf-schema#>
PREFIX skiros: <http://rvmi.aau.dk/ontologies/skiros.owl#> PREFIX parts: <http://x.org/parts.owl#>
INSERT DATA {
  <http://x.org/parts.owl> a owl:Ontology . parts:Crate a owl:Class ; rdfs:subClassOf skiros:LargeBox .
  parts:holds a owl:ObjectProperty ; rdfs:subPropertyOf skiros:contain .
  GRAPH <http://x.org/catalogue> { parts:crate_7 a parts:Crate ; parts:price 12 . }
}"""


@pytest.fixture
def endpoint():
    with SparqlEndpoint() as endpoint:
        yield endpoint


@pytest.fixture
def connect(endpoint, workspace):
    """A world model over the endpoint, each time another one."""

    def connect(url=""):
        store = EndpointStore(url or endpoint.url)
        return LocalWorldModel("test", WorldModel(source_ontologies(), workspace, store=store))

    return connect


def add_box(wm, label="box"):
    box = Element("skiros:LargeBox", label)
    box.addRelation("skiros:Scene-0", "skiros:contain", "-1")
    return wm.add_element(box).id


# -- queries ------------------------------------------------------------------------------------------------------


def test_queries_see_every_change(connect, endpoint):
    wm = connect()
    first = add_box(wm)
    assert set(wm.model.query(BOXES)) == {first, "skiros:large_box_test_starter"}
    second = add_box(wm)
    assert {first, second} <= set(wm.model.query(BOXES))
    wm.remove_element(wm.get_element(first))
    assert first not in wm.model.query(BOXES)
    assert not any(first.partition(":")[2] in triple for triple in endpoint.graph("scene"))


def test_only_changes_are_sent(connect, endpoint):
    wm = connect()
    for _ in range(50):
        add_box(wm)
    wm.model.query(BOXES)
    sent = len(endpoint.requests)
    wm.model.query(BOXES)
    assert len(endpoint.requests) == sent
    add_box(wm, "the last one")
    wm.model.query(BOXES)
    (request,) = endpoint.requests[sent:]
    assert "the last one" in request and request.count("LargeBox-") < 10


@given(requests=st.lists(st.lists(OPERATIONS, max_size=4), max_size=6), asked=st.lists(st.booleans(), min_size=6))
@settings(max_examples=examples(10))
def test_endpoint_graph_equals_the_saved_file(tmp_path_factory, requests, asked):
    folder = tmp_path_factory.mktemp("ws")
    with SparqlEndpoint() as endpoint:
        model = WorldModel(source_ontologies(), folder, store=EndpointStore(endpoint.url))
        for request, asks in zip(requests, asked, strict=False):
            with contextlib.suppress(SkirosError):
                model.transact(request, "test")
            if asks:
                graph(model)
        graph(model)
        assert endpoint.graph("scene") == graph_of_the_text(model, folder)


def test_several_contexts(connect, endpoint, workspace):
    wm = connect()
    wm.add_element(Element("skiros:Part", "remembered"), "memory")
    assert wm.model.query('SELECT ?x { ?x rdfs:label "remembered" }', "memory") == ["skiros:Part-1"]
    assert wm.model.query('SELECT ?x { ?x rdfs:label "remembered" }', "scene") == []
    assert wm.model.query('SELECT ?x { ?x rdfs:label "remembered" }') == ["skiros:Part-1"]


def test_ontologies_are_known_to_both_and_need_no_endpoint_when_they_alone_are_asked(connect, endpoint):
    wm = connect()
    wm.add_class("skiros:Crate", "skiros:LargeBox")
    query = "SELECT ?c { ?c rdfs:subClassOf skiros:LargeBox }"
    assert wm.model.query(query) == ["skiros:Crate"]
    endpoint.stop()
    assert wm.model.query(query, "ontology") == ["skiros:Crate"]
    assert wm.get_sub_classes("skiros:LargeBox", recursive=False) == ["skiros:Crate"]


def test_restrictions_can_be_asked_for(connect):
    rows = connect().model.query("SELECT ?p { sumo:Agent rdfs:subClassOf ?r . ?r owl:onProperty ?p }")
    assert rows == ["skiros:hasSkill"]


# -- what the endpoint holds besides ------------------------------------------------------------------------------


def test_other_graphs_of_the_endpoint_are_kept_and_queried(connect, endpoint):
    endpoint.store.update(OWN)
    before = set(endpoint.store)
    wm = connect()
    crate = Element("parts:Crate", "parts:crate_7")
    eid = wm.add_element(crate).id
    query = """SELECT ?x ?price { GRAPH ?g { ?x a parts:Crate . ?x rdfs:label ?l } ?t parts:price ?price
        FILTER(CONTAINS(STR(?t), "crate_7")) }"""
    assert wm.model.query(query) == [f"{eid} 12 "]
    assert before <= set(endpoint.store)


def test_its_classes_and_properties_are_known(connect, endpoint, caplog):
    endpoint.store.update(OWN)
    wm = connect()
    eid = wm.add_element(Element("parts:Crate", "one")).id
    assert [e.id for e in wm.resolve_elements(Element("skiros:LargeBox"))] == [eid]
    part = Element("skiros:Part", "in it")
    part.addRelation(eid, "parts:holds", "-1")
    part_id = wm.add_element(part).id
    assert wm.get_relations(eid, "skiros:contain", part_id)
    assert not caplog.messages
    assert connect("").model.ontology.is_subclass("parts:Crate", "skiros:Container")


def test_graphs_of_an_earlier_world_model_are_dropped(connect, endpoint):
    first = connect()
    first.add_element(Element("skiros:Part", "left"), "memory")
    first.model.query("ASK {}")
    assert endpoint.graph("memory")
    second = connect()
    assert second.model.query('SELECT ?x { ?x rdfs:label "left" }') == []
    assert not endpoint.graph("memory")


# -- trouble ------------------------------------------------------------------------------------------------------


def test_an_endpoint_that_is_not_there_at_the_start_is_named(connect):
    url = f"http://localhost:{free_port()}/sparql"
    with pytest.raises(ConfigurationError, match=rf"SPARQL endpoint {url} cannot be reached: .*refused"):
        connect(url)


@pytest.mark.parametrize("url", ["nonsense", "ftp://localhost/x", "http://", "http://no host/", ""])
def test_invalid_url_is_named(url):
    with pytest.raises(ConfigurationError, match="SPARQL endpoint"):
        EndpointStore(url)


def test_an_endpoint_that_cannot_do_it_is_refused():
    with SparqlEndpoint(union=False) as endpoint, pytest.raises(ConfigurationError, match="unionDefaultGraph"):
        EndpointStore(endpoint.url)
    with SparqlEndpoint(heeds_graphs=False) as endpoint, pytest.raises(ConfigurationError, match="default-graph-uri"):
        EndpointStore(endpoint.url)


def test_one_that_takes_no_updates_is_refused(endpoint):
    readonly = SparqlEndpoint()
    with readonly:
        readonly.refuses = 403
        with pytest.raises(ConfigurationError, match=rf"{readonly.url} answered 403 .*not now"):
            EndpointStore(endpoint.url, readonly.url)


def test_user_and_password_are_sent_and_not_shown(endpoint):
    EndpointStore(endpoint.url.replace("//", "//robot:se%40cret@"))
    assert "Basic cm9ib3Q6c2VAY3JldA==" in endpoint.logins
    endpoint.refuses = 401
    with pytest.raises(ConfigurationError, match="answered 401") as error:
        EndpointStore(endpoint.url.replace("//", "//robot:se%40cret@"))
    assert "cret" not in str(error.value)


def test_queries_are_refused_and_writes_accepted_while_the_endpoint_is_down(connect, endpoint):
    wm = connect()
    first = add_box(wm)
    assert first in wm.model.query(BOXES)
    endpoint.stop()
    second = add_box(wm)
    wm.add_class("skiros:Crate", "skiros:LargeBox")
    for _ in range(2):
        with pytest.raises(Refused, match=rf"SPARQL endpoint {endpoint.url} cannot be reached"):
            wm.model.query(BOXES)
    crate = wm.add_element(Element("skiros:Crate", "one")).id
    assert wm.get_element(second).label == "box"
    endpoint.start()
    assert {first, second, crate} <= set(wm.model.query(BOXES))
    assert wm.model.query("SELECT ?c { ?c rdfs:subClassOf skiros:LargeBox }") == ["skiros:Crate"]


def test_one_that_lost_everything_is_given_it_again(connect, endpoint):
    wm = connect()
    first = add_box(wm)
    wm.add_element(Element("skiros:Part", "remembered"), "memory")
    assert first in wm.model.query(BOXES)
    endpoint.store.clear()  # as one in memory that was started anew
    second = add_box(wm)
    assert {first, second} <= set(wm.model.query(BOXES))
    assert wm.model.query('SELECT ?x { ?x rdfs:label "remembered" }') == ["skiros:Part-2"]


def test_one_that_goes_away_between_two_requests_is_given_all_again(connect, endpoint):
    wm = connect()
    for _ in range(600):
        add_box(wm)
    endpoint.refuses = 503
    with pytest.raises(Refused, match="answered 503"):
        wm.model.query(BOXES)
    endpoint.refuses = None
    update, taken = endpoint.store.update, []

    class Failing:
        """Takes a request, then none for a while."""

        def __getattr__(self, name):
            return getattr(endpoint_store, name)

        def update(self, text):
            taken.append(text)
            if len(taken) == 2:
                raise ValueError("out of memory")
            update(text)

    endpoint_store, endpoint.store = endpoint.store, Failing()
    with pytest.raises(SkirosError, match="out of memory"):
        for _ in range(3):
            wm.model.query(BOXES)
            add_box(wm)
    assert len([eid for eid in wm.model.query(BOXES) if "LargeBox-" in eid]) >= 600


def test_two_world_models_do_not_share_one(connect, endpoint):
    first, second = connect(), connect()
    add_box(second)
    second.model.query(BOXES)
    with pytest.raises(Refused, match=rf"{endpoint.url} is used by another world model now"):
        first.model.query(BOXES)
    add_box(first)  # goes on all the same


def test_changes_do_not_wait_for_an_endpoint_that_is_slow(connect, endpoint):
    wm = connect()
    add_box(wm)
    endpoint.silent = threading.Event()
    answers = []
    asking = threading.Thread(target=lambda: answers.append(wm.model.query(BOXES)))
    asking.start()
    for _ in range(5):
        eid = add_box(wm)
    wm.add_class("skiros:Crate", "skiros:LargeBox")
    assert asking.is_alive()
    assert wm.get_element(eid).label == "box"
    endpoint.silent.set()
    asking.join()
    assert len(answers) == 1
