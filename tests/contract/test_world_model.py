"""The world model port: one suite for the adapter in process, over ROS, and over ROS with a replica."""

from __future__ import annotations

import itertools
import time

import pytest

from skiros2_common.core.params import ParamHandler, ParamTypes
from skiros2_common.core.world_element import Element
from skiros2_world_model.core.wm_errors import WmException
from support.ros import wait_until

SCENE = "skiros:Scene-0"


def ids(elements):
    return [e.id for e in elements]


# -- adding --------------------------------------------------------------------------------------------------------


def test_new_element_gets_a_unique_id_of_its_class(world):
    tray, part = world.add("skiros:LargeBox", "tray"), world.add("skiros:Part", "part")
    assert tray.id == f"skiros:LargeBox-{tray.getIdNumber()}"
    assert len({0, tray.getIdNumber(), part.getIdNumber()}) == 3


def test_taken_id_number_is_replaced_in_the_callers_element(world):
    wanted = Element("skiros:Part", "first", "skiros:Part-80")
    clash = Element("skiros:Product", "second", "skiros:Product-80")
    assert world.wm.add_element(wanted).id == "skiros:Part-80"
    assert world.wm.add_element(clash).id == clash.id == "skiros:Product-81"


def test_client_reads_its_own_additions(world, wm):
    part = world.add("skiros:Part", "part", ContainerState="Empty", Weight=2)
    found = wm.get_element(part.id)
    assert (found.type, found.label) == ("skiros:Part", "part")
    assert found.value_of("skiros:ContainerState") == "Empty"
    assert found.value_of("skiros:Weight") == 2.0  # a float by its declared range
    assert found.hasRelation(SCENE, "skiros:contain", "-1")
    assert wm.get_element(SCENE).hasRelation("-1", "skiros:contain", part.id)


def test_added_element_equals_the_stored_one(world, wm):
    part = world.add("skiros:Part", "part", Weight=2)
    assert part.changes() is not None
    assert not part.changes()
    assert part.version == wm.get_element(part.id).version


def test_local_children_are_added_with_their_parent_in_one_change(world, wm):
    tray, part, screw = Element("skiros:LargeBox", "tray"), Element("skiros:Part", "part"), Element("skiros:Part")
    part.addRelation("-1", "skiros:hasA", screw)
    tray.addRelation("-1", "skiros:contain", part)
    tray.addRelation(SCENE, "skiros:contain", "-1")
    wm.add_element(tray)
    assert wm.get_element(tray.id).hasRelation("-1", "skiros:contain", part.id)
    assert wm.get_element(screw.id).hasRelation(part.id, "skiros:hasA", "-1")
    assert tray.local_relations == []


def test_elements_are_added_all_or_none(world, wm):
    good, bad = Element("skiros:Part", "good"), Element("skiros:Part", "bad")
    bad.addRelation("skiros:LargeBox-999", "skiros:contain", "-1")
    with pytest.raises(WmException, match="skiros:LargeBox-999"):
        wm.add_elements([good, bad])
    assert wm.resolve_elements(Element("skiros:Part")) == []
    assert good.id == ""


def test_element_of_a_template_is_related_to_the_template(world, wm):
    part = world.add("skiros:Starter", "skiros:starter", Template="skiros:starter")
    assert wm.get_relations(part.id, "skiros:hasTemplate", "skiros:starter")


# -- updating ------------------------------------------------------------------------------------------------------


def test_concurrent_changes_of_different_properties_are_kept(world, wm):
    part = world.add("skiros:Part", "part", ContainerState="Empty", SizeX=1.0)
    other = world.connect("other")
    mine, others = wm.get_element(part.id), other.get_element(part.id)
    mine.setProperty("skiros:ContainerState", "Full")
    others.setProperty("skiros:SizeX", 2.0)
    wm.update_element(mine)
    other.update_element(others)
    found = other.get_element(part.id)
    assert (found.value_of("skiros:ContainerState"), found.value_of("skiros:SizeX")) == ("Full", 2.0)
    assert others.value_of("skiros:ContainerState") == "Full"  # the caller's element is as it is now


def test_concurrent_additions_of_different_relations_are_kept(world, wm):
    part, tray = world.add("skiros:Part", "part"), world.add("skiros:LargeBox", "tray")
    other = world.connect("other")
    mine, others = wm.get_element(part.id), other.get_element(part.id)
    mine.addRelation("-1", "skiros:at", tray.id)
    others.addRelation("-1", "skiros:hasFov", tray.id)
    wm.update_element(mine)
    other.update_element(others)
    assert {r["type"] for r in other.get_relations(part.id, "", tray.id)} == {"skiros:at", "skiros:hasFov"}


def test_update_removes_properties_and_relations(world, wm):
    part = world.add("skiros:Part", "part", ContainerState="Empty")
    part.removeProperty("skiros:ContainerState")
    part.removeRelation2(SCENE, "skiros:contain", "-1")
    wm.update_element(part)
    found = wm.get_element(part.id)
    assert not found.hasProperty("skiros:ContainerState")
    assert found.getRelations() == []


def test_hand_made_element_replaces_the_stored_one(world, wm):
    part = world.add("skiros:Part", "part", ContainerState="Empty", SizeX=1.0)
    made = Element("skiros:Part", "renamed", part.id)
    made.setProperty("skiros:SizeX", 2.0)
    wm.update_element(made)
    found = wm.get_element(part.id)
    assert found.label == "renamed"
    assert found.available_properties == ["skiros:SizeX"]
    assert found.getRelations() == []


def test_property_update_leaves_changed_relations_unwritten(world, wm):
    part, tray = world.add("skiros:Part", "part"), world.add("skiros:LargeBox", "tray")
    part.setProperty("skiros:ContainerState", "Full")
    part.addRelation("-1", "skiros:at", tray.id)
    wm.update_element_properties(part)
    assert wm.get_element(part.id).value_of("skiros:ContainerState") == "Full"
    assert wm.get_relations(part.id, "skiros:at", "") == []
    wm.update_element(part)
    assert wm.get_relations(part.id, "skiros:at", tray.id)


def test_property_update_of_a_hand_made_element_keeps_relations(world, wm):
    part = world.add("skiros:Part", "part", SizeX=1.0)
    made = Element("skiros:Part", "part", part.id)
    made.setProperty("skiros:SizeY", 2.0)
    wm.update_element_properties(made)
    found = wm.get_element(part.id)
    assert found.available_properties == ["skiros:SizeY"]
    assert found.hasRelation(SCENE, "skiros:contain", "-1")


def test_local_children_are_added_by_an_update(world, wm):
    tray = world.add("skiros:LargeBox", "tray")
    child = Element("skiros:Part", "child")
    tray.addRelation("-1", "skiros:contain", child)
    wm.update_element(tray)
    assert wm.get_relations(tray.id, "skiros:contain", child.id)


def test_elements_are_updated_all_or_none(world, wm):
    one, two = world.add("skiros:Part", "one"), world.add("skiros:Part", "two")
    one.setProperty("skiros:ContainerState", "Full")
    two.addRelation("-1", "skiros:at", "skiros:LargeBox-999")
    with pytest.raises(WmException):
        wm.update_elements([one, two])
    assert not wm.get_element(one.id).hasProperty("skiros:ContainerState")
    two.removeRelation2("-1", "skiros:at", "skiros:LargeBox-999")
    assert wm.update_elements([one, two]) == [one.id, two.id]
    assert wm.get_element(one.id).value_of("skiros:ContainerState") == "Full"


def test_class_and_label_can_be_changed(world, wm):
    part = world.add("skiros:Part", "part")
    part.type, part.label = "skiros:Product", "renamed"
    wm.update_element(part)
    assert ids(wm.resolve_elements(Element("skiros:Product", "renamed"))) == [part.id]
    assert wm.resolve_elements(Element("skiros:Part")) == []


def test_lists_dicts_and_texts_are_kept(world, wm):
    part = world.add("skiros:Part", 'a "red" one\nwith é', Value=[1, 2, 3], Default={"a": [1, None]})
    found = wm.get_element(part.id)
    assert found.label == 'a "red" one\nwith é'
    assert found.getProperty("skiros:Value").values == [1, 2, 3]
    assert found.value_of("skiros:Default") == {"a": [1, None]}


# -- removing ------------------------------------------------------------------------------------------------------


def test_recursive_removal_includes_descendants(world, wm):
    tray = world.add("skiros:LargeBox", "tray")
    part = world.add("skiros:Part", "part", tray)
    screw = world.add("skiros:Part", "screw", part, "skiros:hasA")
    wm.remove_element(tray)
    assert [wm.is_scene_element(e.id) for e in (tray, part, screw)] == [False] * 3
    assert wm.get_element(SCENE).getRelations("-1", "skiros:contain") == []


def test_recursive_removal_keeps_descendants_held_by_others(world, wm):
    tray, shelf = world.add("skiros:LargeBox", "tray"), world.add("skiros:LargeBox", "shelf")
    part = world.add("skiros:Part", "part", tray)
    inner = world.add("skiros:Part", "inner", part)
    wm.set_relation(shelf.id, "skiros:contain", part.id)
    wm.remove_element(tray)
    assert [wm.is_scene_element(e.id) for e in (tray, part, inner)] == [False, True, True]


def test_removal_without_recursion_keeps_descendants(world, wm):
    tray = world.add("skiros:LargeBox", "tray")
    part = world.add("skiros:Part", "part", tray)
    wm.remove_element(tray, recursive=False)
    assert wm.get_element(part.id).getRelations() == []


def test_recursive_removal_is_limited_to_a_relation_and_a_class(world, wm):
    tray = world.add("skiros:LargeBox", "tray")
    part, box = world.add("skiros:Part", "part", tray), world.add("skiros:LargeBox", "box", tray)
    wing = world.add("skiros:Part", "wing", tray, "skiros:hasA")
    wm.remove_element(tray, True, "skiros:contain", "skiros:Part")
    assert [wm.is_scene_element(e.id) for e in (tray, part, box, wing)] == [False, False, True, True]


def test_removal_has_author_and_time(world, wm):
    other = world.connect("the other")
    box = world.add("skiros:LargeBox", "box")
    part, kept = world.add("skiros:Part", "part", box), world.add("skiros:Part", "kept")
    assert wm.removal_of(part.id) is None
    began = time.time()
    other.remove_element(box.id)
    wait_until(lambda: wm.find_element(part.id) is None)
    for removal in (wm.removal_of(box.id), wm.removal_of(part.id)):
        assert removal.author == "the other"
        assert began <= removal.stamp <= time.time()
    other.load("blank.ttl")
    wait_until(lambda: wm.find_element(kept.id) is None)
    loader = wm.removal_of(kept.id).author  # over ROS, the name of the node
    assert loader == "the other" or loader.startswith("/tests")
    assert wm.removal_of("skiros:Part-999999") is None


# -- reading -------------------------------------------------------------------------------------------------------


def test_resolve_finds_elements_of_subclasses(world, wm):
    tray, starter = world.add("skiros:LargeBox", "tray"), world.add("skiros:Starter", "starter")
    assert ids(wm.resolve_elements(Element("skiros:Container"))) == [tray.id]
    assert ids(wm.resolve_elements(Element("skiros:Product"))) == [starter.id]
    assert {tray.id, starter.id} <= set(ids(wm.resolve_elements(Element("sumo:Object"))))


def test_resolve_filters_by_label_and_property_values(world, wm):
    full = world.add("skiros:LargeBox", "tray", ContainerState="Full", SizeX=1.0)
    empty = world.add("skiros:LargeBox", "tray", ContainerState="Empty", SizeX=1.0)

    def found(label="", **values):
        wanted = Element("skiros:LargeBox", label)
        for key, value in values.items():
            wanted.setProperty(f"skiros:{key}", value)
        return ids(wm.resolve_elements(wanted))

    assert found("tray") == [full.id, empty.id]
    assert found("other") == []
    assert found(ContainerState="Full", SizeX=1.0) == [full.id]
    assert found(ContainerState="") == [full.id, empty.id]
    assert found(SizeY=float) == [full.id, empty.id]
    assert found(SizeY=1.0) == []
    assert wm.resolve_element(Element("skiros:LargeBox", "tray")).id == full.id
    assert wm.resolve_element(Element("skiros:LargeBox", "other")) is None


def test_branch_contains_the_descendants_along_a_relation(world, wm):
    tray = world.add("skiros:LargeBox", "tray")
    part = world.add("skiros:Part", "part", tray)
    screw = world.add("skiros:Part", "screw", part, "skiros:hasA")
    assert ids(wm.get_branch(tray.id)) == [tray.id, part.id, screw.id]
    assert ids(wm.get_branch(tray.id, "skiros:contain")) == [tray.id, part.id]
    assert ids(wm.get_branch(SCENE, type_filter="skiros:Part")) == [part.id, screw.id]
    assert set(ids(wm.get_scene_elements())) == {SCENE, tray.id, part.id, screw.id}
    elements, snapshot_id = wm.get_scene()
    assert set(ids(elements)) == {SCENE, tray.id, part.id, screw.id}
    world.add("skiros:Part", "later")
    assert wm.get_scene()[1] != snapshot_id
    assert wm.get_scene_name() in ("", "blank.ttl")  # over ROS the parameter of the node


def test_changes_of_a_read_element_stay_local(world, wm):
    part = world.add("skiros:Part", "part", SizeX=1.0)
    found = wm.get_element(part.id)
    found.setProperty("skiros:SizeX", 2.0)
    found.addRelation("-1", "skiros:at", SCENE)
    assert wm.get_element(part.id).value_of("skiros:SizeX") == 1.0
    assert wm.get_relations(part.id, "skiros:at", "") == []


def test_find_returns_none_for_an_unknown_id(wm):
    assert wm.find_element("skiros:Part-999") is None
    with pytest.raises(WmException, match="skiros:Part-999"):
        wm.get_element("skiros:Part-999")


# -- relations -----------------------------------------------------------------------------------------------------


def test_relation_is_set_and_removed(world, wm):
    part, tray = world.add("skiros:Part", "part"), world.add("skiros:LargeBox", "tray")
    assert wm.set_relation(part.id, "skiros:at", tray.id)
    (found,) = wm.get_relations(part.id, "skiros:at", tray.id)
    assert (found["src"], found["type"], found["dst"], found["state"]) == ("-1", "skiros:at", tray.id, True)
    wm.set_relation(part.id, "skiros:at", tray.id, False)
    assert wm.get_relations(part.id, "skiros:at", tray.id) == []


def test_relations_are_found_by_superproperty_subject_and_object(world, wm):
    part = world.add("skiros:Part", "part")
    assert [r["type"] for r in wm.get_relations(SCENE, "skiros:sceneProperty", part.id)] == ["skiros:contain"]
    assert [r["src"] for r in wm.get_relations("", "skiros:spatiallyRelated", part.id)] == [SCENE]
    assert [r["dst"] for r in wm.get_relations(SCENE, "contain", "")] == [part.id]
    assert wm.get_relations(SCENE, "skiros:hasA", part.id) == []


def test_relation_query_accepts_elements_and_classes(world, wm):
    tray = world.add("skiros:LargeBox", "tray")
    part = world.add("skiros:Part", "part", tray)

    def holds(subj, obj, pred="skiros:spatiallyRelated"):
        answer = wm.check_relation(subj, pred, obj, True, False)
        assert wm.check_relation(subj, pred, obj, False, False) is not answer
        return answer

    assert holds(tray, part)
    assert not holds(part, tray)
    assert not holds(tray, part, "skiros:hasA")
    assert holds(tray, Element("skiros:Manipulatable"))
    assert not holds(tray, Element("skiros:Product"))
    assert holds(Element("skiros:Container"), part)
    assert holds(Element("skiros:Container"), Element("skiros:Part"))
    assert holds(Element("skiros:Container", "tray"), Element("skiros:Part"))
    assert not holds(Element("skiros:Container", "other"), Element("skiros:Part"))
    assert holds(tray.id, part.id)


def test_abstract_relation_between_classes_follows_the_restrictions(world, wm):
    robot, arm = Element("cora:Robot"), Element("rparts:ArmDevice")
    assert wm.check_relation(robot, "skiros:hasA", arm, True, True)
    assert wm.check_relation(robot, "skiros:hasA", Element("skiros:Location"), False, True)


def test_abstract_relation_of_elements_follows_their_templates(world, wm):
    box = world.add("skiros:LargeBox", "start_box", Template="skiros:large_box_test_starter")
    labelled = world.add("skiros:LargeBox", "skiros:large_box_test_starter")
    motor = world.add("skiros:Starter", "motor 7", Template="skiros:starter")
    starter, other = Element("skiros:Starter", "skiros:starter"), Element("skiros:Starter", "other")
    for part, state in ((motor, True), (starter, True), (other, False), (world.add("skiros:Starter", "x"), False)):
        assert wm.check_relation(box, "skiros:partReference", part, state, True)
        assert wm.check_relation(labelled, "skiros:partReference", part, False, True)
    wm.set_relation(labelled.id, "skiros:partReference", motor.id)
    assert wm.check_relation(labelled, "skiros:partReference", motor, True, True)


def test_parameters_are_resolved_together(world, wm):
    tray = world.add("skiros:LargeBox", "tray")
    one, two = world.add("skiros:Part", "one"), world.add("skiros:Part", "two")
    params = ParamHandler()
    params.addParam("Tray", Element("skiros:LargeBox"), ParamTypes.Inferred)
    params.addParam("Part", Element("skiros:Part"), ParamTypes.Inferred)
    params.addParam("Fixed", two, ParamTypes.Required)
    found = wm._resolve_elements2(["Tray", "Part"], params)
    assert [tuple(ids(pair)) for pair in found["Tray", "Part"]] == [(tray.id, one.id), (tray.id, two.id)]
    assert ids(wm._resolve_elements2(["Fixed"], params)["Fixed"]) == [two.id]


# -- templates -----------------------------------------------------------------------------------------------------


def test_template_is_read_as_an_element_without_id(wm):
    template = wm.get_template_element("factory:euro_pallet")
    assert template.isAbstract()
    assert (template.type, template.label) == ("factory:Pallet", "factory:euro_pallet")
    assert template.value_of("skiros:SizeX") == 1.2


def test_template_is_copied_without_parts(wm):
    relation = {"src": SCENE, "type": "skiros:contain", "dst": "-1"}
    pallet = wm.instanciate("factory:euro_pallet", False, [relation])
    assert (pallet.type, pallet.label) == ("factory:Pallet", "factory:euro_pallet")
    assert wm.get_relations(SCENE, "skiros:contain", pallet.id)
    assert wm.get_relations(pallet.id, "skiros:spatiallyRelated", "") == []
    assert wm.get_relations(pallet.id, "skiros:hasTemplate", "factory:euro_pallet")


def test_template_is_copied_with_its_parts_but_not_into_itself(wm):
    pallet = wm.instanciate("factory:euro_pallet", recursive=True)
    branch = wm.get_branch(pallet.id)
    assert [e.label for e in branch] == ["factory:euro_pallet", "factory:part", "skiros:starter", "factory:screw"]
    assert wm.get_relations(branch[1].id, "skiros:partReference", "skiros:starter")


def test_relation_filter_selects_copied_template_parts(wm):
    pallet = wm.instanciate("factory:euro_pallet", True, relation_filter=["skiros:hasA"])
    assert ids(wm.get_branch(pallet.id)) == [pallet.id]
    pallet = wm.instanciate("factory:euro_pallet", True, antiloop_bind={"factory:part"})
    assert [e.label for e in wm.get_branch(pallet.id)] == ["factory:euro_pallet", "skiros:starter"]


# -- ontologies ----------------------------------------------------------------------------------------------------


def test_classes_and_relations_are_listed(wm):
    assert wm.get_sub_classes("skiros:Container") == ["factory:Pallet", "skiros:Container", "skiros:LargeBox"]
    assert wm.get_sub_classes("skiros:Location", recursive=False) == ["skiros:Container", "skiros:TransformationPose"]
    assert wm.get_sub_classes("skiros:LargeBox", recursive=False) == wm.get_sub_classes("skiros:NoSuchClass") == []
    assert wm.get_super_class("factory:Pallet") == "skiros:Container"
    assert wm.get_sub_properties("skiros:spatiallyRelated", recursive=False) == ["skiros:contain", "skiros:hasA"]
    assert wm.get_individuals("skiros:Container") == ["factory:euro_pallet", "skiros:large_box_test_starter"]
    assert wm.get_individuals("skiros:Container", recursive=False) == []
    assert wm.get_datatype("skiros:PositionX") == "xsd:float"
    assert wm.get_datatype("FrameId") is None
    assert wm.get_datatype("skiros:NoSuchProperty") is None
    assert wm.is_subclass(":LargeBox", "sumo:Object")
    assert wm.is_subproperty("contain", "sceneProperty")


def test_types_are_listed(world, wm):
    part = world.add("skiros:Part", "part")
    assert wm.get_type(part.id) == ["owl:NamedIndividual", "skiros:Part"]
    assert "factory:Pallet" in wm.get_type("factory:euro_pallet")
    assert wm.get_type("skiros:Part") == ["owl:Class"]
    assert wm.get_type("none:Foo") == []
    assert part.id in wm.get_types("skiros:Part")
    assert "factory:euro_pallet" in wm.get_types("factory:Pallet")


def test_new_class_is_known_to_all_clients(world, wm):
    other = world.connect("other")
    assert not other.is_subclass("skiros:Tote", "skiros:Container")
    wm.add_class("skiros:Tote", "skiros:Container")
    assert wm.is_subclass("skiros:Tote", "sumo:Object")
    wait_until(lambda: other.is_subclass("skiros:Tote", "sumo:Object"))
    tote = world.add("skiros:Tote", "tote")
    assert tote.id in ids(wm.resolve_elements(Element("skiros:Container")))


def test_new_properties_and_individuals_are_listed(wm):
    wm.add_datatype("factory:Color", "skiros:PhysicalObjectProperty")
    assert "factory:Color" in wm.get_sub_properties("skiros:PhysicalObjectProperty")
    crate = Element("factory:Pallet", "factory:red_crate")
    crate.setProperty("factory:Color", 'red "and" blue')
    crate.addRelation("-1", "skiros:partReference", "skiros:starter")
    wm.add_individual(crate)
    copy = wm.instanciate("factory:red_crate")
    assert copy.value_of("factory:Color") == 'red "and" blue'
    assert wm.get_relations(copy.id, "skiros:partReference", "skiros:starter")


def test_triples_are_queried_by_pattern(world, wm):
    part = world.add("skiros:Part", "part", SizeX=1.5)
    assert wm.get_triples(SCENE, "skiros:contain") == [part.id]
    assert "skiros:SizeX 1.5" in wm.get_triples(part.id)
    assert wm.get_triples(None, "rdfs:label", '"part"') == [part.id]
    assert wm.get_triples(SCENE, "skiros:contain", part.id) == [f"{SCENE} skiros:contain {part.id}"]
    assert wm.get_triples(part.id, "skiros:contain") == []


def test_sparql_query_sees_the_current_scene_and_ontologies(world, wm):
    part = world.add("skiros:Part", "a part", SizeX=1.5)
    query = "SELECT ?x ?size WHERE { ?x a/rdfs:subClassOf* skiros:Manipulatable ; :SizeX ?size . ?s :contain ?x }"
    assert wm.query_ontology(query) == [f"{part.id} 1.5 "]
    (row,) = wm.query_ontology("SELECT ?x WHERE { ?x rdfs:label ?l . FILTER(?l = 'a part') }", cut_prefix=False)
    assert row == f"<http://rvmi.aau.dk/ontologies/skiros.owl#{part.id.partition(':')[2]}>"
    assert wm.query_ontology("ASK { ?x :contain ?y }", context="ontology") == ["true"]
    assert wm.query_ontology("SELECT ?x WHERE { ?x a owl:Class }", context="scene") == []


def test_prefix_of_a_client_is_unknown_to_others(world):
    mine, others = world.connect("mine"), world.connect("others")
    mine.set_default_prefix("factory")
    assert mine.is_subclass("Pallet", "skiros:Container")
    assert mine.query_ontology("SELECT ?x WHERE { ?x rdfs:subClassOf skiros:Container . ?i a :Pallet, ?x }") != []
    assert not others.is_subclass("Pallet", "skiros:Container")
    mine.add_ontology("http://x.org/Lab.owl")
    mine.add_class("lab:Bench", "skiros:Location")
    assert mine.get_triples("lab:Bench", "rdfs:subClassOf") == ["skiros:Location"]
    assert others.wait_until(lambda: others.is_subclass("lab:Bench", "sumo:Object"), 10.0)  # published on the monitor


# -- contexts and files --------------------------------------------------------------------------------------------


def test_write_creates_a_context_separate_from_the_scene(world, wm):
    memory = Element("skiros:Part", "remembered")
    wm.add_element(memory, "memory")
    assert wm.get_element(memory.id, "memory").label == "remembered"
    assert ids(wm.resolve_elements(Element("skiros:Part"), "memory")) == [memory.id]
    assert wm.resolve_elements(Element("skiros:Part", "remembered")) == []
    assert memory.id in ids(wm.resolve_elements(Element("skiros:Part", "remembered"), ""))
    assert wm.query_ontology("SELECT ?x { ?x rdfs:label 'remembered' }", context="memory") == [memory.id]
    memory.setProperty("skiros:SizeX", 2.0)
    wm.update_element(memory, "memory")
    assert wm.get_element(memory.id, "memory").value_of("skiros:SizeX") == 2.0
    wm.remove_element(memory.id, context_id="memory")
    assert wm.find_element(memory.id, "memory") is None


def test_read_creates_a_context(wm):
    assert wm.resolve_elements(Element("skiros:Part"), "read_first") == []
    assert wm.query_ontology("SELECT ?x { ?x ?y ?z }", context="asked_first") == []
    assert wm.find_element(SCENE, "found_first") is None
    assert wm.save("saved_first.ttl", "saved_first")
    with pytest.raises(WmException, match="got_first"):
        wm.get_element(SCENE, "got_first")
    with pytest.raises(WmException, match="no name"):
        wm.resolve_elements(Element("skiros:Part"), "no name")


def test_saved_scene_is_loaded_with_its_ids(world, wm):
    tray = world.add("skiros:LargeBox", "tray", SizeX=0.5)
    part = world.add("skiros:Part", "part", tray)
    saved = tray.id
    wm.save("saved.ttl")
    wm.remove_element(tray)
    added = world.add("skiros:Part", "later")
    wm.load("saved.ttl")
    (tray,) = wm.resolve_elements(Element("skiros:LargeBox"))
    assert tray.id == saved
    assert tray.value_of("skiros:SizeX") == 0.5
    assert wm.get_relations(tray.id, "skiros:contain", part.id)
    assert wm.find_element(added.id) is None or wm.get_element(added.id).label != "later"
    text = (world.workspace / "saved.ttl").read_text()
    wm.save()  # the file that it was loaded from
    assert (world.workspace / "saved.ttl").read_text() == text


def test_context_is_loaded_and_saved_by_name(world, wm):
    wm.add_element(Element("skiros:Part", "kept"), "notes")
    wm.save("notes.ttl", "notes")
    wm.load("notes.ttl", "more_notes")
    assert [e.label for e in wm.resolve_elements(Element("skiros:Part"), "more_notes")] == ["kept"]


# -- changes seen --------------------------------------------------------------------------------------------------


def test_change_is_published_once_in_order_with_its_author(world, wm):
    seen = []
    wm.add_listener(seen.append)
    other = world.connect("the other")
    part = Element("skiros:Part", "part")
    other.add_element(part)
    part.setProperty("skiros:SizeX", 2.0)
    other.update_element(part)
    other.set_relation(SCENE, "skiros:contain", part.id)
    other.remove_element(part.id)
    other.save("published.ttl")
    other.load("published.ttl")

    def published():
        """The changes from the first one on: the reset before this test may be published as late as now."""
        changes = [c for c in seen if c.author == "the other" or c.action == "reset"]
        return list(itertools.dropwhile(lambda c: c.author != "the other", changes))

    wait_until(lambda: len(published()) >= 5)
    wm.remove_listener(seen.append)
    assert [c.action for c in published()] == ["add", "update", "add", "remove_recursive", "reset"]
    added, updated, related, removed, _ = published()
    assert ids(added.elements) == ids(updated.elements) == ids(removed.elements) == [part.id]
    assert updated.elements[0].value_of("skiros:SizeX") == 2.0
    assert (related.relations[0]["src"], related.relations[0]["dst"]) == (SCENE, part.id)
    assert all(a.snapshot_id == b.prev_snapshot_id for a, b in zip(published(), published()[1:], strict=False))


def test_revision_of_an_element_changes_with_the_element(world, wm):
    tray, part, other = (world.add("skiros:LargeBox"), world.add("skiros:Part"), world.add("skiros:Part"))
    revisions = wm.revisions()
    if wm.version == -1:
        assert revisions is None
        return

    def record_lookup():
        element = wm.revisions().element
        return [element(e.id) for e in (tray, part, other)]

    before = record_lookup()
    assert [mark.version for mark in before] == [wm.get_element(e.id).version for e in (tray, part, other)]
    assert all(a is b for a, b in zip(record_lookup(), before, strict=True))
    wm.set_relation(tray, "skiros:contain", part, True)
    related = record_lookup()
    assert [a is b for a, b in zip(related, before, strict=True)] == [False, False, True]
    part = wm.get_element(part.id)
    part.setProperty("skiros:Weight", 4.5)
    wm.update_element(part)
    weighed = record_lookup()
    assert [a is b for a, b in zip(weighed, related, strict=True)] == [True, False, True]
    wm.remove_element(other)
    assert record_lookup()[2] is None


def test_revision_changes_with_the_ontologies(wm):
    revisions = wm.revisions()
    wm.add_class("skiros:NewAtPresent", "skiros:Part")
    assert revisions is None or wm.revisions().ontology is not revisions.ontology


def test_version_changes_with_every_change(world, wm):
    wm.get_scene_elements()
    before = wm.version
    world.add("skiros:Part", "part")
    assert wm.version == -1 or wm.version != before
    before = wm.version
    wm.add_class("skiros:Jar", "skiros:Container")
    assert wm.version == -1 or wait_until(lambda: wm.version != before)


# -- the lock ------------------------------------------------------------------------------------------------------


def test_lock_is_released_once(wm):
    assert wm.lock() is True
    assert wm.unlock() is True
    assert wm.unlock() is False
    assert wm.is_connected()


# -- bad input -----------------------------------------------------------------------------------------------------

BAD_INPUT = {
    "an element that does not exist": (lambda w: w.get_element("skiros:Part-999"), "skiros:Part-999"),
    "the branch of no element": (lambda w: w.get_branch("skiros:Part-999"), "skiros:Part-999"),
    "an update of no element": (lambda w: w.update_element(Element("skiros:Part", "", "skiros:Part-999")), "Part-999"),
    "properties of no element": (
        lambda w: w.update_element_properties(Element("skiros:Part", "", "skiros:Part-999")),
        "Part-999",
    ),
    "the removal of no element": (
        lambda w: w.remove_element(Element("skiros:Part", "", "skiros:Part-999")),
        "Part-999",
    ),
    "a relation from no element": (lambda w: w.set_relation("skiros:Part-999", "skiros:contain", SCENE), "Part-999"),
    "a relation to no element": (lambda w: w.set_relation(SCENE, "skiros:contain", "skiros:Part-999"), "Part-999"),
    "a relation taken from no element": (
        lambda w: w.set_relation(SCENE, "skiros:contain", "skiros:Part-999", False),
        "Part-999",
    ),
    "a relation that is not a name": (lambda w: w.set_relation(SCENE, "a b", SCENE), "a b"),
    "the scene within itself": (lambda w: w.set_relation(SCENE, "skiros:contain", SCENE), "in itself"),
    "the removal of the root": (lambda w: w.remove_element(w.get_element(SCENE)), "root of the scene"),
    "a template that does not exist": (lambda w: w.instanciate("skiros:no_such"), "skiros:no_such"),
    "a template read that does not exist": (lambda w: w.get_template_element("skiros:no_such"), "skiros:no_such"),
    "a reasoner that does not exist": (
        lambda w: w.update_element_properties(w.get_element(SCENE), "NoSuchReasoner"),
        "NoSuchReasoner",
    ),
    "SPARQL that does not parse": (lambda w: w.query_ontology("SELECT WHERE"), "SELECT WHERE"),
    "SPARQL that writes": (lambda w: w.query_ontology("INSERT DATA { :a :b :c }"), "INSERT"),
    "a class that is not a name": (lambda w: w.add_class("skiros:a b", "skiros:Part"), "a b"),
    "a file that is not there": (lambda w: w.load("no_such.ttl"), "no_such.ttl"),
    "a file outside the workspace": (lambda w: w.load("../blank.ttl"), "blank.ttl: expected a file in the workspace"),
    "a save outside the workspace": (lambda w: w.save("/tmp/blank.ttl"), "expected a file in the workspace"),
    "a file that is not a scene": (lambda w: w.load("broken.ttl"), "broken.ttl, line 2"),
    "an element without class": (lambda w: w.add_element(Element("")), "class"),
    "an individual without name": (lambda w: w.add_individual(Element("skiros:Part")), "label"),
}


@pytest.mark.parametrize("what", BAD_INPUT)
def test_invalid_request_is_refused_and_changes_nothing(world, wm, what):
    (world.workspace / "broken.ttl").write_text("@prefix a: <http://x.org/a.owl#> .\na:b a:c none:d .\n")
    part = world.add("skiros:Part", "part")
    before = {(e.id, e.label, e.version) for e in wm.get_scene_elements()}
    act, message = BAD_INPUT[what]
    with pytest.raises(WmException, match=message):
        act(wm)
    assert {(e.id, e.label, e.version) for e in wm.get_scene_elements()} == before
    assert wm.get_element(part.id).label == "part"


@pytest.mark.parametrize("value", ["left", True, [1.0, 2.0]])
def test_value_of_a_wrong_type_is_refused(world, wm, value):
    part = Element("skiros:Part", "part")
    part.setProperty("skiros:PositionX", value)
    with pytest.raises(WmException, match="PositionX"):
        wm.add_element(part)
    assert wm.resolve_elements(Element("skiros:Part")) == []


def test_unknown_names_are_accepted(world, wm):
    pump = world.add("lab:Pump", "pump", flow=2.5)
    wm.set_relation(pump.id, "lab:feeds", SCENE)
    assert ids(wm.resolve_elements(Element("lab:Pump"))) == [pump.id]
    assert wm.get_element(pump.id).value_of("skiros:flow") == 2.5
    assert wm.get_relations(pump.id, "lab:feeds", "")
    assert wm.query_ontology("SELECT ?x { ?x lab:feeds ?y }") == [pump.id]
