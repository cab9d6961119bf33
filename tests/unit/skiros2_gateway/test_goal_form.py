"""The form that builds a goal, as the page shows it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
from pydantic import ValidationError

from skiros2_gateway.core.goal_form import GoalEdit, GoalForms
from support.http_gateway import curl, served
from support.planning_world import PlanningWorld
from unit.skiros2_gateway.conftest import TOKENS, Gateway

#: A row that was just added.
EMPTY: dict[str, Any] = {"subject": {}, "predicate": "", "operator": "", "object": {}, "value": "", "negated": False}


@pytest.fixture
def world() -> PlanningWorld:
    world = PlanningWorld()
    world.shelf, world.cup = world.thing("skiros:Location", "shelf"), world.thing("skiros:Product", "cup")
    return world


@pytest.fixture
def forms(world: PlanningWorld) -> GoalForms:
    return GoalForms(lambda: world.wm)


def _edit(forms: GoalForms, **edit: Any) -> dict[str, Any]:
    return forms.form(GoalEdit.model_validate(edit))


def _names(form: dict[str, Any], key: str) -> list[str]:
    return [choice["name"] for choice in form["choices"][form["lines"][0][key]]]


def test_goal_is_built_row_by_row(forms: GoalForms, world: PlanningWorld) -> None:
    form = _edit(forms, lines=[EMPTY])
    assert (form["goal"], form["sentence"], form["problem"]) == ("", "", "")
    assert {world.shelf, world.cup} <= set(_names(form, "subjects")) and "skiros:contain" in _names(form, "predicates")
    row = {**form["lines"][0], "subject": {"name": world.shelf, "quantifier": ""}, "predicate": "skiros:contain"}
    form = _edit(forms, lines=[row], chosen=0)
    assert (form["goal"], form["lines"][0]["operator"]) == ("", "")
    row = {**form["lines"][0], "object": {"name": "skiros:Product", "quantifier": "some"}, "negated": True}
    form = _edit(forms, lines=[row])
    assert form["goal"] == f"(exists (?y - skiros:Product) (not (skiros:contain {world.shelf} ?y)))"
    assert form["sentence"] == "shelf does not contain some product"
    assert _edit(forms, goal=form["goal"])["lines"] == form["lines"]


def test_fields_of_values_follow_the_property(forms: GoalForms, world: PlanningWorld) -> None:
    row = {**EMPTY, "subject": {"name": world.cup, "quantifier": ""}, "predicate": "skiros:Missing"}
    (line,) = _edit(forms, lines=[row], chosen=0)["lines"]
    assert (line["field"]["kind"], line["field"]["options"], line["operators"]) == ("choice", ["true", "false"], ["="])
    (line,) = _edit(forms, lines=[{**line, "value": "false", "predicate": "skiros:Weight"}], chosen=0)["lines"]
    assert (line["value"], line["field"]["kind"], line["field"]["limits"]["unit"]) == ("", "number", "kg")
    assert line["field"]["limits"]["minimum"] == 0.0
    form = _edit(forms, lines=[{**line, "value": -1}])
    assert (form["problem"], form["lines"][0]["value"]) == ("Weight: expected at least 0 kg, got -1", -1.0)
    assert _edit(forms, lines=[{**line, "operator": ">=", "value": 0.5}])["problem"] == ""


def test_relation_offers_elements_in_domain_and_range(forms: GoalForms, world: PlanningWorld) -> None:
    robot = world.robot("alpha")
    row = {**EMPTY, "subject": {"name": world.cup}, "predicate": "cora:robotPart", "object": {"name": world.cup}}
    form = _edit(forms, lines=[row], chosen=0)
    assert {robot} == {name for name in _names(form, "objects") if "-" in name}
    assert not {world.cup, world.shelf} & set(_names(form, "subjects"))
    assert form["lines"][0]["subject"]["name"] == form["lines"][0]["object"]["name"] == ""
    assert "a sumo:Device, which" in _edit(forms, goal="(cora:robotPart cup alpha)")["problem"]


def test_text_without_rows_says_what_is_missing(forms: GoalForms) -> None:
    form = _edit(forms, goal="(skiros:contain shelf")
    assert form["lines"] is None and "expected a name, or )" in form["problem"]
    form = _edit(forms, goal="(or (skiros:contain shelf cup) (Missing cup))")
    assert form["lines"][0]["text"] == "(or (skiros:contain shelf cup) (Missing cup))" and form["problem"] == ""
    assert "did you mean shelf" in _edit(forms, goal="(skiros:contain shlef cup)")["problem"]
    assert _edit(forms, goal=" ")["lines"] == []


def test_new_elements_are_offered(forms: GoalForms, world: PlanningWorld) -> None:
    before = _edit(forms, lines=[EMPTY])
    jug = world.thing("skiros:Product", "jug")
    assert jug not in _names(before, "subjects") and jug in _names(_edit(forms, lines=[EMPTY]), "subjects")


@pytest.mark.parametrize(
    "edit",
    [
        {"lines": [{"operator": "!="}]},
        {"lines": [{"value": float("nan")}]},
        {"lines": [{"subject": {"quantifier": "no"}}]},
        {"lines": [{}] * 101},
        {"goal": "x" * 20_001},
        {"other": 1},
    ],
)
def test_malformed_edits_are_refused(edit: dict[str, Any]) -> None:
    with pytest.raises(ValidationError):
        GoalEdit.model_validate(edit)


def test_form_needs_the_role_operate(in_gateway: Callable[..., None]) -> None:
    async def test(gateway: Gateway) -> None:
        async with served(gateway.service) as address:
            body = {"lines": [EMPTY]}
            assert (await curl(address, "/api/goal/form", token=TOKENS["view"], body=body))[0] == 403
            status, form = await curl(address, "/api/goal/form", token=TOKENS["operate"], body=body)
            assert status == 200 and form["lines"][0]["predicate"] == "" and form["choices"]
            body = {"lines": [{"value": []}]}
            status, answer = await curl(address, "/api/goal/form", token=TOKENS["operate"], body=body)
            assert status == 422 and answer["problems"]

    in_gateway(test)
