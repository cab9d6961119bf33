"""RDF statements about elements become checked operations on the scene."""

import pytest

from skiros2_common.core.errors import SkirosError
from skiros2_common.core.world_element import Element


@pytest.fixture
def part(wm):
    part = Element("skiros:Part", "part")
    part.setProperty("skiros:SizeX", 1.5)
    wm.add_element(part)
    return part


def modify(model, *statements):
    return model.modify([(*parts, value) for *parts, value in statements], "tester", "scene")


def test_values_come_and_go(wm, model, part):
    modify(model, (part.id, "skiros:SizeX", "2.5", True), (part.id, "skiros:SizeX", '"1.5"^^xsd:float', False))
    assert wm.get_element(part.id).getProperty("skiros:SizeX").values == [2.5]


def test_labels_and_classes_are_set(wm, model, part):
    modify(model, (part.id, "rdfs:label", '"renamed"', True), (part.id, "rdf:type", "skiros:Product", True))
    found = wm.get_element(part.id)
    assert (found.type, found.label) == ("skiros:Product", "renamed")


def test_a_statement_of_a_class_makes_an_element_which_others_may_speak_of(wm, model, part):
    modify(
        model,
        ("skiros:LargeBox-50", "skiros:contain", part.id, True),
        ("skiros:LargeBox-50", "rdf:type", "skiros:LargeBox", True),
        ("skiros:LargeBox-50", "rdf:type", "owl:NamedIndividual", True),
    )
    assert wm.get_relations("skiros:LargeBox-50", "skiros:contain", part.id)


@pytest.mark.parametrize(
    ("statement", "message"),
    [
        (("skiros:Part-99", "skiros:SizeX", "1.5", True), "no element 'skiros:Part-99'"),
        (("skiros:Part-1", "skiros:at", "skiros:Part-99", True), "no element 'skiros:Part-99'"),
        (("skiros:Part-1", "rdf:type", "skiros:Part", False), "has a class"),
        (("skiros:Tote", "rdf:type", "owl:Class", True), "belongs in the ontologies"),
        (("_:b", "rdf:type", "skiros:Part", True), "without blank nodes"),
        (("skiros:Part-1", "skiros:PositionX", '"left"', True), "PositionX"),
        (('"Part"', "skiros:SizeX", "1.5", True), "not an RDF statement"),
        (("skiros:Part-1", "SizeX", "1.5", True), "'SizeX' is not an RDF term"),
    ],
)
def test_invalid_statement_is_refused_and_changes_nothing(wm, model, part, statement, message):
    assert part.id == "skiros:Part-1"
    before = wm.version
    with pytest.raises(SkirosError, match=message):
        modify(model, (part.id, "skiros:SizeY", "2.0", True), statement)
    assert wm.version == before
    assert not wm.get_element(part.id).hasProperty("skiros:SizeY")


def test_statements_that_hold_already_are_no_change_of_the_ontologies(model):
    statement = ("skiros:Tote", "rdfs:subClassOf", "skiros:Container", True)
    assert model.modify([statement], "tester")
    assert model.modify([statement], "tester") == []
