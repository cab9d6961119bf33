"""Details of the contract of the world model port, for each adapter."""

from __future__ import annotations

import math
import threading

import pytest

from skiros2_common.core.world_element import Element
from skiros2_world_model.core.wm_errors import WmException

SCENE = "skiros:Scene-0"


def ids(elements):
    return [e.id for e in elements]


# -- ids and names -------------------------------------------------------------------------------------------------


def test_id_of_another_class_keeps_its_number(wm):
    assert wm.add_element(Element("skiros:Part", "part", "skiros:Product-70")).id == "skiros:Part-70"
    assert wm.add_element(Element("skiros:Part", "part", "some words")).id.startswith("skiros:Part-")


def test_names_are_short_or_iris(world, wm):
    part = world.add(":Part", "part")
    whole = world.add("http://rvmi.aau.dk/ontologies/skiros.owl#Part", "whole", relation="contain")
    assert part.type == whole.type == "skiros:Part"
    for name in ("Part", ":Part", "skiros:Part"):
        assert ids(wm.resolve_elements(Element(name))) == [part.id, whole.id]
    for name in ("contain", ":contain", "skiros:contain"):
        assert [r["type"] for r in wm.get_relations(SCENE, name, part.id)] == ["skiros:contain"]


def test_label_finds_elements_of_any_class(world, wm):
    part, tray = world.add("skiros:Part", "same"), world.add("skiros:LargeBox", "same")
    assert ids(wm.resolve_elements(Element("", "same"))) == [part.id, tray.id]
    assert ids(wm.resolve_elements(Element("Unknown", "same"))) == [part.id, tray.id]


def test_text_that_rdf_cannot_hold_is_refused(world, wm):
    part, half = world.add("skiros:Part", "part"), "\ud800"
    labelled, valued = Element("skiros:Part", half), Element("skiros:Part")
    valued.setProperty("skiros:anything", half)
    for act in (
        lambda: wm.add_element(labelled),
        lambda: wm.add_element(valued),
        lambda: wm.add_element(Element(half)),
        lambda: wm.set_relation(part, half, SCENE),
        lambda: wm.set_relation(part, "skiros:at", half),
        lambda: wm.query_ontology(f"ASK {{ ?x rdfs:label '{half}' }}"),
        lambda: wm.load(half),
        lambda: wm.save(half),
    ):
        with pytest.raises(WmException):
            act()
    assert ids(wm.get_scene_elements()) == [SCENE, part.id]


# -- values --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "value", [2**70, -0.0, math.inf, math.nan, True, "", "\x00\u2028日本", [], [[1], [2]], {}, {"a": None}]
)
def test_property_values_are_returned_unchanged(world, wm, value):
    part = world.add("skiros:Part", "part")
    part.setProperty("skiros:anything", [value])
    wm.update_element(part)
    found = world.connect("other").get_element(part.id).getProperty("skiros:anything")
    assert repr(found.values) == repr([value])
    assert found.dataType() is type(value)
    wm.query_ontology("ASK {}", context="scene")


def test_property_without_values_keeps_its_type(world, wm):
    part = world.add("skiros:Part", "part")
    part.setProperty("skiros:anything", float)
    wm.update_element(part)
    found = wm.get_element(part.id).getProperty("skiros:anything")
    assert (found.values, found.dataType()) == ([], float)


def test_text_is_converted_to_the_declared_type_of_a_property(world, wm):
    part = world.add("skiros:Part", "part", Weight="3", PublishTf="False", anything="3")
    found = wm.get_element(part.id)
    assert [found.value_of(f"skiros:{key}") for key in ("Weight", "PublishTf", "anything")] == [3.0, False, "3"]


# -- relations -----------------------------------------------------------------------------------------------------


def test_relation_is_removed_with_its_subproperties(world, wm):
    part = world.add("skiros:Part", "part")
    wm.set_relation(SCENE, "skiros:spatiallyRelated", part.id, False)
    assert wm.get_relations(SCENE, "", part.id) == []


def test_repeated_relation_is_stored_once(world, wm):
    part = world.add("skiros:Part", "part")
    before = wm.get_element(part.id)
    assert wm.set_relation(SCENE, "skiros:contain", part.id)
    assert len(wm.get_relations(SCENE, "skiros:contain", part.id)) == 1
    assert wm.get_element(part.id).version == before.version
    assert wm.set_relation(SCENE, "skiros:hasA", part.id, False)


def test_negated_and_abstract_relations_are_not_stored(world, wm):
    part = Element("skiros:Part", "part")
    part.addRelation(SCENE, "skiros:contain", "-1", value=False)
    part.addRelation("-1", "skiros:at", SCENE, abstract=True)
    wm.add_element(part)
    assert wm.get_element(part.id).getRelations() == []


def test_replacing_relation_is_written(world, wm):
    one, two = world.add("skiros:LargeBox", "one"), world.add("skiros:LargeBox", "two")
    part = world.add("skiros:Part", "part", one)
    part.setRelation(two.id, "skiros:contain", "-1")
    wm.update_element(part)
    assert [r["src"] for r in wm.get_relations("", "skiros:contain", part.id)] == [two.id]


def test_relation_to_an_individual_has_its_full_name(world, wm):
    part = world.add("skiros:Part", "part")
    wm.set_relation(part.id, "skiros:partReference", "starter")
    assert [r["dst"] for r in wm.get_relations(part.id, "skiros:partReference", "")] == ["skiros:starter"]


def test_cyclic_children_are_refused(wm):
    one, two = Element("skiros:LargeBox", "one"), Element("skiros:LargeBox", "two")
    one.addRelation("-1", "skiros:contain", two)
    two.addRelation("-1", "skiros:hasA", one)
    with pytest.raises(WmException, match="in itself"):
        wm.add_element(one)
    assert wm.resolve_elements(Element("skiros:LargeBox")) == []
    assert (one.id, two.id) == ("", "")


def test_long_chain_of_children_is_added_completely(wm):
    first = last = Element("skiros:LargeBox", "first")
    for number in range(2000):
        child = Element("skiros:LargeBox", f"child {number}")
        last.addRelation("-1", "skiros:contain", child)
        last = child
    wm.add_element(first)
    assert len(wm.get_branch(first.id)) == 2001
    wm.remove_element(first)
    assert wm.find_element(last.id) is None


# -- contexts ------------------------------------------------------------------------------------------------------


def test_relation_may_refer_to_another_context(world, wm):
    part = world.add("skiros:Part", "part")
    note = Element("skiros:Part", "note")
    note.addRelation("-1", "skiros:at", part.id)
    wm.add_element(note, "details")
    assert wm.get_element(note.id, "details").hasRelation("-1", "skiros:at", part.id)
    assert wm.get_element(note.id, "").label == "note"
    assert wm.get_element(part.id, "").label == "part"
    assert wm.query_ontology("SELECT ?l { ?n :at ?p . ?p rdfs:label ?l }", context="") == ["part"]


@pytest.mark.parametrize("context", ["a/b", "ontology", "two words", "<x>", "\x00"])
def test_invalid_context_name_is_refused(wm, context):
    with pytest.raises(WmException) as error:
        wm.add_element(Element("skiros:Part"), context)
    assert repr(context)[1:-1] in str(error.value).replace("\\\\", "\\")
    assert wm.resolve_elements(Element("skiros:Part")) == []


# -- elements that are held for long -------------------------------------------------------------------------------


def test_write_of_a_removed_element_names_it(world, wm):
    part = world.add("skiros:Part", "part")
    held = wm.get_element(part.id)
    wm.remove_element(part)
    held.label = "late"
    for write in (wm.update_element, wm.update_element_properties, wm.remove_element):
        with pytest.raises(WmException, match=part.id):
            write(held)
    assert wm.find_element(part.id) is None


def test_concurrent_changes_are_kept(world, wm):
    part = world.add("skiros:Part", "part", SizeX=1.0)
    held = wm.get_element(part.id)
    tray = world.add("skiros:LargeBox", "tray")
    wm.set_relation(part.id, "skiros:at", tray.id)
    mine = wm.get_element(part.id)
    mine.setProperty("skiros:SizeX", 2.0)
    mine.label = "renamed"
    wm.update_element(mine)
    held.setProperty("skiros:SizeY", 3.0)
    wm.update_element(held)
    found = wm.get_element(part.id)
    assert (found.label, found.value_of("skiros:SizeX"), found.value_of("skiros:SizeY")) == ("renamed", 2.0, 3.0)
    assert found.hasRelation("-1", "skiros:at", tray.id)
    assert held.label == "renamed"


# -- files ---------------------------------------------------------------------------------------------------------


def test_scene_with_special_characters_is_read_by_other_rdf_tools(world, wm):
    rdflib = pytest.importorskip("rdflib")
    part = world.add("skiros:Part", 'a "red" \\ one\n\t日本\x00', anything='é\'"""', flow=[1, 2], SizeX=0.1)
    world.add("lab:Größe", "x.y")
    wm.save("odd.ttl")
    graph = rdflib.Graph().parse(world.workspace / "odd.ttl")
    iri = rdflib.URIRef(f"http://rvmi.aau.dk/ontologies/skiros.owl#{part.id.partition(':')[2]}")
    assert str(graph.value(iri, rdflib.RDFS.label)) == part.label
    assert len(list(graph.objects(iri, rdflib.URIRef("http://rvmi.aau.dk/ontologies/skiros.owl#flow")))) == 2
    graph.serialize(world.workspace / "theirs.ttl", format="turtle")
    wm.load("theirs.ttl")
    found = wm.get_element(part.id)
    assert (found.label, found.value_of("skiros:anything"), found.value_of("skiros:SizeX")) == (
        part.label,
        'é\'"""',
        0.1,
    )
    assert [e.label for e in wm.resolve_elements(Element("lab:Größe"))] == ["x.y"]


@pytest.fixture
def slow_monitor(wm):
    """What is published reaches the client late."""
    never = threading.Event()

    def wait(change):
        never.wait(0.2)

    wm.add_listener(wait)
    yield
    wm.remove_listener(wait)


def test_client_reads_the_scene_it_loaded(world, wm, slow_monitor):
    world.add("skiros:Part", "part")
    assert len(wm.resolve_elements(Element("skiros:Part"))) == 1
    wm.load("blank.ttl")
    assert wm.resolve_elements(Element("skiros:Part")) == []


def test_client_reads_its_own_statements(world, wm, slow_monitor):
    world.add("skiros:Part", "part")
    wm.add_individual(Element("skiros:Part", "skiros:Part-70"), "scene")
    assert wm.find_element("skiros:Part-70") is not None


@pytest.mark.parametrize("filename", [".", "a\x00b", "x" * 300, "folder"])
def test_invalid_file_name_is_refused(world, wm, filename):
    (world.workspace / "folder").mkdir(exist_ok=True)
    for act in (wm.load, wm.save):
        with pytest.raises(WmException) as error:
            act(filename)
        assert len(str(error.value)) > len("refused")
    assert ids(wm.get_scene_elements()) == [SCENE]
