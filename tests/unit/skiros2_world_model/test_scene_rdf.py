"""The Turtle of a scene equals its triples."""

import pyoxigraph as ox
from hypothesis import given
from hypothesis import strategies as st

from skiros2_common.core.property import Property
from skiros2_world_model.core.local_world_model import source_ontologies
from skiros2_world_model.core.rdf import turtle
from skiros2_world_model.core.scene import ElementRecord, Scene
from skiros2_world_model.core.scene_rdf import scene_triples
from skiros2_world_model.core.scene_turtle import scene_turtle
from skiros2_world_model.core.world_model import WorldModel

BASE = WorldModel(source_ontologies()).knowledge_base

IDS = st.sampled_from(
    ["skiros:Product-1", "lab:Crate-2", "skiros:odd.name-3", "http://x.org/y#Z-4", "http://x.org/Z-5"]
)
VALUES = st.one_of(
    st.booleans().map(lambda v: [v]),
    st.lists(st.integers(), min_size=1, max_size=3),
    st.lists(st.floats(), min_size=1, max_size=3),
    st.lists(st.text(st.characters(codec="utf-8")), min_size=1, max_size=3),
    st.sampled_from([["tab\there"], ['"quoted"'], ["back\\slash"], ["two\nlines"], ["a b.c:+-_"]]),
    st.lists(st.integers(), max_size=2).map(lambda v: [v]),
)
PROPERTIES = st.dictionaries(
    st.sampled_from(
        ["skiros:SizeX", "skiros:Flag", "skiros:anything", "lab:a-b", "rdfs:label", "lab:on", "http://x.org/50%25"]
    ),
    VALUES,
    max_size=3,
)
NODES = st.lists(
    st.tuples(IDS, st.sampled_from(["skiros:Product", "lab:Crate"]), st.text("a\n\"'", max_size=3), PROPERTIES)
)
RELATIONS = st.lists(st.tuples(IDS, st.sampled_from(["skiros:contain", "lab:on", "rdf:type"]), IDS))
EXTRAS = [
    ox.Triple(ox.NamedNode("http://x.org/y"), ox.NamedNode("http://x.org/y#p"), ox.Literal("chat", language="fr")),
    ox.Triple(ox.NamedNode(BASE.prefixes.iri("skiros:Product-1")), ox.NamedNode("http://x.org/y#p"), ox.BlankNode("b")),
    ox.Triple(ox.BlankNode("b"), ox.NamedNode("http://x.org/y#p"), ox.Literal("1", datatype=ox.NamedNode("x:t"))),
]


@given(NODES, RELATIONS, st.booleans())
def test_a_scene_is_written_as_its_triples_are(nodes, relations, with_extras):
    scene = Scene()
    for eid, etype, label, values in nodes:
        scene.put(ElementRecord(eid, etype, label, {key: Property(key, value) for key, value in values.items()}))
    for relation in relations:
        scene.relate(*relation)
    extras = EXTRAS if with_extras else []
    triples = [*scene_triples(scene, BASE.index, BASE.prefixes), *extras]
    text = scene_turtle(scene, scene.relations(), extras, BASE.index, BASE.prefixes)
    assert text == turtle(triples, BASE.prefixes.namespaces())
    read = [quad.triple for quad in ox.parse(text, ox.RdfFormat.TURTLE)]
    named = {t for t in triples if not isinstance(t.subject, ox.BlankNode)}
    assert {t for t in read if not isinstance(t.subject, ox.BlankNode)} == named
    assert len(set(read)) == len(set(triples))
