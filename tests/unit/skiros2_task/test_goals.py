"""Goals built in Python, and the round trip of formulas through their text."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from skiros2_common.core.errors import WrongType, WrongValue
from skiros2_common.core.world_element import Element
from skiros2_task.core.actions import condition_predicates
from skiros2_task.core.formula import Formula
from skiros2_task.core.goal_reader import GoalReader
from skiros2_task.core.goals import all_of, any_of, compares, equals, exists, for_all, has, is_same, negated, related
from skiros2_task.core.world import WorldView
from support.planning_world import PlanningWorld, transport_world

SOME_TEXTS = ("Empty", "Full", "Half full (nearly)", "a, b; c", "not", "Größe", "2 x 4")


@pytest.fixture(scope="module")
def world() -> PlanningWorld:
    world = transport_world(places=2, products=2)
    for text in SOME_TEXTS:
        world.thing("skiros:Product", f"label of {text}", Surface=text, Open=True, Weight=2.5)
    return world


def read(world: PlanningWorld, text: str) -> Formula:
    view = WorldView(world.wm)
    return GoalReader(view, condition_predicates(view.robots)).read(text)


def test_goal_has_expected_text() -> None:
    tray = Element("skiros:LargeBox", "tray", "skiros:LargeBox-3")
    part = "skiros:Product-4"
    assert related(tray, "contain", part) == "(skiros:contain skiros:LargeBox-3 skiros:Product-4)"
    assert equals(part, "Surface", "Sky Blue") == '("skiros:Surface_Sky Blue" skiros:Product-4)'
    assert equals(part, "Open") == "(skiros:Open skiros:Product-4)"
    assert equals(part, "Open", False) == "(skiros:Open_False skiros:Product-4)"
    assert equals(part, "Weight", 2) == "(= (skiros:Weight skiros:Product-4) 2)"
    assert compares(part, "Weight", ">=", 1234567.25) == "(>= (skiros:Weight skiros:Product-4) 1234567.25)"
    assert has(part, "Weight") == "(has_skiros:Weight skiros:Product-4)"
    assert negated(has("?x", "Weight")) == "(not (has_skiros:Weight ?x))"
    assert all_of() == "(and)"
    assert any_of() == "(or)"
    both = for_all("Product", lambda x: exists("Location", lambda y: related(y, "contain", x)))
    expected = "(forall (?x2 - skiros:Product) (exists (?x1 - skiros:Location) (skiros:contain ?x1 ?x2)))"
    assert both == expected


def test_equality_of_elements_may_stand_in_a_quantifier() -> None:
    goal = exists("Product", lambda x: negated(is_same(x, "a")))
    assert goal == "(exists (?x1 - skiros:Product) (not (= ?x1 a)))"


def test_element_without_id_is_named_by_label() -> None:
    assert related("a", "contain", Element("skiros:Starter", "skiros:starter")) == "(skiros:contain a skiros:starter)"


def test_invalid_goal_raises() -> None:
    with pytest.raises(WrongValue, match="neither id nor label"):
        related("a", "contain", Element("skiros:Product"))
    with pytest.raises(WrongType, match="expected an element or its id, found int"):
        related("a", "contain", 3)  # type: ignore[arg-type]
    with pytest.raises(WrongValue, match="operator '<>', expected one of = > < >= <="):
        compares("a", "Weight", "<>", 3.0)


def test_text_of_a_formula_is_read_as_the_formula(world: PlanningWorld) -> None:
    things = st.sampled_from([*world.places, *world.products, *world.robots])
    atoms = st.one_of(
        st.builds(related, things, st.sampled_from(["skiros:contain", "skiros:at"]), things),
        st.builds(equals, things, st.just("skiros:Surface"), st.sampled_from(SOME_TEXTS)),
        st.builds(equals, things, st.just("skiros:Open"), st.booleans()),
        st.builds(has, things, st.just("skiros:Weight")),
        st.builds(
            compares,
            things,
            st.just("skiros:Weight"),
            st.sampled_from(["=", ">", "<", ">=", "<="]),
            st.floats(allow_nan=False, allow_infinity=False),
        ),
    )

    def larger(smaller: st.SearchStrategy[str]) -> st.SearchStrategy[str]:
        parts = st.lists(smaller, max_size=3)
        return st.one_of(
            st.builds(negated, smaller),
            parts.map(lambda some: all_of(*some)),
            parts.map(lambda some: any_of(*some)),
            smaller.map(lambda body: for_all("skiros:Product", lambda x: all_of(body, has(x, "skiros:Weight")))),
            smaller.map(
                lambda body: exists("skiros:Location", lambda x: any_of(body, negated(is_same(x, world.places[0]))))
            ),
        )

    view = WorldView(world.wm)
    reader = GoalReader(view, condition_predicates(view.robots))

    @given(st.recursive(atoms, larger, max_leaves=8))
    def check(goal: str) -> None:
        formula = reader.read(goal)
        assert reader.read(str(formula)) == formula

    check()
