"""The world model client, as programs written for SkiROS2 use it."""

import pytest

from compatibility.rules import rule
from contract.conftest import write_workspace
from skiros2_common.core.params import ParamHandler, ParamTypes
from skiros2_common.core.world_element import Element
from skiros2_world_model.core.local_world_model import LocalWorldModel, source_ontologies
from skiros2_world_model.core.world_model import WorldModel
from skiros2_world_model.core.world_model_abstract_interface import WmException

SCENE = "skiros:Scene-0"


@pytest.fixture
def wmi(tmp_path):
    model = WorldModel(source_ontologies(), write_workspace(tmp_path / "workspace"))
    client = LocalWorldModel("tester", model)
    client.load("blank.ttl")
    return client


def add(wmi, etype, label="", parent=SCENE, context="scene", **properties):
    element = Element(etype, label)
    for key, value in properties.items():
        element.setProperty(key, value)
    if parent:
        element.addRelation(parent, "skiros:contain", "-1")
    return wmi.add_element(element, context)


def ids(elements):
    return [e.id for e in elements]


@rule("client", "`add_element`, `add_elements` give the new elements with id; the given ones get the id too")
def test_adding_gives_the_new_elements(wmi):
    box, part = Element("skiros:LargeBox", "box"), Element("skiros:Part", "part")
    part.setProperty("Weight", 2)
    (made_box, made_part) = wmi.add_elements([box, part])
    assert (made_box.id, made_part.id) == (box.id, part.id)
    assert made_part.getProperty("Weight").value == 2.0
    single = Element("skiros:Part")
    assert wmi.add_element(single).id == single.id != ""


@rule("client", "`get_scene()` gives (elements, snapshot id)", better="`get_scene_elements()` gives the list alone")
def test_get_scene(wmi):
    part = add(wmi, "skiros:Part")
    elements, snapshot = wmi.get_scene()
    assert set(ids(elements)) == {SCENE, part.id} == set(ids(wmi.get_scene_elements()))
    part.setProperty("Weight", 1.0)
    wmi.update_element(part)
    assert wmi.get_scene()[1] not in ("", snapshot)


@rule("client", "`remove_element` takes an element or an id and gives 1; the element loses its id")
def test_remove_element(wmi):
    part, other = add(wmi, "skiros:Part"), add(wmi, "skiros:Part")
    eid = part.id
    assert wmi.remove_element(part) == 1
    assert part.id == ""
    assert wmi.remove_element(other.id) == 1
    assert not wmi.is_scene_element(eid)
    assert not wmi.is_scene_element(other.id)


@rule("client", "`lock()` and `unlock()` give True; unlocking what is not locked gives False")
def test_lock_and_unlock(wmi):
    assert wmi.lock() is True
    assert wmi.unlock() is True
    assert wmi.unlock() is False


@rule("client", "`save`, `load`, `add_class`, `add_ontology` give True; `load` of a missing file raises `WmException`")
def test_calls_that_give_true(wmi):
    assert wmi.save("kept.ttl") is True
    assert wmi.load("kept.ttl") is True
    assert wmi.add_class("skiros:Tote", "skiros:Container") is True
    assert wmi.add_ontology("http://x.org/lab.owl") is True
    with pytest.raises(WmException, match="missing"):
        wmi.load("missing.ttl")


@rule("client", "`add_prefix(name)` gives the name with the default prefix where it has none, and an IRI in `<...>`")
@pytest.mark.parametrize(
    ("name", "full"),
    [
        ("X", "skiros:X"),
        (":X", "skiros:X"),
        ("lab:X", "lab:X"),
        ("http://x.org/a.owl#X", "<http://x.org/a.owl#X>"),
    ],
)
def test_add_prefix(wmi, name, full):
    assert wmi.add_prefix(name) == full


@rule("client", "`remove_prefix(name)` gives the text after `#` or `:`")
@pytest.mark.parametrize("name", ["skiros:X", ":X", "X", "http://x.org/a.owl#X"])
def test_remove_prefix(wmi, name):
    assert wmi.remove_prefix(name) == "X"


@rule("client", "`get_type(x)` gives the list of the types of `x`, `[]` when it is unknown")
def test_get_type(wmi):
    part = add(wmi, "skiros:Part")
    assert "skiros:Part" in wmi.get_type(part.id)
    assert wmi.get_type("skiros:Part") == ["owl:Class"]
    assert "factory:Pallet" in wmi.get_type("factory:euro_pallet")
    for unknown in ("skiros:Crate", "other:Crate"):
        assert wmi.get_type(unknown) == []
        if not wmi.get_type(unknown):
            wmi.add_class(unknown, "skiros:Container")
        assert wmi.get_type(unknown) == ["owl:Class"]


@rule("client", "`get_types(c)` gives everything that is of type `c`: elements, classes, properties")
def test_get_types(wmi):
    part = add(wmi, "skiros:Part")
    assert part.id in wmi.get_types("skiros:Part")
    assert "skiros:Part" in wmi.get_types("owl:Class")
    assert "skiros:contain" in wmi.get_types("owl:ObjectProperty")


@rule("client", "`get_triples(s, p, o)` gives texts of the open positions, separated by a space")
def test_get_triples(wmi):
    part = add(wmi, "skiros:Part", "part")
    assert wmi.get_triples(SCENE, "skiros:contain") == [part.id]
    assert wmi.get_triples(obj=part.id) == [f"{SCENE} skiros:contain"]
    assert "rdfs:label part" in wmi.get_triples(part.id)


@rule("client", "`get_individuals(c, recursive)` gives individuals of the ontologies and elements of the scene")
def test_get_individuals(wmi):
    box, pallet = add(wmi, "skiros:LargeBox"), add(wmi, "factory:Pallet")
    assert {box.id, pallet.id, "factory:euro_pallet"} <= set(wmi.get_individuals("skiros:Container"))
    assert wmi.get_individuals("skiros:Container", False) == []
    assert wmi.get_individuals("factory:Pallet", False) == sorted(["factory:euro_pallet", pallet.id])


@rule("client", "`get_sub_classes`, `get_sub_properties`: recursive with the name itself, else the direct ones alone")
def test_sub_classes_and_properties(wmi):
    assert set(wmi.get_sub_classes("skiros:Container")) == {"factory:Pallet", "skiros:Container", "skiros:LargeBox"}
    assert set(wmi.get_sub_classes("skiros:Container", False)) == {"factory:Pallet", "skiros:LargeBox"}
    assert wmi.get_sub_classes("skiros:LargeBox") == ["skiros:LargeBox"]
    assert wmi.get_sub_classes("skiros:LargeBox", False) == []
    spatial = {"skiros:spatiallyRelated", "skiros:contain", "skiros:hasA"}
    assert set(wmi.get_sub_properties("skiros:spatiallyRelated")) == spatial
    assert set(wmi.get_sub_properties("skiros:spatiallyRelated", False)) == spatial - {"skiros:spatiallyRelated"}
    assert wmi.get_sub_properties("skiros:contain") == ["skiros:contain"]
    for recursive in (True, False):
        assert wmi.get_sub_classes("skiros:NoSuch", recursive) == []
        assert wmi.get_sub_properties("skiros:noSuch", recursive) == []


@rule("client", '`get_super_class` of an unknown class gives `""`; `get_datatype` gives None where none is declared')
def test_super_class_and_datatype(wmi):
    assert wmi.get_super_class("skiros:NoSuch") == ""
    assert wmi.get_super_class("factory:Pallet") == "skiros:Container"
    assert wmi.get_datatype("skiros:noSuch") is None
    assert wmi.get_datatype("skiros:PositionX") == "xsd:float"


@rule("client", "`get_relations` with both ids gives dicts as the subject has them: `src` is `-1`")
def test_relations_between_two_ids(wmi):
    part = add(wmi, "skiros:Part")
    (relation,) = wmi.get_relations(SCENE, "skiros:contain", part.id)
    assert (relation["src"], relation["type"], relation["dst"]) == ("-1", "skiros:contain", part.id)
    assert wmi.get_element(SCENE).hasRelation(relation["src"], relation["type"], relation["dst"])
    assert wmi.get_relations("", "skiros:contain", part.id)[0]["src"] == SCENE


@rule("client", "`get_relations` with the subject `-1`, which matches any, or without a predicate gives ids, not `-1`")
def test_relations_with_an_open_subject_or_predicate(wmi):
    part = add(wmi, "skiros:Part")
    contained = wmi.get_relations("-1", "skiros:contain", part.id)
    assert [(r["src"], r["type"], r["dst"]) for r in contained] == [(SCENE, "skiros:contain", part.id)]
    assert wmi.get_relations(SCENE, "", part.id) == contained
    assert wmi.get_relations("-1", "", part.id) == contained
    assert wmi.get_relations("-1", "skiros:hasA", part.id) == []


@rule("client", "`instanciate(uri)` takes an element too")
def test_instanciate_an_element(wmi):
    template = wmi.get_template_element("skiros:starter")
    made = wmi.instanciate(template)
    assert (made.type, made.label) == ("skiros:Starter", "skiros:starter")
    made.label = "left starter"
    wmi.update_element(made)
    assert wmi.instanciate(made).label == "skiros:starter"


@rule("client", "`_resolve_elements2(key, ph)` gives a dict with an array of elements under the key")
def test_resolve_one_parameter(wmi):
    boxes = [add(wmi, "skiros:LargeBox"), add(wmi, "skiros:LargeBox")]
    part = add(wmi, "skiros:Part")
    ph = ParamHandler()
    ph.addParam("Box", Element("skiros:LargeBox"), ParamTypes.Inferred)
    ph.addParam("Part", part, ParamTypes.Required)
    for keys in ("Box", ["Box"]):
        found = wmi._resolve_elements2(keys, ph)
        assert list(found) == ["Box"]
        assert ids(found["Box"]) == ids(boxes)
    assert ids(wmi._resolve_elements2("Part", ph)["Part"]) == [part.id]


@rule("client", "`_resolve_elements2(keys, ph)` gives rows that fit the relations noted on the abstract elements")
@pytest.mark.parametrize(("state", "inside"), [(True, [1]), (False, [0])])
def test_resolve_related_parameters(wmi, state, inside):
    boxes = [add(wmi, "skiros:LargeBox"), add(wmi, "skiros:LargeBox")]
    part = add(wmi, "skiros:Part", parent=boxes[1].id)
    ph = ParamHandler()
    wanted = Element("skiros:LargeBox")
    wanted.addRelation("-1", "contain", "Part", state)
    ph.addParam("Box", wanted, ParamTypes.Inferred)
    ph.addParam("Part", Element("skiros:Part"), ParamTypes.Inferred)
    rows = wmi._resolve_elements2(["Box", "Part"], ph)["Box", "Part"]
    assert [ids(row) for row in rows] == [[boxes[i].id, part.id] for i in inside]
    assert ids(wmi._resolve_elements2("Box", ph)["Box"]) == [boxes[i].id for i in inside]


@rule("client", "A relation noted on an abstract element may name an id; nothing fits one that does not exist")
def test_resolve_with_a_relation_to_an_id(wmi):
    box = add(wmi, "skiros:LargeBox")
    part, _other = add(wmi, "skiros:Part", parent=box.id), add(wmi, "skiros:Part")
    ph = ParamHandler()
    inside, nowhere = Element("skiros:Part"), Element("skiros:Part")
    inside.addRelation(box.id, "skiros:contain", "-1")
    nowhere.addRelation("skiros:LargeBox-999", "skiros:contain", "-1")
    ph.addParam("Inside", inside, ParamTypes.Inferred)
    ph.addParam("Nowhere", nowhere, ParamTypes.Inferred)
    assert ids(wmi._resolve_elements2("Inside", ph)["Inside"]) == [part.id]
    assert ids(wmi._resolve_elements2("Nowhere", ph)["Nowhere"]) == []


@rule("client", "`query_ontology` with several columns: each value is followed by a space")
def test_query_with_several_columns(wmi):
    part = add(wmi, "skiros:Part", "part")
    query = "SELECT ?x ?l WHERE { ?x a skiros:Part ; rdfs:label ?l }"
    assert wmi.query_ontology(query, context="scene") == [f"{part.id} part "]
    assert wmi.query_ontology(query.replace(" ?l WHERE", " WHERE"), context="scene") == [part.id]


@rule("client", "Names are kept as written in an element and are full names in the world model")
def test_names_are_normalised_when_written(wmi):
    element = Element("Part", "part")
    element.setProperty("Hello", "you")
    element.addRelation(SCENE, "contain", "-1")
    found = wmi.get_element(wmi.add_element(element).id)
    assert (found.type, found.getProperty("skiros:Hello").value) == ("skiros:Part", "you")
    assert found.hasRelation(SCENE, "skiros:contain", "-1")
    wanted = Element("Part")
    wanted.setProperty(":Hello", "you")
    assert ids(wmi.resolve_elements(wanted)) == [found.id]
    other = Element("Part", "", found.id)
    other.setProperty("Hello", "all")
    wmi.update_element_properties(other)
    assert wmi.get_element(found.id).value_of("skiros:Hello") == "all"


# -- contexts ------------------------------------------------------------------------------------------------------


@rule("client", "A context is made when a request names it, also a read; a resolve in it gives `[]`")
def test_context_is_created_when_first_named(wmi):
    assert wmi.resolve_elements(Element("skiros:Part"), "database") == []
    assert wmi.query_ontology("SELECT ?x WHERE { ?x ?y ?z }", context="notes") == []
    assert wmi.save("diary.ttl", "diary")


@rule("client", "Ids are unique over all contexts")
def test_ids_are_unique_over_all_contexts(wmi):
    parts = [add(wmi, "skiros:Part", parent="", context=c) for c in ("scene", "database", "scene", "notes", "database")]
    wanted = Element("skiros:Part", "wanted", parts[0].id)
    parts.append(wmi.add_element(wanted, "notes"))
    assert len({part.getIdNumber() for part in parts}) == 6


@rule("client", "`set_relation` relates elements of any context and individuals; it is kept in the subject's context")
def test_relations_between_contexts(wmi):
    here = add(wmi, "skiros:LargeBox")
    there = add(wmi, "skiros:Part", parent="", context="database")
    assert wmi.set_relation(there.id, "skiros:at", here.id)
    assert wmi.set_relation(here.id, "skiros:hasFov", there.id)
    assert wmi.set_relation(there.id, "skiros:partReference", "skiros:starter")
    assert wmi.set_relation("skiros:starter", "skiros:partReference", "factory:part")
    found = wmi.get_element(there.id, "database")
    assert found.hasRelation("-1", "skiros:at", here.id)
    assert found.hasRelation("-1", "skiros:partReference", "skiros:starter")
    assert wmi.get_relations(there.id, "skiros:at", here.id)
    assert wmi.get_element(here.id).hasRelation("-1", "skiros:hasFov", there.id)
    assert "factory:part" in wmi.get_triples("skiros:starter", "skiros:partReference")
    for ends in ((there.id, "skiros:Part-999"), ("skiros:Part-999", here.id)):
        with pytest.raises(WmException, match="skiros:Part-999"):
            wmi.set_relation(ends[0], "skiros:at", ends[1])
    assert wmi.set_relation(there.id, "skiros:at", here.id, False)
    assert wmi.get_relations(there.id, "skiros:at", here.id) == []


@rule("client", "An element that goes leaves no relation to it, in no context")
def test_a_removed_element_leaves_no_relation(wmi):
    here = add(wmi, "skiros:LargeBox")
    there = add(wmi, "skiros:Part", parent="", context="database")
    wmi.set_relation(there.id, "skiros:at", here.id)
    wmi.remove_element(here)
    assert wmi.get_element(there.id, "database").getRelations("-1", "skiros:at") == []


def client_program(wmi):
    """Instantiates a template in two contexts, changes both copies, and removes them."""
    before = {context: {e.id for e in wmi.resolve_elements(Element(), context)} for context in ("scene", "database")}
    for context in before:
        location = Element("skiros:LargeBox", f"location in {context}")
        wmi.add_element(location, context)
        relation = {"src": location.id, "type": "skiros:contain", "dst": "-1", "state": True, "abstract": False}
        robot = wmi.instanciate("factory:euro_pallet", True, [relation], context_id=context)
        assert len(wmi.get_branch(robot.id, context_id=context)) == 4
        assert wmi.set_relation(robot.id, "skiros:at", location.id)
        robot = wmi.get_element(robot.id, context)
        assert robot.hasRelation("-1", "skiros:at", location.id)
        robot.setProperty("skiros:SizeY", 2.0)
        wmi.update_element(robot, context)
        assert [e.id for e in wmi.resolve_elements(Element("factory:Pallet"), context)] == [robot.id]
        assert wmi.resolve_element(Element("factory:Pallet"), context).getProperty("skiros:SizeY").value == 2.0
    for context in before:
        for found in wmi.resolve_elements(Element("factory:Pallet"), context):
            assert wmi.remove_element(found, context_id=context) == 1
        for found in wmi.resolve_elements(Element("skiros:LargeBox"), context):
            if found.id not in before[context]:
                assert wmi.remove_element(found.id, context_id=context) == 1
    after = {context: {e.id for e in wmi.resolve_elements(Element(), context)} for context in before}
    assert after == before


@rule("client", "A program that works in two contexts leaves both as they were")
def test_a_program_in_two_contexts(wmi):
    client_program(wmi)


# -- more ----------------------------------------------------------------------------------------------------------


@rule("more", "`removal_of(id)`", better="gives the author and the time of the change that removed an element")
def test_removal_of(wmi):
    part = add(wmi, "skiros:Part")
    eid = part.id
    assert wmi.removal_of(eid) is None
    wmi.remove_element(part)
    assert wmi.removal_of(eid).author == "tester"
    assert wmi.removal_of(eid).stamp > 0


@rule("more", "`update_elements(es)`", better="writes several elements in one change, all or none")
def test_update_elements(wmi):
    parts = [add(wmi, "skiros:Part"), add(wmi, "skiros:Part")]
    changes = []
    wmi.add_listener(changes.append)
    for part in parts:
        part.setProperty("Weight", 1.0)
    wmi.update_elements(parts)
    (change,) = changes
    assert ids(change.elements) == ids(parts)
    assert change.author == "tester"
