"""Names, values and files that nobody sends on purpose: refused with their name, or kept and found everywhere alike."""

from __future__ import annotations

from types import SimpleNamespace

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from skiros2_common.core.element_content import relation_dict
from skiros2_common.core.errors import SkirosError
from skiros2_common.core.operations import Add, Patch, Relate, Remove, Update
from skiros2_common.core.property import Property
from skiros2_common.core.world_element import Element
from skiros2_world_model.core.local_world_model import LocalWorldModel, source_ontologies
from skiros2_world_model.core.replica import Replica, Snapshot
from skiros2_world_model.core.wm_errors import WmException
from skiros2_world_model.core.world_model import WorldModel
from support.fuzz import examples
from support.lab import LAB

SCENE = "skiros:Scene-0"
NO_NAMES = ["", ":", "skiros:", "a b", "x>", "[x", "50%", "a#b", "lab:\x01", "lab:\ud800", "http://a b", "http://a/%"]


def part(label="part", etype="skiros:Part", eid="", **values):
    element = Element(etype, label, eid)
    for key, value in values.items():
        prop = element.property_view[f"skiros:{key}"] = Property(f"skiros:{key}", type(value))
        prop.current = [value]  # as a message brings it
    return element


def stored_everywhere(wm: LocalWorldModel, name: str) -> bool:
    """Whether SPARQL and a scene that was saved and loaded have the same elements and relations as the index."""

    def content():
        elements = wm.resolve_elements(Element(""))
        relations = {(e.id, r["src"], r["type"], r["dst"]) for e in elements for r in e.relation_view}
        return {(e.id, e.type) for e in elements}, relations

    before = content()
    rows = wm.query_ontology("SELECT ?s ?t { ?s a ?t . FILTER(?t != owl:NamedIndividual) }", context="scene")
    assert set(rows) == {f"{eid} {etype} " for eid, etype in before[0]}
    wm.save("all.ttl")
    wm.load("all.ttl")
    assert content() == before
    return any(name in relation for relation in before[1])


# -- names ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", NO_NAMES)
def test_names_invalid_in_rdf_are_refused_in_every_position(wm, model, name):
    before = model.snapshot_id
    keyed = part()
    keyed.property_view[name] = Property(name, 1)
    related, target = part(), part()
    related._relations = [relation_dict(SCENE, name, "-1")]
    target._relations = [relation_dict("-1", "skiros:at", name)]
    for element in (part(etype=name), keyed, related, target):
        with pytest.raises(WmException) as error:
            wm.add_element(element)
        assert repr(name)[1:-1] in str(error.value)
    for value in (True, False):
        with pytest.raises(WmException):
            wm.set_relation(SCENE, name, SCENE, value)
    assert model.snapshot_id == before
    wm.query_ontology("ASK {}", context="scene")


@settings(max_examples=examples(200))
@given(
    st.text(st.characters(exclude_categories=[]), max_size=12),
    st.sampled_from(["", ":", "skiros:", "lab:", "SUMO:", "http://x.org/a#"]),
)
@example("Object", "SUMO:")
@example("Größe", "")
@example("Part-5", "")
def test_any_text_is_refused_as_a_name_or_works_as_one_everywhere(local, prefix):
    import tempfile
    from pathlib import Path

    with tempfile.TemporaryDirectory() as folder:
        wm = LocalWorldModel("tester", WorldModel(None, Path(folder)))
        element = part(etype=prefix + local)
        element._relations = [relation_dict(SCENE, "skiros:contain", "-1"), relation_dict("-1", prefix + local, SCENE)]
        element.property_view[prefix + local] = Property(prefix + local, 1.5)
        element.relation_view.append(relation_dict("-1", "skiros:at", "skiros:a_place"))
        try:
            wm.add_element(element)
        except WmException:
            assert wm.find_element(SCENE).version == 0
            stored_everywhere(wm, "")
        else:
            assert stored_everywhere(wm, element.type)
            assert [e.id for e in wm.resolve_elements(Element(element.type))] == [element.id]
            assert wm.get_relations(element.id, element.type, SCENE)
            assert wm.get_element(element.id).value_of(element.type) == 1.5


def test_an_individual_is_kept_under_its_full_name(wm):
    element = part()
    wm.add_element(element)
    wm.set_relation(element.id, "skiros:at", "somewhere")
    assert [r["dst"] for r in wm.get_relations(element.id, "skiros:at", "")] == ["skiros:somewhere"]
    assert stored_everywhere(wm, "skiros:somewhere")
    wm.set_relation(element.id, "skiros:at", "somewhere", False)
    assert wm.get_relations(element.id, "skiros:at", "") == []


@pytest.mark.parametrize("digits", [18, 19, 400, 5000])
def test_ids_with_long_numbers_do_no_harm(wm, digits):
    wanted = "skiros:Part-" + "9" * digits
    for _ in range(3):
        wm.add_element(part(eid=wanted))
    elements = wm.resolve_elements(Element("skiros:Part"))
    assert len({e.id for e in elements}) == 3
    stored_everywhere(wm, "")
    assert wm.find_element(wanted + "9") is None


# -- values --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "value",
    [10**400, "1" * 5000, "\ud800", ["\ud800"], {"\ud800": 1}, object(), part(), {1}, None, b"x", [object()], 1 + 2j],
    ids=lambda value: str(type(value)),
)
@pytest.mark.parametrize("key", ["SizeX", "ContainerState", "anything"])
def test_any_value_is_either_refused_or_stored_and_published(wm, model, key, value):
    before = model.snapshot_id
    try:
        wm.add_element(part(**{key: value}))
    except WmException as error:
        assert key in str(error)
        assert model.snapshot_id == before
    else:
        assert isinstance(value, (int, str, list, dict))
        kept = wm.resolve_element(Element("skiros:Part")).value_of(f"skiros:{key}")
        wm.save("all.ttl")
        wm.load("all.ttl")
        assert wm.resolve_element(Element("skiros:Part")).value_of(f"skiros:{key}") == kept
    wm.query_ontology("ASK {}", context="scene")


def test_values_nested_without_end_are_refused(wm):
    nested: list = []
    for _ in range(100_000):
        nested = [nested]
    with pytest.raises(WmException, match="anything"):
        wm.add_element(part(anything=nested))
    itself: dict = {}
    itself["me"] = itself
    with pytest.raises(WmException, match="anything"):
        wm.add_element(part(anything=itself))


def test_numbers_of_arrays_are_kept_as_numbers(wm):
    numpy = pytest.importorskip("numpy")
    element = part(anything=numpy.int64(3), other=numpy.float32(0.5), third=numpy.bool_(True))
    wm.add_element(element)
    values = [element.value_of(f"skiros:{key}") for key in ("anything", "other", "third")]
    assert [(type(v), v) for v in values] == [(int, 3), (float, 0.5), (bool, True)]


def test_a_label_that_is_no_text_is_refused(wm, model):
    with pytest.raises(WmException, match="label"):
        wm.add_element(part(label="\ud800"))
    element = part()
    wm.add_element(element)
    element.label = "\udfff"
    with pytest.raises(WmException, match=f"{element.id}.*label"):
        wm.update_element(element)
    wm.query_ontology("ASK {}", context="scene")


# -- files ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("filename", ["a\x00b.ttl", "\ud800.ttl", "x" * 5000, ".", "folder", "folder/../folder"])
def test_a_name_that_no_file_can_have_is_refused(wm, workspace, filename):
    (workspace / "folder").mkdir()
    for act in (wm.load, wm.save):
        with pytest.raises(WmException) as error:
            act(filename)
        assert repr(filename)[1:-1][:10] in str(error.value)
    assert [p.name for p in workspace.iterdir()] == ["folder"]


# -- what is told --------------------------------------------------------------------------------------------------


@pytest.fixture
def told(model):
    """The changes, and a replica that follows them and never has to fetch again."""
    scene = model.scene()
    fetched: list[Snapshot] = []

    def fetch():
        assert not fetched, "the changes lead on from what the replica has"
        fetched.append(Snapshot(model.snapshot_id, model.number, [scene.element(node.id) for node in scene]))
        return fetched[0]

    replica = Replica(fetch)
    replica.refresh()
    changes: list = []
    model.add_listener(changes.append)
    model.add_listener(replica.follow)
    return SimpleNamespace(changes=changes, replica=replica)


def same(model, replica):
    scenes = [{(n.id, n.type, n.label) for n in s} | set(s.relations()) for s in (model.scene(), replica.scene())]
    return scenes[0] == scenes[1]


def test_only_the_final_state_of_a_relation_is_published(wm, model, told):
    one, two = part(), part()
    wm.add_elements([one, two])
    there = Relate(one.id, "skiros:at", two.id)
    gone = Relate(one.id, "skiros:at", two.id, False)
    model.transact([there, gone], "tester")
    assert same(model, told.replica)
    model.transact([there], "tester")
    model.transact([gone, there], "tester")
    assert same(model, told.replica)
    assert model.scene().related(one.id, "skiros:at", two.id)


def test_relation_to_an_element_added_again_in_the_same_request_is_removed(wm, model, told):
    one, two = part(), part()
    wm.add_elements([one, two])
    model.transact([Relate(one.id, "skiros:at", two.id), Remove(two.id), Add(part(eid=two.id))], "tester")
    assert list(model.scene().relations()) == []
    assert same(model, told.replica)


def test_element_added_and_removed_in_one_request_is_not_published(wm, model, told):
    model.transact([Add(part(eid="skiros:Part-7")), Remove("skiros:Part-7")], "tester")
    assert [e.id for change in told.changes for e in change.elements] == []
    assert same(model, told.replica)


def test_relations_between_other_elements_are_published(wm, model, told):
    one, two = part(), part()
    wm.add_elements([one, two])
    third = part()
    third._relations = [relation_dict(one.id, "skiros:at", two.id)]
    wm.add_element(third)
    assert same(model, told.replica)
    changes = wm.get_element(third.id)
    changes._relations = []
    from skiros2_common.core.world_element import ElementChanges

    patch = Patch(third.id, ElementChanges(removed_relations=[relation_dict(one.id, "skiros:at", two.id)]))
    model.transact([patch], "tester")
    assert list(model.scene().relations()) == []
    assert same(model, told.replica)


def test_a_new_world_model_over_the_saved_scene_is_the_same(wm, workspace):
    tray = part(etype="skiros:LargeBox", label='"\\\n\t日本\x00')
    tray.addRelation(SCENE, "skiros:contain", "-1")
    wm.add_element(tray)
    wm.save("all.ttl")
    other = LocalWorldModel("other", WorldModel(source_ontologies(), workspace))
    other.load("all.ttl")
    assert other.get_element(tray.id).label == tray.label


# -- the class of an element -------------------------------------------------------------------------------------------


def test_values_that_another_class_does_not_allow_are_refused_with_the_change_of_the_class(workspace):
    (workspace / "lab.owl").write_text(LAB)
    wm = LocalWorldModel("tester", WorldModel(source_ontologies(), workspace))
    element = part()
    element.property_view["lab:note"] = Property("lab:note", ["one", "two"])
    wm.add_element(element)
    element.type = "lab:Crate"  # has one note at most
    with pytest.raises(WmException, match="lab:note has 2 values"):
        wm.update_element(element)
    crate = Element("lab:Crate")
    wm.add_element(crate)
    as_part = Element("skiros:Part", "", crate.id)
    as_part.property_view["lab:note"] = Property("lab:note", ["one", "two"])
    with pytest.raises(SkirosError, match="lab:note has 2 values"):
        wm.model.transact([Update(as_part, False, frozenset(["lab:note"]))], "tester")
    wm.save("all.ttl")
    wm.load("all.ttl")


def test_an_unknown_name_is_warned_of_once_for_each_author(caplog):
    model = WorldModel(source_ontologies())
    for author in ("one", "one", "other"):
        element = Element("skiros:Part")
        element.setProperty("skiros:Unheard", 1)
        LocalWorldModel(author, model).add_element(element)
    told = [record.getMessage() for record in caplog.records if "skiros:Unheard" in record.getMessage()]
    assert [line.partition(":")[0] for line in told] == ["one", "other"]


@pytest.mark.parametrize("name", ["skiros.ttl", "new.owl", "cell.owl.ttl", "cell.shapes.ttl"])
def test_no_scene_is_written_over_an_ontology_or_to_where_one_is_read_from(tmp_path, name):
    for file in source_ontologies().glob("*.ttl"):
        (tmp_path / file.name).write_bytes(file.read_bytes())
    before = (tmp_path / "skiros.ttl").read_bytes()
    wm = LocalWorldModel("test", WorldModel(tmp_path, tmp_path))
    with pytest.raises(WmException, match=f"{name}: is read as"):
        wm.save(name)
    wm.save("scene.ttl")
    assert (tmp_path / "skiros.ttl").read_bytes() == before
