"""The RDF graph of a context is kept in step with its scene."""

import contextlib

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from skiros2_common.core.errors import SkirosError
from skiros2_common.core.operations import Add, Patch, Relate, Remove
from skiros2_common.core.property import Property
from skiros2_common.core.world_element import Element, ElementChanges
from skiros2_world_model.core.local_world_model import source_ontologies
from skiros2_world_model.core.world_model import WorldModel
from support.fuzz import examples


def graph(model, context="scene"):
    """The triples that SPARQL sees."""
    rows = model.query("SELECT ?s ?p ?o { ?s ?p ?o }", context, cut_prefix=False)
    return {row.removesuffix(" ") for row in rows}


def graph_of_the_text(model, tmp_path):
    """The triples of the scene when it is written and loaded by another world model."""
    model.save("copy.ttl")
    other = WorldModel(source_ontologies(), tmp_path)
    other.load("copy.ttl", "test")
    return graph(other)


IDS = st.sampled_from([f"skiros:Product-{number}" for number in range(1, 6)])
VALUES = st.one_of(st.booleans(), st.integers(), st.floats(-1e6, 1e6, width=32), st.text(max_size=5))
OPERATIONS = st.one_of(
    st.builds(Add, st.builds(Element, st.just("skiros:Product"), st.text(max_size=3))),
    st.builds(
        lambda eid, key, value: Patch(eid, ElementChanges({key: Property(key, [value])})),
        IDS,
        st.sampled_from(["skiros:Value", "skiros:ContainerState", "skiros:PositionX"]),
        VALUES,
    ),
    st.builds(lambda eid: Patch(eid, ElementChanges({}, ["skiros:Value"], label="new")), IDS),
    st.builds(Relate, IDS, st.sampled_from(["skiros:contain", "skiros:at"]), IDS, st.booleans()),
    st.builds(Remove, IDS, st.booleans()),
)


@given(st.lists(st.lists(OPERATIONS, max_size=4), max_size=8), st.data())
@settings(max_examples=examples(60))
def test_synced_graph_equals_the_saved_file(tmp_path_factory, requests, data):
    folder = tmp_path_factory.mktemp("ws")
    model = WorldModel(source_ontologies(), folder)
    for request in requests:
        with contextlib.suppress(SkirosError):
            model.transact(request, "test")
        if data.draw(st.booleans()):
            graph(model)  # brings the graph up to date on the way
    assert graph(model) == graph_of_the_text(model, folder)


def test_a_refused_request_leaves_no_triple(model):
    before = graph(model)
    with pytest.raises(SkirosError):
        model.transact([Add(Element("skiros:Product", "a")), Relate("skiros:Scene-0", "skiros:contain", "x-9")], "test")
    assert graph(model) == before


def test_triples_that_no_element_holds_stay_through_changes_and_are_saved(model, workspace):
    (workspace / "scene.ttl").write_text(
        """@prefix : <http://rvmi.aau.dk/ontologies/skiros.owl#> .
        @prefix owl: <http://www.w3.org/2002/07/owl#> .
        @prefix rdfs: <http://www.w3.org/2000/01/rdf-schema#> .
        <http://x.org/my_scene> a owl:Ontology ; rdfs:comment "two trays" .
        :Scene-0 a :Scene .
        :LargeBox-1 a :LargeBox, :Location ; rdfs:label "tray", "bandeja" ."""
    )
    model.load("scene.ttl", "test")
    model.transact([Patch("skiros:LargeBox-1", ElementChanges(label="other"))], "test")
    model.save("scene.ttl")
    text = (workspace / "scene.ttl").read_text()
    assert "two trays" in text
    assert "a skiros:Location ;" in text
    assert graph(model) == graph_of_the_text(model, workspace)
