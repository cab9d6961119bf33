"""Detection of required concurrency."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from skiros2_common.core.skill_description import ParamOptions
from skiros2_common.core.world_element import Element
from skiros2_task.core.planning import PlanningResult, Verdict
from support.planning_world import INFERRED, REQUIRED, PlanningWorld, prop, skill
from support.planning_world import given as specified

Plan = Callable[[PlanningWorld, str], PlanningResult]

LAMP: list[tuple[Any, ...]] = [("Lamp", "sumo:Device", REQUIRED)]
DARK, LIT = prop("Lamp", "skiros:Lit", "=", False), prop("Lamp", "skiros:Lit", "=", True)
#: Its light is on while it runs, and only then.
FLASH = skill("Flash", LAMP, pre=[DARK], hold=[LIT], post=[prop("Lamp", "skiros:Warm", "=", True), DARK])
PHOTO = skill(
    "Photo",
    [("Object", "skiros:Product", REQUIRED), ("Lamp", "sumo:Device", INFERRED)],
    pre=[LIT],
    post=[prop("Object", "skiros:Seen", "=", True)],
)
SWITCH = skill("Switch", LAMP, pre=[DARK], post=[LIT])


def lamp_world(*skills: Any, lit: bool = False) -> tuple[PlanningWorld, str]:
    """A world with a lamp, the skills, and the goal that a product is seen."""
    world = PlanningWorld()
    world.thing("sumo:Device", "lamp", Lit=lit)
    product = world.thing("skiros:Product")
    world.robot("alpha", *skills)
    return world, f"(Seen {product})"


TEMPORARY = "flash cannot be planned with: this lasts only while it runs, and plans start no step during another one"


def test_temporary_fact_of_a_condition_is_explained(plan: Plan) -> None:
    result = plan(*lamp_world(FLASH, PHOTO))
    assert result.verdict is Verdict.IMPOSSIBLE
    assert TEMPORARY in result.message


def test_temporary_fact_of_the_goal_is_explained(plan: Plan) -> None:
    world, _ = lamp_world(FLASH, PHOTO)
    (lamp,) = [e.id for e in world.wm.resolve_elements(Element("sumo:Device")) if e.label == "lamp"]
    assert TEMPORARY in plan(world, f"(Lit {lamp})").message


def test_fact_that_nothing_makes_has_no_such_explanation(plan: Plan) -> None:
    assert "lasts only while" not in plan(*lamp_world(PHOTO)).message


def test_fact_that_holds_at_the_start_needs_no_concurrency(plan: Plan) -> None:
    assert plan(*lamp_world(FLASH, PHOTO, lit=True)).verdict is Verdict.PLANNED


def test_lock_needs_no_concurrency(plan: Plan) -> None:
    world = PlanningWorld()
    world.thing("skiros:DepthCamera", StateProperty="Idle")
    product = world.thing("skiros:Product")
    look = skill(
        "Look",
        [("Object", "skiros:Product", REQUIRED), ("Camera", "skiros:DepthCamera", INFERRED, [ParamOptions.Lock])],
        [specified("Object")],
        [prop("Object", "skiros:Seen", "=", True)],
    )
    world.robot("alpha", look)
    world.robot("beta", look)
    assert plan(world, f"(Seen {product})").verdict is Verdict.PLANNED


def test_permanent_effect_is_used_instead(plan: Plan) -> None:
    result = plan(*lamp_world(FLASH, PHOTO, SWITCH))
    assert [call.label for call in result.calls] == ["switch", "photo"]
