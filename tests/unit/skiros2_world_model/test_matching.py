"""Indexed searches for abstract elements return the same as a linear search."""

from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from skiros2_common.core.property import Property
from skiros2_common.core.world_element import Element
from skiros2_world_model.core import queries
from skiros2_world_model.core.local_world_model import source_ontologies
from skiros2_world_model.core.queries import containment_cycle, is_like, matching_ids
from skiros2_world_model.core.scene import ElementRecord, Scene
from skiros2_world_model.core.world_model import WorldModel
from support.fuzz import examples

ONTOLOGY = WorldModel(source_ontologies()).ontology


@pytest.fixture(autouse=True, scope="module")
def indexes_also_for_few():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(queries, "_FEW", 0)
        yield


TYPES = st.sampled_from(["skiros:Product", "skiros:Starter", "skiros:Location", "sumo:Object", "x:Other"])
LABELS = st.sampled_from(["", "a", "b"])
VALUES = st.sampled_from([1, 1.0, "1", "1.0", True, "true", 2, "x", "", [1], 0.0, -0.0])
PROPERTIES = st.dictionaries(
    st.sampled_from(["x:p", "x:q"]),
    st.one_of(VALUES.map(lambda v: [v]), st.lists(st.integers(1, 3), min_size=2, max_size=2)),
    max_size=2,
)


def properties(values):
    return {key: Property(key, value) for key, value in values.items()}


ELEMENTS = st.lists(st.tuples(st.integers(0, 12), TYPES, LABELS, PROPERTIES), max_size=30)


@given(ELEMENTS, ELEMENTS, st.sampled_from(["", "Unknown", "sumo:Object", "skiros:Product"]), LABELS, PROPERTIES)
@settings(max_examples=examples(200))
def test_matches_equal_those_of_a_linear_search(before, after, etype, label, values):
    scene = Scene()
    wanted = Element(etype, label)
    wanted._properties = properties(values)
    for elements in (before, after):  # the first question makes the indexes, the second has them
        for number, *content, held in elements:
            scene.put(ElementRecord(f"x:E-{number}", *content, properties(held)))
        likes = [node.id for node in scene if is_like(scene, ONTOLOGY, node.id, wanted)]
        assert sorted(matching_ids(scene, ONTOLOGY, wanted)) == sorted(likes)


def test_one_that_has_the_value_twice_is_found_once():
    scene = Scene()
    scene.put(ElementRecord("x:E-1", "x:T", "", properties({"x:p": ["1", "1.0"]})))
    wanted = Element("")
    wanted._properties = properties({"x:p": [1]})
    assert matching_ids(scene, ONTOLOGY, wanted) == ["x:E-1"]


NAMES = st.sampled_from("abcdef")


@given(st.sets(st.tuples(NAMES, st.sampled_from(["in", "on", "beside"]), NAMES)), st.sets(NAMES))
@settings(max_examples=examples(300))
def test_a_cycle_is_found_where_one_is_above(relations, below):
    scene = Scene()
    for name in "abcdef":
        scene.put(ElementRecord(name, "x:T", "", {}))
    for relation in relations:
        scene.relate(*relation)
    holders = {name: {s for s, p, d in relations if d == name and p != "beside"} for name in "abcdef"}
    cycle = containment_cycle(scene, {"in", "on"}, below)
    assert bool(cycle) == any(name in above(name, holders) for b in below for name in {b} | above(b, holders))
    assert all(holder in holders[name] for name, holder in pairwise(cycle))
    assert cycle[:1] == cycle[-1:]


def above(name, holders):
    found = set(holders[name])
    while more := {h for other in found for h in holders[other]} - found:
        found |= more
    return found
