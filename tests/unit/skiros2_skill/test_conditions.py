"""What each kind of condition says of the scene, as a fact and as an effect. Contract, section 3."""

import pytest

from skiros2_common.core.abstract_skill import SkillDescription
from skiros2_common.core.condition_record import Cost
from skiros2_common.core.conditions import ConditionBase, ConditionFunction, condition_from
from skiros2_common.core.errors import UnknownName, WrongType
from skiros2_common.core.params import ParamHandler, ParamTypes
from skiros2_common.core.world_element import Element
from skiros2_task.core.skills import SkillCondition

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
def test_relation_condition_holds_for_existing_relations(params, bench, relation, subject, object_, fact, state):
    assert holds(make.getRelationCond("C", relation, subject, object_, state), params, bench) is (fact is state)


def test_abstract_optional_side_matches_any_element_of_its_class(params, bench):
    condition = make.getRelationCond("C", "skiros:contain", "Tray", "Maybe", True)
    assert holds(condition, params, bench)
    params.getParam("Maybe").unset()
    assert not holds(condition, params, bench)


@pytest.mark.parametrize("state", [True, False])
def test_relation_effect_is_applied_and_undone(params, bench, state):
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
def test_property_condition_compares_values(params, bench, value, operator, wanted, fact, state):
    if value is not None:
        set_property(bench, "skiros:Weight", value)
    condition = make.getPropCond("C", "skiros:Weight", "Object", operator, wanted, state)
    is_compared = value is not None or operator == "="
    assert holds(condition, params, bench) is (is_compared and fact is state)


@pytest.mark.parametrize(("written", "wanted"), [("True", True), ("2", 2), ("Idle", "Idle")])
def test_text_of_numbers_and_bools_compares_equal(params, bench, written, wanted):
    set_property(bench, "skiros:StateProperty", written)
    assert holds(make.getPropCond("C", "skiros:StateProperty", "Object", "=", wanted, True), params, bench)


@pytest.mark.parametrize("key", ["Maybe", "Gone", "AnyStarter"])
def test_property_condition_on_a_missing_element_is_false(params, bench, key):
    assert not holds(make.getPropCond("C", "skiros:Weight", key, "=", 1.0, True), params, bench)


@pytest.mark.parametrize(("value", "state"), [("Full", True), ("Empty", False), (True, True), (True, False)])
def test_property_effect_is_applied_and_undone(params, bench, value, state):
    key = "skiros:ContainerState" if isinstance(value, str) else "skiros:PublishTf"
    set_property(bench, key, "Empty" if isinstance(value, str) else not state)
    condition = make.getPropCond("C", key, "Object", "=", value, state)
    assert not holds(condition, params, bench)
    assert condition.setTrue(params, bench.wmi)
    assert holds(condition, params, bench)
    condition.revert(params, bench.wmi)
    assert not holds(condition, params, bench)


def test_unknown_operator_is_refused_at_its_declaration():
    with pytest.raises(UnknownName, match="operator '~', expected one of = > < >= <="):
        make.getPropCond("C", "skiros:Weight", "Object", "~", 1.0, True)


@pytest.mark.parametrize(
    ("key", "state", "answer"),
    [("Object", True, False), ("Object", False, True), ("Maybe", True, True), ("AnyStarter", True, False)],
)
def test_has_property_condition_is_true_for_an_unset_optional_parameter(params, bench, key, state, answer):
    assert holds(make.getHasPropCond("C", "skiros:CadModel", key, state), params, bench) is answer


def test_has_property_condition_requires_a_value(params, bench):
    condition = make.getHasPropCond("C", "skiros:CadModel", "Object", True)
    set_property(bench, "skiros:CadModel", str)
    assert not holds(condition, params, bench)
    set_property(bench, "skiros:CadModel", "a.stl")
    assert holds(condition, params, bench)


# -- others ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("key", "fact"), [("Object", True), ("AnyTray", False), ("Gone", True)])
@pytest.mark.parametrize("state", [True, False])
def test_is_specified_condition_requires_an_element_with_id(params, bench, key, fact, state):
    assert holds(make.getIsSpecifiedCond("C", key, state), params, bench) is (fact is state)


def test_generate_condition_creates_and_removes_elements(params, bench):
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


def test_undone_removal_restores_the_contents(params, bench):
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
def test_on_type_condition_accepts_subclasses(params, bench, wanted, answer):
    assert holds(make.getOnTypeCond("C", "Object", wanted), params, bench) is answer


@pytest.mark.parametrize("state", [True, False])
def test_or_condition_holds_if_one_part_holds(params, bench, state):
    either = make.getOrCond(state)
    either.addCondition(make.getRelationCond("Left", "skiros:contain", "OtherTray", "Object", True))
    assert holds(either, params, bench) is (not state)
    either.addCondition(make.getRelationCond("Right", "skiros:contain", "Tray", "Object", True))
    assert holds(either, params, bench) is state
    assert "Left" in either.getDescription()
    assert "Right" in either.getDescription()


@pytest.mark.parametrize("state", [True, False])
def test_function_condition_is_called_with_values(params, bench, state):
    condition = ConditionFunction("C", ["Number"], lambda number: number > 3, state)
    assert holds(condition, params, bench) is state


@pytest.mark.parametrize(
    ("relation", "subject", "object_", "fact"),
    [
        ("sumo:isLocationOf", "Tray", "Object", True),  # a container is the location of some manipulatable
        ("skiros:hasA", "Tray", "Object", False),
    ],
)
def test_abstract_relation_condition_queries_the_ontology(params, bench, relation, subject, object_, fact):
    assert holds(make.getAbstractRelationCond("C", relation, subject, object_, True), params, bench) is fact


# -- what they share ---------------------------------------------------------------------------------------------------


def test_description_names_the_evaluated_elements(params, bench):
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


def test_condition_on_an_unknown_key_raises_with_the_key(params, bench):
    with pytest.raises(UnknownName, match="condition 'C' uses 'Try'; the skill has: Tray"):
        holds(make.getRelationCond("C", "skiros:contain", "Try", "Object", True), params, bench)


def test_condition_on_a_value_parameter_raises_with_the_key(params, bench):
    with pytest.raises(WrongType, match="parameter 'Number' is 5, expected an element"):
        holds(make.getPropCond("C", "skiros:Weight", "Number", "=", 1.0, True), params, bench)


def test_conditions_are_equal_or_conflict():
    one = make.getRelationCond("C", "skiros:contain", "A", "B", True)
    same = make.getRelationCond("other label", "contain", "A", "B", True)
    opposite = make.getRelationCond("C", "skiros:contain", "A", "B", False)
    assert one.isEqual(same)
    assert not one.isEqual(opposite)
    assert one.hasConflict(opposite)
    assert not one.hasConflict(make.getRelationCond("C", "skiros:contain", "B", "A", False))


def test_condition_becomes_a_world_model_element():
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
def test_element_of_each_kind_has_its_properties(condition, etype, values):
    element = condition.toElement()
    assert (element.type, element.label) == (f"skiros:{etype}", "C")
    assert {p.key: p.value for p in element.properties} == {f"skiros:{key}": v for key, v in values.items()}


def test_element_of_an_or_condition_has_its_parts_as_children():
    either = make.getOrCond(True)
    either.addCondition(make.getIsSpecifiedCond("One", "A", True))
    either.addCondition(make.getIsSpecifiedCond("Other", "B", True))
    below = [(relation, part.label) for _, relation, part in either.toElement().local_relations]
    assert below == [("skiros:hasCondition", "One"), ("skiros:hasCondition", "Other")]


# -- a kind of condition of a library ----------------------------------------------------------------------------------


class Heavy(ConditionBase):
    """A new kind of condition: all that the platform needs to know about it stands in its class."""

    cost = Cost.CODE
    wants_elements = True

    @classmethod
    def from_record(cls, record):
        return cls(record.label, record.subject, record.state)

    def ontology_names(self):
        return [("property", "skiros:Weight")]

    def element_ids(self, ph):
        return {ph.getParamValue("Object").id}

    def holds(self, ph, wmi):
        return (ph.getParamValue("Object").value_of("skiros:Weight") or 0.0) > 5.0


def test_new_kind_of_condition_is_made_from_its_record():
    record = SkillCondition("Heavy", "Heavy", "Object", state=False)
    assert condition_from(record) == Heavy("Heavy", "Object", False)
    assert condition_from(SkillCondition("Unheard", "Heavy", "Object")) is None


def test_condition_of_one_element_is_affected_by_its_changes_only(params, bench):
    condition = Heavy("Heavy", "Object", True)
    assert condition.affected_by({bench.product.id}, params)
    assert not condition.affected_by({bench.tray.id}, params)
    assert condition.affected_by((), params)  # the ontologies


def test_subclass_with_another_evaluation_is_affected_by_all_changes(params, bench):
    class Heaviest(Heavy):
        def holds(self, ph, wmi):
            return False

    assert Heaviest("Heaviest", "Object", True).affected_by({bench.tray.id}, params)
    assert condition_from(SkillCondition("Heaviest", "Heaviest", "Object")) is None
