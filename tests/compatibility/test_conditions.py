"""Conditions as libraries create, evaluate and read them. Compatibility, sections 2 and 7."""

from unittest.mock import Mock

import pytest

from compatibility.rules import rule
from skiros2_common.core.abstract_skill import SkillDescription
from skiros2_common.core.conditions import ConditionBase
from skiros2_common.core.params import ParamHandler, ParamTypes
from skiros2_common.core.world_element import Element

make = SkillDescription()
BOTH = pytest.mark.parametrize("state", [True, False])


@pytest.fixture
def ph():
    handler = ParamHandler()
    handler.addParam("Box", Element("skiros:LargeBox", "box", "skiros:LargeBox-1"), ParamTypes.Required)
    handler.addParam("Part", Element("skiros:Part", "part", "skiros:Part-2"), ParamTypes.Required)
    handler.addParam("AnyBox", Element("skiros:LargeBox"), ParamTypes.Inferred)
    handler.addParam("MaybeBox", Element("skiros:LargeBox"), ParamTypes.Optional)
    handler.addParam("Count", int, ParamTypes.Optional)
    handler["Box"].value.setProperty("skiros:Weight", 2.0)
    return handler


# -- on the element in the parameter -------------------------------------------------------------------------------


@rule("conditions", "Conditions on properties, specification and class need no world model (`wmi` None)")
@BOTH
@pytest.mark.parametrize(
    ("condition", "fact"),
    [
        (lambda s: make.getPropCond("C", "Weight", "Box", "=", 2.0, s), True),
        (lambda s: make.getPropCond("C", "skiros:Weight", "Box", ">", 3.0, s), False),
        (lambda s: make.getHasPropCond("C", "skiros:Weight", "Box", s), True),
        (lambda s: make.getIsSpecifiedCond("C", "Box", s), True),
        (lambda s: make.getIsSpecifiedCond("C", "AnyBox", s), False),
        (lambda s: make.getGenerateCond("C", "Box", s), True),
        (lambda s: make.getGenerateCond("C", "AnyBox", s), False),
    ],
)
def test_no_world_model_is_needed(ph, condition, fact, state):
    assert condition(state).evaluate(ph, None) is (fact is state)


@rule("conditions", "Changes of an element that are not written count", better="an unchanged element is read again")
def test_local_changes_count(skill_bench):
    box = skill_bench.add("skiros:LargeBox", "box")
    ph = ParamHandler()
    ph.addParam("Box", box, ParamTypes.Required)
    full = make.getPropCond("Full", "skiros:ContainerState", "Box", "=", "Full", True)
    other = skill_bench.wmi.get_element(box.id)
    other.setProperty("skiros:ContainerState", "Full")
    skill_bench.wmi.update_element(other)
    assert full.evaluate(ph, skill_bench.wmi)
    ph["Box"].value.setProperty("skiros:ContainerState", "Empty")
    assert not full.evaluate(ph, skill_bench.wmi)


@rule(
    "conditions", "A has-property condition of an element without id is True when the parameter is Optional, else False"
)
@BOTH
def test_has_property_without_an_id(ph, state):
    assert make.getHasPropCond("C", "skiros:Weight", "MaybeBox", state).evaluate(ph, None)
    assert not make.getHasPropCond("C", "skiros:Weight", "AnyBox", state).evaluate(ph, None)


@rule("conditions", "A property condition `=` is True when the value is among the property's, as desired")
@BOTH
def test_one_of_several_values(ph, state):
    ph["Box"].value.setProperty("skiros:Names", ["a", "b"])
    assert make.getPropCond("C", "skiros:Names", "Box", "=", "b", state).evaluate(ph, None) is state
    assert make.getPropCond("C", "skiros:Missing", "Box", "=", "b", state).evaluate(ph, None) is not state


@rule("conditions", "With `<`, `>`, `<=`, `>=` a missing property is False for both desired states")
@BOTH
@pytest.mark.parametrize("operator", ["<", ">", "<=", ">="])
def test_a_missing_property_compares_to_nothing(ph, operator, state):
    assert not make.getPropCond("C", "skiros:Missing", "Box", operator, 1.0, state).evaluate(ph, None)
    assert not make.getPropCond("C", "skiros:Weight", "AnyBox", operator, 1.0, state).evaluate(ph, None)


@rule("conditions", "A property condition on an abstract element looks at that element")
def test_a_property_of_an_abstract_element(ph):
    ph["AnyBox"].value.setProperty("skiros:Weight", 5.0)
    assert make.getPropCond("C", "skiros:Weight", "AnyBox", "=", 5.0, True).evaluate(ph, None)
    assert make.getPropCond("C", "skiros:Weight", "AnyBox", ">", 4.0, True).evaluate(ph, None)


@rule("conditions", "An on-type condition looks at the element's class, also of an abstract one; subclasses ask `wmi`")
def test_on_type(ph):
    assert make.getOnTypeCond("C", "Box", "LargeBox").evaluate(ph, None)
    assert make.getOnTypeCond("C", "AnyBox", "skiros:LargeBox").evaluate(ph, None)
    wmi = FakeWorld()
    assert make.getOnTypeCond("C", "Box", "skiros:Container").evaluate(ph, wmi)
    assert not make.getOnTypeCond("C", "Box", "skiros:Part").evaluate(ph, wmi)


@rule("conditions", "A parameter without any value is as an unset one: the fact is false")
def test_a_parameter_without_a_value(ph):
    for key in ("Box", "Part"):
        ph[key].unset()
    for fact in (
        make.getPropCond("C", "skiros:Weight", "Box", "=", 2.0, True),
        make.getIsSpecifiedCond("C", "Box", True),
        make.getGenerateCond("C", "Box", True),
        make.getOnTypeCond("C", "Box", "skiros:LargeBox"),
        make.getRelationCond("C", "skiros:contain", "Box", "Part", True),
        make.getIsSpecifiedCond("C", "Count", True),
    ):
        assert not fact.evaluate(ph, FakeWorld())
    assert make.getIsSpecifiedCond("C", "Box", False).evaluate(ph, None)


# -- on the world model --------------------------------------------------------------------------------------------


class FakeWorld:
    """What a library writes to test its skills: some methods of the world model's interface."""

    def __init__(self, *relations, classes=()):
        self.relations = [dict(zip(("src", "type", "dst"), r, strict=True)) for r in relations]
        self.classes = {"skiros:Container": ["skiros:Container", "skiros:LargeBox"], **dict(classes)}
        self.asked = []

    def get_relations(self, subj, pred, obj):
        subj, obj = (getattr(side, "id", side) for side in (subj, obj))
        return [
            r for r in self.relations if subj in ("", r["src"]) and pred in ("", r["type"]) and obj in ("", r["dst"])
        ]

    def get_sub_classes(self, parent_class, recursive=True):
        return self.classes.get(parent_class, [parent_class])

    def query_ontology(self, query, cut_prefix=True, context=""):
        self.asked.append(query)
        return ["skiros:Part "] if "skiros:Part" in query else []


IN = ("skiros:LargeBox-1", "skiros:contain", "skiros:Part-2")


@rule("conditions", "Relation conditions use only documented methods of `wmi`: a library's fake world model works")
@BOTH
def test_a_fake_world_model_is_enough(ph, state):
    condition = make.getRelationCond("C", "contain", "Box", "Part", state)
    assert condition.evaluate(ph, FakeWorld(IN)) is state
    assert condition.evaluate(ph, FakeWorld()) is not state
    mock = Mock(get_relations=Mock(return_value=[]))
    assert condition.evaluate(ph, mock) is not state


@rule("conditions", "In a relation condition an abstract side is some element of exactly that class")
def test_an_abstract_side(ph):
    inside = make.getRelationCond("C", "skiros:contain", "AnyBox", "Part", True)
    assert inside.evaluate(ph, FakeWorld(IN))
    assert not inside.evaluate(ph, FakeWorld(("skiros:Tray-1", *IN[1:])))
    ph.addParam("AnyContainer", Element("skiros:Container"), ParamTypes.Inferred)
    assert not make.getRelationCond("C", "skiros:contain", "AnyContainer", "Part", True).evaluate(ph, FakeWorld(IN))
    ph.addParam("AnyPart", Element("skiros:Part"), ParamTypes.Inferred)
    assert make.getRelationCond("C", "skiros:contain", "AnyBox", "AnyPart", True).evaluate(ph, FakeWorld(IN))


@rule("conditions", "An abstract relation condition is evaluated by the restrictions of the classes")
@BOTH
def test_an_abstract_relation(skill_bench, ph, state):
    wmi = skill_bench.wmi
    ph["Box"].value, ph["Part"].value = skill_bench.add("skiros:LargeBox", "b"), skill_bench.add("skiros:Part", "p")
    allowed = make.getAbstractRelationCond("C", "sumo:isLocationOf", "Box", "Part", state)
    assert allowed.evaluate(ph, wmi) is state
    assert make.getAbstractRelationCond("C", "skiros:hasA", "Box", "Part", state).evaluate(ph, wmi) is not state
    asked = FakeWorld()
    assert allowed.evaluate(ph, asked) is state
    assert "sumo:isLocationOf" in asked.asked[0]


@rule("conditions", "`query_ontology` answers an abstract relation as the world model does itself")
@pytest.mark.parametrize(("relation", "fact"), [("sumo:isLocationOf", True), ("skiros:hasA", False)])
def test_an_abstract_relation_by_a_query(skill_bench, ph, relation, fact):
    class Queries:
        def query_ontology(self, query):
            return skill_bench.wmi.query_ontology(query)

    condition = make.getAbstractRelationCond("C", relation, "Box", "Part", True)
    assert condition.evaluate(ph, Queries()) is condition.evaluate(ph, skill_bench.wmi)
    assert condition.evaluate(ph, Queries()) is fact


# -- the objects themselves ----------------------------------------------------------------------------------------


@rule("conditions", "`==` on conditions is `isEqual`")
def test_equal_conditions():
    one = make.getRelationCond("C", "skiros:contain", "A", "B", True)
    assert one == make.getRelationCond("other", "contain", "A", "B", True)
    assert one != make.getRelationCond("C", "skiros:contain", "A", "B", False)
    assert one != "C"
    assert one in [make.getIsSpecifiedCond("C", "A", True), make.getRelationCond("C", ":contain", "A", "B", True)]


@rule("conditions", "`getKeys()` of a relation is `[subject, object]`, also when both are equal")
def test_keys():
    assert make.getRelationCond("C", "skiros:at", "A", "A", True).getKeys() == ["A", "A"]
    assert make.getAbstractRelationCond("C", "skiros:at", "A", "B", True).getKeys() == ["A", "B"]


@rule("conditions", "`_label, _subject_key, _object_key, _owl_label, _operator, _value, _desired_state, _description`")
def test_private_names():
    condition = make.getPropCond("Heavy", "Weight", "Box", ">", 2.5, True)
    assert (condition._label, condition._subject_key, condition._owl_label) == ("Heavy", "Box", "Weight")
    assert (condition._operator, condition._value, condition._desired_state) == (">", 2.5, True)
    assert "Weight > 2.5" in condition._description
    assert condition.getDescription() == f"[Heavy] {condition._description}"
    relation = make.getRelationCond("In", "contain", "A", "B", False)
    assert (relation._object_key, relation._owl_label) == ("B", "contain")
    assert make.getOnTypeCond("C", "A", "skiros:Part")._value == "skiros:Part"


@rule("conditions", "A library's own condition derives from `ConditionBase` and overrides `evaluate`")
def test_a_condition_of_a_library(ph):
    class Light(ConditionBase):
        def __init__(self, label, subj, desired_state):
            super().__init__(label, subj, desired_state)
            self._description = f"{subj} is light"

        def evaluate(self, ph, wmi):
            return (ph.getParamValue(self._subject_key).getProperty("skiros:Weight").value < 5.0) == self._desired_state

    condition = Light("Light", "Box", True)
    assert condition.evaluate(ph, None)
    assert condition.getDescription() == "[Light] Box is light"
    assert condition.toElement().getProperty("skiros:hasSubject").value == "Box"


@rule("conditions", "`toElement()` of an on-type condition has `desiredValue` (the class), no `desiredState`")
def test_the_element_of_an_on_type_condition():
    element = make.getOnTypeCond("C", "A", "skiros:Product").toElement()
    assert {p.key: p.value for p in element.properties} == {
        "skiros:hasSubject": "A", "skiros:desiredValue": "skiros:Product",
    }  # fmt: skip


@rule("conditions", "`toElement()` of an or-condition has the label `or` and only `desiredState`")
@BOTH
def test_the_element_of_an_or_condition(state):
    either = make.getOrCond(state)
    either.addCondition(make.getIsSpecifiedCond("One", "A", True))
    element = either.toElement()
    assert element.label == "or"
    assert {p.key: p.value for p in element.properties} == {"skiros:desiredState": state}


@rule("conditions", "`setDesiredState(ph)` puts what is wanted on abstract elements: value, empty property, class")
def test_set_desired_state_of_one_element(ph):
    box = ph["AnyBox"].value
    make.getPropCond("C", "skiros:ContainerState", "AnyBox", "=", "Empty", True).setDesiredState(ph)
    make.getPropCond("C", "skiros:ContainerState", "AnyBox", "=", "Open", True).setDesiredState(ph)
    assert box.getProperty("skiros:ContainerState").values == ["Empty", "Open"]
    make.getHasPropCond("C", "skiros:Size", "AnyBox", True).setDesiredState(ph)
    assert box.getProperty("skiros:Size").values == []
    make.getOnTypeCond("C", "AnyBox", "skiros:Tray").setDesiredState(ph)
    assert box.type == "skiros:Tray"


@rule("conditions", "`setDesiredState(ph)` of a relation notes it on abstract elements with the other key as far end")
@BOTH
@pytest.mark.parametrize("kind", ["getRelationCond", "getAbstractRelationCond"])
def test_set_desired_state_of_a_relation(ph, kind, state):
    getattr(make, kind)("C", "skiros:contain", "AnyBox", "MaybeBox", state).setDesiredState(ph)
    abstract = kind == "getAbstractRelationCond"
    assert ph["AnyBox"].value.hasRelation("-1", "skiros:contain", "MaybeBox", state, abstract)
    assert ph["MaybeBox"].value.hasRelation("AnyBox", "skiros:contain", "-1", state, abstract)
