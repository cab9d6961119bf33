"""The explanation of each kind of unsatisfied condition: expected, found, near matches, authors of changes."""

import time
from functools import partial

import pytest

from skiros2_common.core.abstract_skill import SkillDescription
from skiros2_common.core.conditions import ConditionBase, ConditionFunction
from skiros2_common.core.discrete_reasoner import DiscreteReasoner, reasoners
from skiros2_common.core.explanation import Change, Explanation
from skiros2_common.core.params import ParamHandler, ParamTypes
from skiros2_common.core.world_element import Element
from skiros2_skill.core.runtime.diagnosis import add_authors
from skiros2_world_model.core.journal import Journal
from skiros2_world_model.core.local_world_model import LocalWorldModel, source_ontologies
from skiros2_world_model.core.world_model import WorldModel
from unit.skiros2_skill.conftest import Workbench

make = SkillDescription()
prop = partial(make.getPropCond, "C")
has = partial(make.getHasPropCond, "C")
GONE = Element("skiros:Product", "gone", "skiros:Product-9999")


def set_property(bench, element, key, value):
    element = bench.wmi.get_element(element.id)
    element.setProperty(key, value)
    bench.wmi.update_element_properties(element)


@pytest.fixture
def params(bench):
    set_property(bench, bench.product, "skiros:State", "Busy")
    set_property(bench, bench.other_product, "skiros:State", "Idle")
    set_property(bench, bench.other_product, "skiros:Weight", 4.0)
    ph = ParamHandler()
    ph.addParam("Tray", bench.tray, ParamTypes.Required)
    ph.addParam("OtherTray", bench.other_tray, ParamTypes.Required)
    ph.addParam("Object", bench.product, ParamTypes.Required)
    ph.addParam("OtherObject", bench.other_product, ParamTypes.Required)
    ph.addParam("AnyStarter", Element("skiros:Starter"), ParamTypes.Inferred)
    ph.addParam("Unset", Element("skiros:Product"), ParamTypes.Optional)
    ph.getParam("Unset").unset()
    ph.addParam("Gone", GONE, ParamTypes.Required)
    ph.addParam("Number", 5, ParamTypes.Required)
    return ph


def explained(condition, ph, bench):
    """The finding of a condition that does not hold."""
    assert not condition.evaluate(ph, bench.wmi)
    finding = condition.explain(ph, bench.wmi)
    assert finding.kind == type(condition).__name__
    assert set(finding.values) == set(condition.getKeys())
    explanation = Explanation("pre", "skiros:Pick", "pick", 1, -1, "", findings=[finding])
    assert Explanation.from_json(explanation.to_json()) == explanation
    return finding


def nearest(finding):
    return [str(near) for near in finding.nearest]


# -- relations ---------------------------------------------------------------------------------------------------------


def test_unsatisfied_relation_names_the_relations_of_both_sides(params, bench):
    finding = explained(make.getRelationCond("In", "contain", "OtherTray", "Object", True), params, bench)
    tray, other, product = repr(bench.tray), repr(bench.other_tray), repr(bench.product)
    assert finding.expected == f"{other} skiros:contain {product}"
    assert finding.found == (
        f"{other} skiros:contain {bench.other_product!r}; {tray} skiros:contain {product}"
    )  # fmt: skip
    assert nearest(finding) == [
        f"{tray}: skiros:contain {product}",
        f"{bench.other_product!r}: {other} skiros:contain it",
    ]
    assert finding.changes == [
        Change(bench.other_tray.id, "skiros:contain"),
        Change(bench.product.id, "skiros:contain"),
    ]


def test_undesired_relation_names_elements_without_it(params, bench):
    finding = explained(make.getRelationCond("Free", "contain", "Tray", "Object", False), params, bench)
    fact = f"{bench.tray!r} skiros:contain {bench.product!r}"
    assert (finding.found, finding.expected) == (fact, f"not {fact}")
    assert nearest(finding) == [f"{bench.other_tray!r}: not skiros:contain {bench.product!r}"]


def test_sides_without_relations_are_reported(params, bench):
    bench.wmi.set_relation(bench.other_tray.id, "skiros:contain", bench.other_product.id, False)
    finding = explained(make.getRelationCond("In", "contain", "OtherTray", "OtherObject", True), params, bench)
    assert finding.found == (
        f"{bench.other_tray!r} skiros:contain nothing; nothing skiros:contain {bench.other_product!r}"
    )


def test_first_of_many_relations_are_named_and_the_rest_counted(params, bench):
    for _ in range(5):
        bench.add("skiros:Product", "p", bench.other_tray)
    finding = explained(make.getRelationCond("In", "contain", "OtherTray", "Object", True), params, bench)
    assert f"{bench.other_product!r}, " in finding.found
    assert " and 3 more; " in finding.found


def test_relation_to_an_unset_parameter_names_relations_of_the_other_side(params, bench):
    finding = explained(make.getRelationCond("In", "contain", "Tray", "AnyStarter", True), params, bench)
    assert finding.expected == f"{bench.tray!r} skiros:contain any skiros:Starter"
    assert finding.found == (
        f"parameter 'AnyStarter' is any skiros:Starter; {bench.tray!r} skiros:contain {bench.product!r}"
    )


def test_removed_element_is_named(params, bench):
    finding = explained(make.getRelationCond("In", "contain", "Tray", "Gone", True), params, bench)
    assert finding.found == f"{GONE!r} is not in the scene"
    assert Change(GONE.id) in finding.changes


def test_reasoner_relation_names_the_computed_relations(params, bench, monkeypatch):
    class Nearness(DiscreteReasoner):
        def getAssociatedRelations(self):
            return ["skiros:near", "skiros:far"]

        def computeRelations(self, sub, obj, with_metrics=False):
            return ["skiros:far"]

    monkeypatch.setattr(reasoners, "_by_name", {})
    monkeypatch.setattr(reasoners, "_owners", {})
    reasoners.add(Nearness())
    finding = explained(make.getRelationCond("Near", "skiros:near", "Tray", "Object", True), params, bench)
    assert finding.found == f"{bench.tray!r} skiros:far {bench.product!r}"
    assert (finding.nearest, finding.changes) == ([], [])


def test_abstract_relation_names_the_classes(params, bench):
    finding = explained(make.getAbstractRelationCond("Fits", "contain", "Object", "Tray", True), params, bench)
    assert finding.found == "the ontology does not allow skiros:Product skiros:contain skiros:LargeBox"


# -- properties --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("condition", "found", "expected", "near"),
    [
        (prop("State", "Object", "=", "Idle", True), "skiros:State is 'Busy'", "'Idle'", "'Idle'"),
        (prop("State", "Object", "=", "Busy", False), "skiros:State is 'Busy'", "not 'Busy'", "'Idle'"),
        (prop("Weight", "Object", ">", 3.0, True), "skiros:Weight is missing", "> 3.0", "4.0"),
        (prop("Weight", "OtherObject", "<", 5.0, False), "skiros:Weight is 4.0", "not < 5.0", "missing"),
        (has("Weight", "Object", True), "skiros:Weight is missing", "a value", "4.0"),
        (has("Weight", "OtherObject", False), "skiros:Weight is 4.0", "no value", "missing"),
    ],
)  # fmt: skip
def test_unsatisfied_property_names_its_value_and_matching_elements(params, bench, condition, found, expected, near):
    finding = explained(condition, params, bench)
    subject, other = (bench.product, bench.other_product)[:: 1 if "Object" in condition.getKeys() else -1]
    assert finding.found == f"{subject!r}: {found}"
    assert finding.expected == expected
    assert nearest(finding) == [f"{other!r}: {condition.property} is {near}"]
    assert finding.changes == [Change(subject.id, condition.property)]


@pytest.mark.parametrize(
    ("key", "found"),
    [("Unset", "parameter 'Unset' is unset"), ("Gone", f"{GONE!r} is not in the scene")],
)
@pytest.mark.parametrize("value", ["Idle", "Busy"])
def test_property_of_an_unset_parameter_says_so(params, bench, key, found, value):
    assert explained(prop("State", key, "=", value, True), params, bench).found == found


def test_at_most_three_elements_are_named_in_order_of_ids(params, bench):
    more = [bench.add("skiros:Product", "p", State="Idle") for _ in range(12)]
    finding = explained(prop("State", "Object", "=", "Idle", True), params, bench)
    assert [near.element for near in finding.nearest] == [repr(e) for e in (bench.other_product, *more[:2])]


# -- values ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("factory", [make.getIsSpecifiedCond, make.getGenerateCond])
def test_unset_parameter_names_possible_elements(params, bench, factory):
    finding = explained(factory("Set", "Unset", True), params, bench)
    assert (finding.found, finding.expected) == ("parameter 'Unset' is unset", "an element of the scene")
    assert nearest(finding) == [repr(bench.product), repr(bench.other_product)]
    finding = explained(factory("Set", "Tray", False), params, bench)
    assert (finding.found, finding.expected) == (f"parameter 'Tray' is {bench.tray!r}", "no element")
    assert finding.nearest == []


def test_value_of_a_different_class_names_both_classes(params, bench):
    starter = bench.add("skiros:Starter", "starter")
    finding = explained(make.getOnTypeCond("Type", "Object", "skiros:Starter"), params, bench)
    assert (finding.found, finding.expected) == (f"{bench.product!r} is a skiros:Product", "a skiros:Starter")
    if bench.wmi.is_subclass("skiros:Starter", "skiros:Product"):
        assert nearest(finding) == [f"{starter!r}: a skiros:Starter"]


def test_function_condition_shows_its_arguments_without_a_new_call(params, bench):
    calls = []

    def is_odd(number):
        calls.append(number)
        return number % 2 == 1

    finding = explained(ConditionFunction("Even", ["Number"], is_odd, False), params, bench)
    assert (finding.found, finding.expected) == ("is_odd(5) is True", "False")
    assert calls == [5]


# -- conditions made of others, and of authors -------------------------------------------------------------------------


def test_or_condition_explains_each_part(params, bench):
    either = make.getOrCond(True)
    either.addCondition(make.getPropCond("Idle", "State", "Object", "=", "Idle", True))
    either.addCondition(make.getPropCond("Heavy", "Weight", "Object", ">", 3.0, True))
    finding = explained(either, params, bench)
    product = repr(bench.product)
    assert finding.expected == "[Idle] 'Idle' or [Heavy] > 3.0"
    assert finding.found == f"{product}: skiros:State is 'Busy'; {product}: skiros:Weight is missing"
    assert [part.label for part in finding.parts] == ["Idle", "Heavy"]
    assert all(nearest(part) for part in finding.parts)


def test_undesired_or_condition_names_the_part_that_holds(params, bench):
    neither = make.getOrCond(False)
    neither.addCondition(make.getPropCond("Idle", "State", "Object", "=", "Idle", True))
    neither.addCondition(make.getPropCond("Busy", "State", "Object", "=", "Busy", True))
    finding = explained(neither, params, bench)
    assert finding.expected == "none of them"
    assert finding.found == f"[Busy] {bench.product!r} skiros:State = Busy"


def test_condition_without_explanation_is_described(params, bench):
    class Lucky(ConditionBase):
        def evaluate(self, ph, wmi):
            return False

        def getDescription(self):
            return f"[{self._label}] the number is lucky"

    finding = explained(Lucky("Lucky", "Number", True), params, bench)
    assert str(finding) == "[Lucky] it does not hold, expected the number is lucky"


# -- who changed it ----------------------------------------------------------------------------------------------------


def why(finding, stamp):
    return Explanation("pre", "skiros:Pick", "pick", 1, -1, "", findings=[finding], stamp=stamp)


@pytest.fixture
def journalled(tmp_path):
    journal = Journal(tmp_path / "wm.journal")
    model = WorldModel(source_ontologies(), tmp_path, journal=journal)
    yield Workbench(LocalWorldModel("mary", model)), LocalWorldModel("paul", model)
    journal.close()


def test_finding_names_the_authors_of_the_last_changes(journalled):
    bench, paul = journalled
    paul.set_relation(bench.tray.id, "skiros:contain", bench.product.id, False)
    set_property(bench, bench.product, "skiros:Weight", 1.0)  # another fact of it
    ph = ParamHandler()
    ph.addParam("Tray", bench.tray, ParamTypes.Required)
    ph.addParam("Object", bench.product, ParamTypes.Required)
    finding = explained(make.getRelationCond("In", "spatiallyRelated", "Tray", "Object", True), ph, bench)
    explanation = why(finding, time.time())
    add_authors([explanation], bench.wmi)
    assert [change.author for change in explanation.all_changes()] == ["paul", "paul"]
    assert "was last changed at " in str(explanation)
    assert "by paul" in str(explanation)


def test_change_after_the_failure_is_omitted(journalled):
    bench, paul = journalled
    failed_at = time.time()
    element = paul.get_element(bench.product.id)
    element.setProperty("skiros:Weight", 1.0)
    paul.update_element(element)
    explanation = why(prop("Weight", "Object", ">", 3.0, True), failed_at)
    explanation.findings = []
    ph = ParamHandler()
    ph.addParam("Object", bench.product, ParamTypes.Required)
    explanation.findings = [explained(prop("Weight", "Object", ">", 3.0, True), ph, bench)]
    add_authors([explanation], bench.wmi)
    assert [change.author for change in explanation.all_changes()] == [""]


def test_authors_are_unknown_without_a_journal(params, bench):
    explanation = why(explained(prop("State", "Object", "=", "Idle", True), params, bench), time.time())
    add_authors([explanation], bench.wmi)
    assert [change.author for change in explanation.all_changes()] == [""]
    assert "last changed" not in str(explanation)
