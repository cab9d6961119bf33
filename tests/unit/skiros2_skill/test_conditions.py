"""What each kind of condition says of the scene, as a fact and as an effect. Contract, section 3."""

import pytest

from skiros2_common.core.abstract_skill import SkillDescription
from skiros2_common.core.conditions import ConditionFunction
from skiros2_common.core.errors import UnknownName, WrongType
from skiros2_common.core.params import ParamHandler, ParamTypes
from skiros2_common.core.world_element import Element

make = SkillDescription()


@pytest.fixture
def params(bench):
    """Parameters of each kind: set, unset and optional."""
    ph = ParamHandler()
    ph.addParam("Tray", bench.tray, ParamTypes.Required)
    ph.addParam("OtherTray", bench.other_tray, ParamTypes.Required)
    ph.addParam("Object", bench.product, ParamTypes.Required)
    ph.addParam("AnyTray", Element("skiros:Container"), ParamTypes.Inferred)
    ph.addParam("AnyLargeBox", Element(bench.tray.type), ParamTypes.Inferred)
    ph.addParam("AnyStarter", Element("skiros:Starter"), ParamTypes.Inferred)
    ph.addParam("Maybe", Element("skiros:Product"), ParamTypes.Optional)
    ph.addParam("Gone", Element("skiros:Product", "gone", "skiros:Product-9999"), ParamTypes.Required)
    ph.addParam("Number", 5, ParamTypes.Required)
    return ph


def holds(condition, ph, bench):
    return condition.evaluate(ph, bench.wmi)


def set_property(bench, key, value):
    element = bench.wmi.get_element(bench.product.id)
    element.setProperty(key, value)
    bench.wmi.update_element_properties(element)


# -- relations ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("relation", "subject", "object_", "fact"),
    [
        ("skiros:contain", "Tray", "Object", True),
        ("contain", "Tray", "Object", True),
        ("skiros:spatiallyRelated", "Tray", "Object", True),  # contain is under it
        ("skiros:hasA", "Tray", "Object", False),
        ("skiros:contain", "OtherTray", "Object", False),
        ("skiros:contain", "AnyTray", "Object", False),  # no element of exactly the class Container has it
        ("skiros:contain", "AnyLargeBox", "Object", True),
        ("skiros:contain", "Tray", "AnyStarter", False),  # it has some product, but no starter
        ("skiros:contain", "Tray", "Gone", False),
    ],
)
@pytest.mark.parametrize("state", [True, False])
def test_a_relation_condition(params, bench, relation, subject, object_, fact, state):
    assert holds(make.getRelationCond("C", relation, subject, object_, state), params, bench) is (fact is state)


def test_an_abstract_optional_side_means_some_element_of_its_type_and_one_without_a_value_none(params, bench):
    condition = make.getRelationCond("C", "skiros:contain", "Tray", "Maybe", True)
    assert holds(condition, params, bench)
    params.getParam("Maybe").unset()
    assert not holds(condition, params, bench)


@pytest.mark.parametrize("state", [True, False])
def test_a_relation_is_made_and_taken_back(params, bench, state):
    condition = make.getRelationCond("C", "skiros:contain", "OtherTray" if state else "Tray", "Object", state)
    assert not holds(condition, params, bench)
    assert condition.setTrue(params, bench.wmi)
    assert holds(condition, params, bench)
    condition.revert(params, bench.wmi)
    assert not holds(condition, params, bench)
    assert bench.wmi.get_relations(bench.tray.id, "skiros:contain", bench.product.id)


# -- properties --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("value", "operator", "wanted", "fact"),
    [
        (3.0, "=", 3.0, True),
        (3.0, "=", "3.0", True),
        (3.0, ">", 2.0, True),
        (3.0, "<", 2.0, False),
        (3.0, ">=", 3.0, True),
        (3.0, "<=", 2.9, False),
        (None, ">", 2.0, False),
        (None, "=", 2.0, False),
    ],
)
@pytest.mark.parametrize("state", [True, False])
def test_a_property_condition(params, bench, value, operator, wanted, fact, state):
    if value is not None:
        set_property(bench, "skiros:Weight", value)
    condition = make.getPropCond("C", "skiros:Weight", "Object", operator, wanted, state)
    is_compared = value is not None or operator == "="
    assert holds(condition, params, bench) is (is_compared and fact is state)


@pytest.mark.parametrize(("written", "wanted"), [("True", True), ("2", 2), ("Idle", "Idle")])
def test_numbers_and_bools_that_a_scene_writes_as_text_compare_equal(params, bench, written, wanted):
    set_property(bench, "skiros:StateProperty", written)
    assert holds(make.getPropCond("C", "skiros:StateProperty", "Object", "=", wanted, True), params, bench)


@pytest.mark.parametrize("key", ["Maybe", "Gone", "AnyStarter"])
def test_a_property_of_what_is_not_there_is_a_clear_false(params, bench, key):
    assert not holds(make.getPropCond("C", "skiros:Weight", key, "=", 1.0, True), params, bench)


@pytest.mark.parametrize(("value", "state"), [("Full", True), ("Empty", False), (True, True), (True, False)])
def test_a_property_is_made_and_taken_back(params, bench, value, state):
    key = "skiros:ContainerState" if isinstance(value, str) else "skiros:PublishTf"
    set_property(bench, key, "Empty" if isinstance(value, str) else not state)
    condition = make.getPropCond("C", key, "Object", "=", value, state)
    assert not holds(condition, params, bench)
    assert condition.setTrue(params, bench.wmi)
    assert holds(condition, params, bench)
    condition.revert(params, bench.wmi)
    assert not holds(condition, params, bench)


def test_an_unknown_operator_is_an_error_where_it_is_written():
    with pytest.raises(UnknownName, match="operator '~', expected one of = > < >= <="):
        make.getPropCond("C", "skiros:Weight", "Object", "~", 1.0, True)


@pytest.mark.parametrize(
    ("key", "state", "answer"),
    [("Object", True, False), ("Object", False, True), ("Maybe", True, True), ("AnyStarter", True, False)],
)
def test_a_has_property_condition_is_true_for_an_unset_optional_one(params, bench, key, state, answer):
    assert holds(make.getHasPropCond("C", "skiros:CadModel", key, state), params, bench) is answer


def test_a_has_property_condition_wants_a_value(params, bench):
    condition = make.getHasPropCond("C", "skiros:CadModel", "Object", True)
    set_property(bench, "skiros:CadModel", str)
    assert not holds(condition, params, bench)
    set_property(bench, "skiros:CadModel", "a.stl")
    assert holds(condition, params, bench)


# -- others ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("key", "fact"), [("Object", True), ("AnyTray", False), ("Gone", True)])
@pytest.mark.parametrize("state", [True, False])
def test_is_specified_means_an_element_with_an_id(params, bench, key, fact, state):
    assert holds(make.getIsSpecifiedCond("C", key, state), params, bench) is (fact is state)


def test_generate_makes_and_removes_elements(params, bench):
    made = make.getGenerateCond("C", "AnyStarter", True)
    assert not holds(made, params, bench)
    assert made.setTrue(params, bench.wmi)
    assert len(bench.wmi.resolve_elements(Element("skiros:Starter"))) == 1
    made.revert(params, bench.wmi)
    assert bench.wmi.resolve_elements(Element("skiros:Starter")) == []

    removed = make.getGenerateCond("C", "Object", False)
    assert removed.setTrue(params, bench.wmi)
    assert bench.wmi.find_element(bench.product.id) is None
    removed.revert(params, bench.wmi)
    assert bench.wmi.get_relations(bench.tray.id, "skiros:contain", bench.product.id)


def test_a_removed_element_comes_back_with_what_was_in_it(params, bench):
    label = bench.add("skiros:Part", "label", bench.product, CadModel="a.stl")
    bench.wmi.set_relation(bench.product.id, "skiros:at", bench.other_tray.id)
    before = scene_of(bench.wmi)
    params["Object"].value = bench.tray
    removed = make.getGenerateCond("C", "Object", False)
    assert removed.setTrue(params, bench.wmi)
    assert not any(bench.wmi.is_scene_element(e.id) for e in (bench.tray, bench.product, label))
    removed.revert(params, bench.wmi)
    assert scene_of(bench.wmi) == before


def scene_of(wmi):
    return {
        e.id: (
            e.type,
            e.label,
            sorted((p.key, p.values) for p in e.properties),
            sorted((r["src"], r["type"], r["dst"]) for r in e.getRelations()),
        )
        for e in wmi.resolve_elements(Element())
    }


@pytest.mark.parametrize(
    ("wanted", "answer"), [("skiros:Product", True), ("sumo:Object", True), ("skiros:Part", False)]
)
def test_on_type_means_the_class_or_one_under_it(params, bench, wanted, answer):
    assert holds(make.getOnTypeCond("C", "Object", wanted), params, bench) is answer


@pytest.mark.parametrize("state", [True, False])
def test_or_holds_when_one_part_does(params, bench, state):
    either = make.getOrCond(state)
    either.addCondition(make.getRelationCond("Left", "skiros:contain", "OtherTray", "Object", True))
    assert holds(either, params, bench) is (not state)
    either.addCondition(make.getRelationCond("Right", "skiros:contain", "Tray", "Object", True))
    assert holds(either, params, bench) is state
    assert "Left" in either.getDescription()
    assert "Right" in either.getDescription()


@pytest.mark.parametrize("state", [True, False])
def test_a_function_of_values(params, bench, state):
    condition = ConditionFunction("C", ["Number"], lambda number: number > 3, state)
    assert holds(condition, params, bench) is state


@pytest.mark.parametrize(
    ("relation", "subject", "object_", "fact"),
    [
        ("sumo:isLocationOf", "Tray", "Object", True),  # a container is the location of some manipulatable
        ("skiros:hasA", "Tray", "Object", False),
    ],
)
def test_an_abstract_relation_asks_the_ontology(params, bench, relation, subject, object_, fact):
    assert holds(make.getAbstractRelationCond("C", relation, subject, object_, True), params, bench) is fact


# -- what they share ---------------------------------------------------------------------------------------------------


def test_a_description_names_the_elements_that_were_checked(params, bench):
    condition = make.getRelationCond("InTray", "skiros:contain", "Tray", "Object", True)
    holds(condition, params, bench)
    assert condition.getDescription() == f"[InTray] {bench.tray!r} skiros:contain {bench.product!r}"
    assert condition.getParamId("Tray") == bench.tray.id


def test_remap_renames_keys(params, bench):
    condition = make.getRelationCond("C", "skiros:contain", "A", "B", True)
    condition.remap("A", "Tray")
    condition.remap("B", "Object")
    assert condition.getKeys() == ["Tray", "Object"]
    assert holds(condition, params, bench)


def test_a_key_that_the_skill_has_not_is_an_error_that_names_it(params, bench):
    with pytest.raises(UnknownName, match="condition 'C' uses 'Try'; the skill has: Tray"):
        holds(make.getRelationCond("C", "skiros:contain", "Try", "Object", True), params, bench)


def test_a_parameter_that_is_no_element_is_an_error_that_names_it(params, bench):
    with pytest.raises(WrongType, match="parameter 'Number' is 5, expected an element"):
        holds(make.getPropCond("C", "skiros:Weight", "Number", "=", 1.0, True), params, bench)


def test_equal_and_conflicting_conditions():
    one = make.getRelationCond("C", "skiros:contain", "A", "B", True)
    same = make.getRelationCond("other label", "contain", "A", "B", True)
    opposite = make.getRelationCond("C", "skiros:contain", "A", "B", False)
    assert one.isEqual(same)
    assert not one.isEqual(opposite)
    assert one.hasConflict(opposite)
    assert not one.hasConflict(make.getRelationCond("C", "skiros:contain", "B", "A", False))


def test_the_world_model_form():
    element = make.getPropCond("Heavy", "skiros:Weight", "Object", ">", 2.5, True).toElement()
    assert (element.type, element.label) == ("skiros:ConditionProperty", "Heavy")
    values = {p.key: p.value for p in element.properties}
    assert values == {
        "skiros:hasSubject": "Object",
        "skiros:appliedOnType": "skiros:Weight",
        "skiros:operator": ">",
        "skiros:desiredValue": 2.5,
        "skiros:desiredState": True,
    }
    relation = make.getRelationCond("In", "skiros:contain", "A", "B", False).toElement()
    assert relation.getProperty("skiros:hasObject").value == "B"
    assert relation.getProperty("skiros:desiredState").value is False


@pytest.mark.parametrize(
    ("condition", "etype", "values"),
    [
        (make.getHasPropCond("C", "Weight", "A", True), "ConditionHasProperty",
         {"hasSubject": "A", "appliedOnType": "skiros:Weight", "desiredState": True}),
        (make.getAbstractRelationCond("C", "contain", "A", "B", False), "AbstractConditionRelation",
         {"hasSubject": "A", "hasObject": "B", "appliedOnType": "skiros:contain", "desiredState": False}),
        (make.getIsSpecifiedCond("C", "A", True), "ConditionIsSpecified", {"hasSubject": "A", "desiredState": True}),
        (make.getGenerateCond("C", "A", False), "ConditionGenerate", {"hasSubject": "A", "desiredState": False}),
        (make.getOnTypeCond("C", "A", "Product"), "ConditionOnType",
         {"hasSubject": "A", "desiredValue": "skiros:Product"}),
        (ConditionFunction("C", ["A", "B"], max), "ConditionFunction", {"hasSubject": "A", "desiredState": True}),
    ],
)  # fmt: skip
def test_the_world_model_form_of_each_kind(condition, etype, values):
    element = condition.toElement()
    assert (element.type, element.label) == (f"skiros:{etype}", "C")
    assert {p.key: p.value for p in element.properties} == {f"skiros:{key}": v for key, v in values.items()}


def test_the_world_model_form_of_several_parts_has_them_below_it():
    either = make.getOrCond(True)
    either.addCondition(make.getIsSpecifiedCond("One", "A", True))
    either.addCondition(make.getIsSpecifiedCond("Other", "B", True))
    below = [(relation, part.label) for _, relation, part in either.toElement().local_relations]
    assert below == [("skiros:hasCondition", "One"), ("skiros:hasCondition", "Other")]
