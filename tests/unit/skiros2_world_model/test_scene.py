"""The scene: lookups, ids, relations in both directions, and transactions."""

import contextlib
import copy

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from skiros2_common.core.property import Property
from skiros2_world_model.core.scene import ChangeInfo, ChangeSet, ElementRecord, Scene, apply
from support.fuzz import examples


def node(eid, etype="a:T", label="", **values):
    return ElementRecord(eid, etype, label, {f"a:{key}": Property(f"a:{key}", value) for key, value in values.items()})


@pytest.fixture
def scene():
    scene = Scene()
    for eid in ("a:T-1", "a:T-2", "a:T-3"):
        scene.put(node(eid))
    return scene


def test_an_element_is_found_by_id_type_and_label():
    scene = Scene()
    scene.put(node("a:T-1", "a:T", "tray", size=2))
    assert scene.element("a:T-1").value_of("a:size") == 2
    assert list(scene.of_type("a:T")) == ["a:T-1"]
    assert list(scene.of_label("tray")) == ["a:T-1"]
    assert scene.element("a:T-2") is None


def test_new_content_moves_the_element_to_its_new_type_and_label(scene):
    scene.put(node("a:T-1", "a:U", "tray"))
    assert "a:T-1" not in scene.of_type("a:T")
    assert list(scene.of_type("a:U")) == ["a:T-1"]
    assert list(scene.of_label("")) == ["a:T-2", "a:T-3"]


def test_relations_are_seen_from_both_ends_and_minus_one_is_the_element(scene):
    scene.relate("a:T-1", "a:holds", "a:T-2")
    (out,), (back,) = scene.relations_of("a:T-1"), scene.relations_of("a:T-2")
    assert out == {"src": "-1", "type": "a:holds", "dst": "a:T-2", "state": True, "abstract": False}
    assert back == {"src": "a:T-1", "type": "a:holds", "dst": "-1", "state": True, "abstract": False}


def test_the_same_relation_is_there_once(scene):
    assert scene.relate("a:T-1", "a:holds", "a:T-2")
    assert not scene.relate("a:T-1", "a:holds", "a:T-2")
    assert scene.unrelate("a:T-1", "a:holds", "a:T-2")
    assert not scene.unrelate("a:T-1", "a:holds", "a:T-2")
    assert scene.relations_of("a:T-1") == ()


def test_relations_are_asked_for_by_any_of_their_parts(scene):
    scene.relate("a:T-1", "a:holds", "a:T-2")
    scene.relate("a:T-1", "a:sees", "a:T-3")
    scene.relate("a:T-2", "a:holds", "a:T-3")
    ask = lambda *parts: set(scene.relations(*parts))  # noqa: E731
    assert ask("a:T-1") == {("a:T-1", "a:holds", "a:T-2"), ("a:T-1", "a:sees", "a:T-3")}
    assert ask("", ["a:holds"]) == {("a:T-1", "a:holds", "a:T-2"), ("a:T-2", "a:holds", "a:T-3")}
    assert ask("", None, "a:T-3") == {("a:T-1", "a:sees", "a:T-3"), ("a:T-2", "a:holds", "a:T-3")}
    assert ask("a:T-1", ["a:sees"], "a:T-2") == set()


def test_an_element_that_was_given_out_stays_as_it_was(scene):
    given_out = scene.element("a:T-1")
    scene.put(node("a:T-1", "a:T", "", size=3))
    scene.relate("a:T-1", "a:holds", "a:T-2")
    assert given_out.value_of("a:size") is None
    assert given_out.getRelations() == []


def test_a_removed_element_takes_its_relations_with_it(scene):
    scene.relate("a:T-1", "a:holds", "a:T-2")
    scene.relate("a:T-2", "a:holds", "a:T-3")
    scene.drop("a:T-2")
    assert scene.relations_of("a:T-1") == scene.relations_of("a:T-3") == ()
    assert list(scene.relations()) == []


def test_a_number_is_free_when_no_id_of_any_type_has_it(scene):
    assert scene.free_id("a:U") == "a:U-4"
    assert scene.free_id("a:U", 2) == "a:U-4"
    assert scene.free_id("a:U", 0) == "a:U-0"
    assert scene.free_id("a:U", 80) == "a:U-80"


def test_the_next_free_number_is_taken_when_one_is_not():
    scene = Scene()
    for number in (5, 6, 20):
        scene.put(node(f"a:T-{number}"))
    assert scene.free_id("a:T", 5) == "a:T-7"
    assert scene.free_id("a:T", 20) == "a:T-21"


def test_a_new_number_is_never_one_of_an_element_that_is_gone():
    scene = Scene()
    scene.put(node("a:T-7"))
    scene.drop("a:T-7")
    assert scene.free_id("a:T") == "a:T-8"


def test_one_number_may_stand_under_two_types():
    scene = Scene()
    scene.put(node("a:T-7"))
    scene.put(node("a:U-7"))
    scene.drop("a:U-7")
    assert scene.free_id("a:V", 7) == "a:V-8"


def test_changed_records_have_the_provenance_of_the_change(scene):
    scene.begin()
    scene.relate("a:T-1", "a:holds", "a:T-2")
    scene.commit(ChangeInfo(7, 1.0, "me"))
    assert [scene.element(eid).version for eid in ("a:T-1", "a:T-2", "a:T-3")] == [7, 7, 0]


def test_equal_properties_are_one_object(scene):
    for eid in ("a:T-1", "a:T-2"):
        scene.put(node(eid, size=2.5, name="x"))
    one, other = scene.record("a:T-1"), scene.record("a:T-2")
    assert all(one.properties[key] is other.properties[key] for key in ("a:size", "a:name"))


def test_a_property_that_all_share_is_changed_on_one_element_only(scene):
    for eid in ("a:T-1", "a:T-2"):
        scene.put(node(eid, size=2.5))
    scene.element("a:T-1").setProperty("a:size", 3.0)
    assert scene.element("a:T-1").value_of("a:size") == scene.element("a:T-2").value_of("a:size") == 2.5


def test_unsynced_changes_are_recorded_only_for_a_graph_sync(scene):
    assert scene.unsynced is None
    scene.unsynced = ChangeSet()
    scene.put(node("a:T-1", size=1))
    scene.relate("a:T-2", "a:holds", "a:T-3")
    assert list(scene.unsynced.records) == ["a:T-1"]
    assert scene.unsynced.relations == {("a:T-2", "a:holds", "a:T-3"): True}


def test_unsynced_changes_do_not_grow_with_elements_that_come_and_go(scene):
    scene.put(node("a:T-1"))
    scene.unsynced = ChangeSet()
    for number in range(2, 1000):
        scene.put(node(f"a:Guest-{number}"))
        scene.relate("a:T-1", "a:holds", f"a:Guest-{number}")
        scene.drop(f"a:Guest-{number}")
    assert not scene.unsynced
    scene.drop("a:T-1")
    assert list(scene.unsynced.records) == ["a:T-1"]


def test_relations_are_read_right_also_when_many_elements_were_read_before():
    scene = Scene()
    for number in range(2500):
        scene.put(node(f"a:T-{number}"))
        scene.relate("a:T-0", "a:holds", f"a:T-{number}")
    for number in (*range(2500), 0, 1):
        assert {"src": "a:T-0", "type": "a:holds", "dst": "-1", "state": True, "abstract": False} in (
            scene.relations_of(f"a:T-{number}")
        )
    assert len(scene.relations_of("a:T-0")) == 2501


IDS = st.sampled_from([f"a:T-{number}" for number in range(5)])
STEPS = st.lists(
    st.one_of(
        st.tuples(st.just("put"), IDS, st.sampled_from(["a:T", "a:U"]), st.integers(0, 3)),
        st.tuples(st.just("drop"), IDS),
        st.tuples(st.just("relate"), IDS, st.sampled_from(["a:p", "a:q"]), IDS),
        st.tuples(st.just("unrelate"), IDS, st.sampled_from(["a:p", "a:q"]), IDS),
    ),
    max_size=25,
)


class Model:
    """What a scene should be, said in the simplest way."""

    def __init__(self):
        self.nodes = {}
        self.relations = set()

    def apply(self, step, scene):
        kind, eid = step[:2]
        if kind == "put":
            made = node(eid, step[2], f"label {step[3]}", size=step[3])
            self.nodes[eid] = (step[2], step[3])
            scene.put(made)
        elif kind == "drop" and eid in self.nodes:
            del self.nodes[eid]
            self.relations = {r for r in self.relations if eid not in (r[0], r[2])}
            scene.drop(eid)
        elif kind == "relate" and eid in self.nodes:
            self.relations.add(step[1:])
            scene.relate(*step[1:])
        elif kind == "unrelate":
            self.relations.discard(step[1:])
            scene.unrelate(*step[1:])

    def holds(self, scene):
        assert {n.id: (n.type, n.properties["a:size"].value) for n in scene} == self.nodes
        assert set(scene.relations()) == self.relations
        for eid, (etype, size) in self.nodes.items():
            assert eid in scene.of_type(etype)
            assert eid in scene.of_label(f"label {size}")
            seen = {(r["src"], r["type"], r["dst"]) for r in scene.relations_of(eid)}
            out = {("-1", p, d) for s, p, d in self.relations if s == eid}
            back = {(s, p, "-1") for s, p, d in self.relations if d == eid}
            assert seen == out | back
        assert {eid for t in scene.types() for eid in scene.of_type(t)} == set(self.nodes)
        for size in range(4):
            having = {eid for group in scene.of_value("a:size", size) for eid in group}
            assert having == {eid for eid, (_, s) in self.nodes.items() if s == size}


@given(STEPS, STEPS, st.sampled_from(["commit", "roll back", "invert", "read and invert", "nested"]), st.booleans())
@settings(max_examples=examples(200))
def test_index_matches_a_model_after_random_changes_and_roll_backs(first, second, ending, by_value):
    scene, model = Scene(), Model()
    if by_value:
        scene.of_value("a:size", 0)  # from here on kept up to date
    for step in first:
        model.apply(step, scene)
    before = copy.deepcopy(model)
    scene.begin()
    if ending == "nested":
        with contextlib.suppress(LookupError), scene.nested():
            for step in second:
                model.apply(step, scene)
            raise LookupError
    else:
        for step in second:
            model.apply(step, scene)
    if ending == "roll back":
        scene.roll_back()
    else:
        changes = scene.commit(ChangeInfo(1, 1.0, "me"))
        if ending == "read and invert":
            changes = ChangeSet.from_json(changes.to_json())
        if ending != "commit":
            apply(changes.inverse(), scene)
    (model if ending == "commit" else before).holds(scene)
