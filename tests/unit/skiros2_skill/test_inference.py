"""The search for elements: against a search through all combinations, and what it says when there are none."""

import itertools

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from skiros2_common.core.abstract_skill import SkillDescription
from skiros2_common.core.conditions import ConditionFunction
from skiros2_common.core.discrete_reasoner import DiscreteReasoner, reasoners
from skiros2_common.core.explanation import FilterStep
from skiros2_common.core.names import id_order
from skiros2_common.core.params import ParamHandler, ParamTypes
from skiros2_common.core.world_element import Element
from skiros2_skill.core.engine.inference import failure_text, filter_candidates, infer
from skiros2_world_model.core.local_world_model import LocalWorldModel
from support.fuzz import examples

make = SkillDescription()
CLASSES = ["skiros:LargeBox", "skiros:Product"]
RELATIONS = ["skiros:at", "skiros:partReference"]
KEYS = "ABC"
STATES = ["Idle", "Busy", 1.0, 2.0]


def make_scene(wmi, kinds, related, states):
    """Elements of some classes, each with a state or none, and relations between them."""
    elements = []
    for kind, state in zip(kinds, states, strict=True):
        element = Element(CLASSES[kind], "e")
        if state is not None:
            element.setProperty("skiros:Weight" if isinstance(state, float) else "skiros:State", state)
        wmi.add_element(element)
        elements.append(element)
    for relation, one, other in related:
        if max(one, other) < len(elements) and one != other:
            wmi.set_relation(elements[one].id, RELATIONS[relation], elements[other].id)
    return elements


def make_params(wanted, types):
    ph = ParamHandler()
    for key, kind, ptype in zip(KEYS, wanted, types, strict=False):
        ph.addParam(key, Element(CLASSES[kind]), ptype)
    return ph


def all_solutions(ph, conditions, wmi):
    """Every combination of elements for the unset parameters of which all conditions hold."""
    keys = [key for key, param in ph.items() if not param.is_bound()]
    domains = [sorted(wmi.resolve_elements(ph.getParam(key).default), key=lambda e: id_order(e.id)) for key in keys]
    copy = ParamHandler(ph.getCopy())
    for values in itertools.product(*domains):
        for key, value in zip(keys, values, strict=True):
            copy.specify(key, value)
        if all(c.evaluate(copy, wmi) for c in conditions):
            yield dict(zip(keys, (v.id for v in values), strict=True))


indices = st.integers(0, 4)
keys = st.sampled_from(KEYS)
mostly = st.sampled_from([True, True, False])
conditions = st.one_of(
    st.builds(lambda r, a, b, s: make.getRelationCond("R", r, a, b, s), st.sampled_from(RELATIONS), keys, keys, mostly),
    st.builds(lambda r, a, b, s: make.getRelationCond("R", r, a, b, s), st.sampled_from(RELATIONS), keys, keys, mostly),
    st.builds(lambda a, v, s: make.getPropCond("S", "State", a, "=", v, s), keys, st.sampled_from(STATES[:2]), mostly),
    st.builds(lambda a, s: make.getPropCond("W", "Weight", a, ">", 1.5, s), keys, mostly),
    st.builds(lambda a, s: make.getHasPropCond("H", "State", a, s), keys, mostly),
    st.builds(lambda a, c: make.getOnTypeCond("T", a, c), keys, st.sampled_from(CLASSES)),
    st.builds(lambda a, b: ConditionFunction("F", [a, b], lambda x, y: x.id != y.id), keys, keys),
)


@given(
    kinds=st.lists(st.integers(0, 1), min_size=3, max_size=5),
    related=st.lists(st.tuples(st.integers(0, 1), indices, indices), min_size=4, max_size=16),
    states=st.lists(st.sampled_from([None, *STATES]), min_size=5, max_size=5),
    wanted=st.lists(st.integers(0, 1), min_size=3, max_size=3),
    fixed=st.sets(keys, max_size=1),
    some=st.lists(conditions, min_size=1, max_size=4),
)
@settings(max_examples=examples(400), suppress_health_check=[HealthCheck.too_slow])
def test_inference_equals_an_exhaustive_search(wmi, kinds, related, states, wanted, fixed, some):
    for element in [e for etype in CLASSES for e in wmi.resolve_elements(Element(etype))]:
        if wmi.is_scene_element(element.id):
            wmi.remove_element(element)
    elements = make_scene(wmi, kinds, related, states[: len(kinds)])
    ph = make_params(wanted, [ParamTypes.Required] * 3)
    for key in fixed:
        fitting = [e for e in elements if e.type == ph.getParam(key).default.type]
        if fitting:
            ph.specify(key, fitting[0])
    solutions = list(all_solutions(ph, some, wmi))
    unset = [key for key, param in ph.items() if not param.is_bound()]
    failed = infer(ph, [c.copy() for c in some], wmi)
    # Conditions on given values alone are not the search's.
    spoken = [c for c in some if not set(unset).isdisjoint(c.getKeys())]
    if failed is None:
        found = {key: ph.getParamValue(key).id for key in unset}
        assert all(c.evaluate(ph, wmi) for c in spoken)
        assert not solutions or found in solutions
        again = make_params(wanted, [ParamTypes.Required] * 3)
        for key in set(KEYS) - set(unset):
            again.specify(key, ph.getParamValue(key))
        assert infer(again, some, wmi) is None
        assert {key: again.getParamValue(key).id for key in unset} == found
    else:
        assert not solutions
        assert not any(ph.is_bound(key) for key in unset)
        steps_of = filter_candidates(failed)
        assert [c.key for c in steps_of] == failed.failed
        assert failure_text(failed, steps_of)
        for candidates in steps_of:
            assert candidates.total == len(wmi.resolve_elements(ph.getParam(candidates.key).default))
            counts = [candidates.total, *(left.count for left in candidates.left)]
            assert counts == sorted(counts, reverse=True)
            assert len(candidates.nearest) <= 3


@pytest.fixture(scope="module")
def wmi():
    return LocalWorldModel("test")


# -- what it says ------------------------------------------------------------------------------------------------------


def search(bench, declared, conditions, **given):
    """The failed search, and what it says."""
    ph = ParamHandler()
    for key, etype in declared.items():
        ph.addParam(key, Element(etype), ParamTypes.Required)
        if key in given:
            ph.specify(key, given[key])
    failed = infer(ph, conditions, bench.wmi)
    assert failed is not None
    candidates = filter_candidates(failed)
    return candidates, failure_text(failed, candidates)


AT_TRAY = make.getRelationCond("In", "skiros:contain", "Tray", "Part", True)
IDLE = make.getPropCond("Idle", "skiros:State", "Part", "=", "Idle", True)
HEAVY = make.getPropCond("Heavy", "skiros:Weight", "Part", ">", 5.0, True)


def test_inference_failure_counts_candidates_after_each_condition(bench):
    parts = [bench.add("skiros:Starter", "p", bench.tray, State="Busy", Weight=9.0) for _ in range(3)]
    for _ in range(9):
        bench.add("skiros:Starter", "p", bench.other_tray, State="Idle")
    (part,), text = search(
        bench, {"Part": "skiros:Starter", "Tray": "skiros:LargeBox"}, [HEAVY, IDLE, AT_TRAY], Tray=bench.tray
    )
    assert (part.key, part.wanted, part.total) == ("Part", "skiros:Starter", 12)
    assert part.left == [
        FilterStep(f"with {bench.tray!r} skiros:contain it", 3, "In"),
        FilterStep("with skiros:Weight > 5.0", 3, "Heavy"),
        FilterStep("with skiros:State = 'Idle'", 0, "Idle"),
    ]
    assert [near.element for near in part.nearest] == [repr(e) for e in parts]
    assert {near.why for near in part.nearest} == {"skiros:State is 'Busy'"}
    assert text == str(part)


def test_near_matches_satisfy_the_most_conditions(bench):
    bench.add("skiros:Starter", "light", bench.tray, State="Busy", Weight=1.0)
    heavy = bench.add("skiros:Starter", "heavy", bench.tray, State="Busy", Weight=9.0)
    (part,), _ = search(bench, {"Part": "skiros:Starter"}, [IDLE, HEAVY])
    assert part.nearest[0].element == repr(heavy)


def test_missing_class_is_reported_with_the_requested_label(bench):
    for etype, kind in (("skiros:Starter", "skiros:Starter"), ("Unknown", "element")):
        ph = ParamHandler()
        ph.addParam("Part", Element(etype, "blue"), ParamTypes.Required)
        failed = infer(ph, [], bench.wmi)
        assert failure_text(failed, filter_candidates(failed)) == f"no {kind} 'blue' in the scene for parameter 'Part'"


def test_conditions_on_two_parameters_are_counted(bench):
    bench.add("skiros:LargeBox", "empty", State="Open")
    open_tray = make.getPropCond("Open", "skiros:State", "Tray", "=", "Open", True)
    candidates, text = search(
        bench, {"Tray": "skiros:LargeBox", "Part": "skiros:Product"}, [open_tray, AT_TRAY]
    )  # fmt: skip
    tray = candidates[0]
    assert tray.left == [
        FilterStep("with skiros:State = 'Open'", 1, "Open"),
        FilterStep("skiros:contain any skiros:Product", 0, "In"),
    ]
    assert "none of the remaining 1 skiros:contain any skiros:Product" in text


def test_jointly_unsatisfied_conditions_are_named(bench):
    """A cycle: each of the conditions has pairs, but none go together."""
    one, two = bench.tray.id, bench.product.id
    other = bench.other_product.id
    bench.wmi.set_relation(one, "skiros:partReference", other)
    bench.wmi.set_relation(bench.other_tray.id, "skiros:partReference", two)
    refers = make.getRelationCond("Refers", "skiros:partReference", "Tray", "Part", True)
    candidates, text = search(bench, {"Tray": "skiros:LargeBox", "Part": "skiros:Product"}, [AT_TRAY, refers])
    assert not any(c.emptied for c in candidates)
    assert text == (
        "no combination of 2 skiros:LargeBox for 'Tray', 2 skiros:Product for 'Part' fits [In], [Refers]"
    )  # fmt: skip


def test_unlinked_parameters_are_reported_separately(bench):
    declared = {"Tray": "skiros:LargeBox", "Part": "skiros:Product"}
    candidates, _ = search(bench, declared, [IDLE])
    assert [c.key for c in candidates] == ["Part"]


# -- order and effort --------------------------------------------------------------------------------------------------


def count_calls(monkeypatch, wmi, name):
    calls = []
    original = getattr(wmi, name)

    def counted(*args, **kwargs):
        calls.append(args)
        return original(*args, **kwargs)

    monkeypatch.setattr(wmi, name, counted)
    return calls


def test_relation_to_a_given_element_is_looked_up(bench, monkeypatch):
    for _ in range(50):
        bench.add("skiros:Product", "p", bench.other_tray)
    ph = ParamHandler()
    ph.addParam("Tray", bench.tray, ParamTypes.Required)
    ph.addParam("Part", Element("skiros:Product"), ParamTypes.Required)
    resolved = count_calls(monkeypatch, bench.wmi, "resolve_elements")
    found = count_calls(monkeypatch, bench.wmi, "find_element")
    assert infer(ph, [AT_TRAY], bench.wmi) is None
    assert ph.getParamValue("Part").id == bench.product.id
    assert not resolved
    assert len(found) < 10


@pytest.mark.parametrize("etype", ["", "Unknown", "skiros:Product"])
@pytest.mark.parametrize("label", ["", "product", "other product"])
def test_label_filters_candidates_of_a_relation(bench, etype, label):
    ph = ParamHandler()
    ph.addParam("Tray", bench.tray, ParamTypes.Required)
    ph.addParam("Part", Element(etype, label), ParamTypes.Required)
    failed = infer(ph, [AT_TRAY], bench.wmi)
    if label == "other product":
        assert failed is not None
        assert not ph.is_bound("Part")
    else:
        assert failed is None
        assert ph.getParamValue("Part").id == bench.product.id


def test_unlinked_parameters_are_searched_separately(bench):
    """If searched together, each candidate of one would be combined with each of the others."""
    for _ in range(100):
        bench.add("skiros:Starter", "p", bench.tray)
    calls = []

    def never(part):
        calls.append(part.id)
        return False

    ph = ParamHandler()
    for key in ("A", "B", "C"):
        ph.addParam(key, Element("skiros:Starter"), ParamTypes.Required)
    assert infer(ph, [ConditionFunction("Never", ["B"], never)], bench.wmi).failed == ["B"]
    assert len(calls) == 100


def test_condition_on_one_parameter_is_evaluated_once_per_element(bench):
    calls = []

    def odd(part):
        calls.append(part.id)
        return False

    for _ in range(10):
        bench.add("skiros:Starter", "p", bench.tray, State="Idle")
    differ = ConditionFunction("Differ", ["A", "B"], lambda a, b: a.id != b.id)
    ph = ParamHandler()
    ph.addParam("A", Element("skiros:Starter"), ParamTypes.Required)
    ph.addParam("B", Element("skiros:Starter"), ParamTypes.Required)
    assert infer(ph, [differ, ConditionFunction("Odd", ["B"], odd)], bench.wmi) is not None
    assert len(calls) == len(set(calls)) == 10


def test_reasoner_relation_is_evaluated_last(bench, monkeypatch):
    asked = []

    class Nearness(DiscreteReasoner):
        def getAssociatedRelations(self):
            return ["skiros:near"]

        def computeRelations(self, sub, obj, with_metrics=False):
            asked.append(sub.id)
            return ["skiros:near"]

    monkeypatch.setattr(reasoners, "_by_name", {})
    monkeypatch.setattr(reasoners, "_owners", {})
    reasoners.add(Nearness())
    heavy = bench.add("skiros:Product", "heavy", bench.tray, State="Busy", Weight=9.0)
    near = make.getRelationCond("Near", "skiros:near", "Part", "Tray", True)
    light = ConditionFunction("Heavy", ["Part"], lambda part: part.value_of("skiros:Weight") == 9.0)
    ph = ParamHandler()
    ph.addParam("Tray", bench.tray, ParamTypes.Required)
    ph.addParam("Part", Element("skiros:Product"), ParamTypes.Required)
    assert infer(ph, [near, light], bench.wmi) is None
    assert ph.getParamValue("Part").id == heavy.id
    assert asked == [heavy.id]
