"""Detection of required concurrency."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from skiros2_common.core.skill_description import ParamOptions
from skiros2_common.core.world_element import Element
from skiros2_task.core.actions import condition_predicates
from skiros2_task.core.compiler import make_task
from skiros2_task.core.goal_reader import GoalReader
from skiros2_task.core.planning import PlanningResult, Verdict
from skiros2_task.core.task import PlanningTask
from skiros2_task.core.world import WorldView
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


def task_of(world: PlanningWorld, goal: str) -> PlanningTask:
    view = WorldView(world.wm)
    return make_task(view, GoalReader(view, condition_predicates(view.robots)).read(goal))


NEEDED = ("skill skiros:Photo (photo) needs a fact that holds only while skill skiros:Flash (flash) runs: skiros:Lit",)


def test_need_of_temporary_fact_requires_concurrency() -> None:
    assert task_of(*lamp_world(FLASH, PHOTO)).concurrent == NEEDED


@pytest.mark.parametrize(
    ("skills", "lit"),
    [((FLASH, PHOTO, SWITCH), False), ((FLASH, PHOTO), True), ((PHOTO,), False)],
    ids=["another skill makes it for good", "it holds at the start", "nothing makes it"],
)
def test_permanent_fact_requires_no_concurrency(skills: tuple[Any, ...], lit: bool) -> None:
    assert task_of(*lamp_world(*skills, lit=lit)).concurrent == ()


def test_temporary_goal_fact_is_reported() -> None:
    world, _ = lamp_world(FLASH, PHOTO)
    (lamp,) = [e.id for e in world.wm.resolve_elements(Element("sumo:Device")) if e.label == "lamp"]
    goal = f"(Lit {lamp})"
    assert task_of(world, goal).concurrent == (
        "the goal needs a fact that holds only while skill skiros:Flash (flash) runs: skiros:Lit",
    )


def test_lock_requires_no_concurrency() -> None:
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
    assert task_of(world, f"(Seen {product})").concurrent == ()


def test_no_plan_names_required_concurrency(plan: Plan) -> None:
    result = plan(*lamp_world(FLASH, PHOTO))
    assert result.verdict is Verdict.IMPOSSIBLE
    assert NEEDED[0] in result.message
    assert "plans start no step during another one" in result.message
    assert result.why is not None and NEEDED[0] in result.why.reason


def test_plan_has_no_concurrency_message(plan: Plan) -> None:
    result = plan(*lamp_world(FLASH, PHOTO, SWITCH))
    assert [call.label for call in result.calls] == ["switch", "photo"]
