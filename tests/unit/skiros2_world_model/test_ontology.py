"""The ontology index: closures, datatypes, restrictions, individuals."""

import pytest

from skiros2_world_model.core.knowledge_base import KnowledgeBase
from skiros2_world_model.core.local_world_model import source_ontologies
from skiros2_world_model.core.ontology import Ontology


@pytest.fixture(scope="module")
def shipped() -> Ontology:
    return KnowledgeBase(source_ontologies()).index


def made(*triples):
    return Ontology(triples)


def test_a_class_is_under_itself_and_all_above(shipped):
    assert shipped.is_subclass("skiros:LargeBox", "skiros:LargeBox")
    assert shipped.is_subclass("skiros:LargeBox", "sumo:Entity")
    assert not shipped.is_subclass("sumo:Object", "skiros:LargeBox")
    assert "skiros:LargeBox" in shipped.subclasses("skiros:Location")


def test_a_class_that_nobody_declares_is_under_itself_alone(shipped):
    assert shipped.is_subclass("none:Foo", "none:Foo")
    assert not shipped.is_subclass("none:Foo", "sumo:Object")
    assert not shipped.knows("none:Foo")


def test_relations_have_closures_too(shipped):
    assert shipped.is_subproperty("skiros:contain", "skiros:sceneProperty")
    assert {"skiros:hasA", "skiros:hasSkill", "skiros:hasParam"} <= shipped.subproperties("skiros:sceneProperty")


def test_a_circle_of_classes_ends():
    ontology = made(("a:A", "rdfs:subClassOf", "a:B"), ("a:B", "rdfs:subClassOf", "a:A"))
    assert ontology.subclasses("a:A") == {"a:A", "a:B"}


def test_equivalent_classes_are_under_each_other():
    ontology = made(("a:A", "owl:equivalentClass", "a:B"))
    assert ontology.is_subclass("a:A", "a:B")
    assert ontology.is_subclass("a:B", "a:A")


def test_a_class_declared_in_lower_case_is_a_class():
    assert made(("a:A", "rdf:type", "owl:class")).has_class("a:A")


def test_a_property_has_the_datatype_that_it_or_one_above_it_declares(shipped):
    assert shipped.datatype("skiros:PositionX") == "xsd:float"
    assert shipped.datatype("skiros:SizeX") == ""
    ontology = made(("a:p", "rdfs:subPropertyOf", "a:q"), ("a:q", "rdfs:range", "xsd:int"))
    assert ontology.datatype("a:p") == "xsd:int"


def test_restrictions_of_the_class_limit_values(shipped):
    assert shipped.value_limits("skiros:Product", "skiros:FrameId") == ("xsd:string", 1)
    assert shipped.value_limits("skiros:Product", "skiros:PositionX") == ("xsd:float", 1)
    assert shipped.value_limits("skiros:Skill", "skiros:FrameId") == ("", None)


def test_a_functional_property_and_those_under_it_have_one_value():
    ontology = made(
        ("a:serial", "rdf:type", "owl:DatatypeProperty"),
        ("a:serial", "rdf:type", "owl:FunctionalProperty"),
        ("a:short_serial", "rdfs:subPropertyOf", "a:serial"),
        ("a:colour", "rdf:type", "owl:DatatypeProperty"),
    )
    assert ontology.value_limits("a:Part", "a:serial") == ("", 1)
    assert ontology.value_limits("a:Part", "a:short_serial") == ("", 1)
    assert ontology.value_limits("a:Part", "a:colour") == ("", None)


@pytest.mark.parametrize(
    ("subject", "relation", "obj", "allowed"),
    [
        ("cora:Robot", "skiros:hasA", "sumo:Device", True),
        ("cora:Robot", "skiros:hasA", "rparts:ArmDevice", True),  # under the filler
        ("cora:Robot", "skiros:hasA", "sumo:Artifact", True),  # above the filler
        ("sumo:Agent", "skiros:hasA", "sumo:Device", True),  # the restriction is on a class under it
        ("skiros:LargeBox", "sumo:isLocationOf", "skiros:Starter", True),  # on one above it
        ("cora:Robot", "skiros:hasA", "skiros:Location", False),
        ("skiros:LargeBox", "skiros:hasA", "sumo:Device", False),
        ("cora:Robot", "skiros:contain", "sumo:Device", False),
    ],
)
def test_a_restriction_on_a_related_class_with_a_related_filler_allows_a_relation(
    shipped, subject, relation, obj, allowed
):
    assert shipped.allows(subject, relation, obj) is allowed


def test_fillers_may_be_unions_and_restrictions_may_stand_in_intersections():
    ontology = made(
        ("a:A", "owl:equivalentClass", "_:i"),
        ("_:i", "owl:intersectionOf", "_:l1"),
        ("_:l1", "rdf:first", "a:Base"),
        ("_:l1", "rdf:rest", "_:l2"),
        ("_:l2", "rdf:first", "_:r"),
        ("_:l2", "rdf:rest", "rdf:nil"),
        ("_:r", "owl:onProperty", "a:p"),
        ("_:r", "owl:someValuesFrom", "_:u"),
        ("_:u", "owl:unionOf", "_:m1"),
        ("_:m1", "rdf:first", "a:B"),
        ("_:m1", "rdf:rest", "_:m2"),
        ("_:m2", "rdf:first", "a:C"),
        ("_:m2", "rdf:rest", "rdf:nil"),
    )
    assert ontology.is_subclass("a:A", "a:Base")
    assert ontology.allows("a:A", "a:p", "a:B")
    assert ontology.allows("a:A", "a:p", "a:C")


def test_templates_are_found_by_class(shipped):
    assert shipped.individuals("cora:Robot") == ["skiros:test_robot"]
    assert "skiros:test_robot" in shipped.individuals("sumo:Agent")
    assert shipped.individuals("sumo:Agent", recursive=False) == []


def test_a_template_holds_its_class_values_and_relations(shipped):
    robot = shipped.individual("skiros:test_robot")
    assert robot.type == "cora:Robot"
    assert robot.values["skiros:PositionX"] == [0.0]
    assert ("skiros:hasA", "skiros:test_arm") in robot.relations
    assert shipped.individuals_related("skiros:test_robot", "skiros:spatiallyRelated", "skiros:test_arm")


def test_the_most_specific_class_of_an_individual_counts():
    ontology = made(
        ("a:B", "rdfs:subClassOf", "a:A"),
        ("a:x", "rdf:type", "a:A"),
        ("a:x", "rdf:type", "owl:NamedIndividual"),
        ("a:x", "rdf:type", "a:B"),
    )
    assert ontology.individual("a:x").type == "a:B"


def test_with_classes_equals_a_full_read():
    before = [("a:A", "rdf:type", "owl:Class"), ("a:x", "rdf:type", "a:A")]
    more = [("a:B", "rdf:type", "owl:Class"), ("a:B", "rdfs:subClassOf", "a:A"), ("a:C", "rdfs:subClassOf", "a:B")]
    extended, anew = made(*before).with_classes(more), made(*before, *more)
    for name in ("a:A", "a:B", "a:C"):
        assert extended.subclasses(name) == anew.subclasses(name)
        assert extended.superclasses(name) == anew.superclasses(name)
        assert extended.types(name) == anew.types(name)


def test_more_than_classes_cannot_be_added_so():
    assert made().with_classes([("a:p", "rdfs:subPropertyOf", "a:q")]) is None
    assert made().with_classes([("a:A", "rdfs:subClassOf", "_:b")]) is None


def test_more_classes_leave_the_ontology_that_others_read_as_it_is():
    ontology = made(("a:A", "rdf:type", "owl:Class"))
    ontology.with_classes([("a:B", "rdfs:subClassOf", "a:A")])
    assert ontology.subclasses("a:A") == {"a:A"}
    assert not ontology.has_class("a:B")
