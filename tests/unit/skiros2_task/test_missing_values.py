"""Goals whose plans lack values of parameters: not planned with, but named."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from skiros2_common.core.world_element import Element
from skiros2_task.core.planning import TaskPlanner, Verdict
from support.planning_world import REQUIRED, PlanningWorld, related, skill
from support.skilled_scene import planner_of

PUSH = skill(
    "Push",
    [
        ("Object", "skiros:Product", REQUIRED),
        ("Goal", "skiros:Location", REQUIRED),
        ("Force", float, REQUIRED),
        ("Pattern", str, REQUIRED),
    ],
    pre=[related("Goal", "skiros:at", "Object", False)],
    post=[related("Object", "skiros:at", "Goal")],
)


class World:
    """A robot with Push, a product and a place."""

    def __init__(self) -> None:
        self.world = PlanningWorld()
        self.world.robot("alpha", PUSH)
        self.product, self.place = self.world.thing("skiros:Product"), self.world.thing("skiros:Location")
        self.goal = f"(skiros:at {self.product} {self.place})"

    def add_set(self, *keys: str) -> None:
        """Adds a parameter set for Push."""
        each = Element("skiros:ParameterSet", "learned")
        each.setProperty("skiros:SkillType", "skiros:Push")
        each.addRelation("skiros:Scene-0", "skiros:contain", "-1")
        self.world.wm.add_element(each)
        for key in keys:
            part = Element("skiros:Parameter", key)
            part.setProperty("skiros:Value", 1.0)
            part.addRelation(each.id, "skiros:hasParam", "-1")
            self.world.wm.add_element(part)


@pytest.fixture
def world() -> World:
    return World()


@pytest.fixture
def planner(world: World) -> Iterator[TaskPlanner]:
    with planner_of(world.world.wm) as planner:
        yield planner


def test_missing_values_are_named_and_the_command_that_learns_them_is_offered(
    world: World, planner: TaskPlanner
) -> None:
    result = planner.plan(world.goal)
    assert (result.verdict, result.plan) == (Verdict.IMPOSSIBLE, None)
    assert result.missing == ("Push.Force", "Push.Pattern")
    first = result.message.splitlines()[0]
    assert first.startswith("a plan needs values for: Push.Force, Push.Pattern; they can be learned: rosrun skiros2_")
    assert f"--goal '{world.goal}'" in first


def test_a_goal_that_values_do_not_help_names_none(world: World, planner: TaskPlanner) -> None:
    result = planner.plan(f"(skiros:contain {world.place} {world.product})")
    assert (result.verdict, result.missing) == (Verdict.IMPOSSIBLE, ())


def test_learned_values_are_not_missing(world: World, planner: TaskPlanner) -> None:
    world.add_set("Force")
    assert planner.plan(world.goal).missing == ("Push.Pattern",)
    world.add_set("Pattern")
    result = planner.plan(world.goal)
    assert [call.label for call in result.calls] == ["push"]
    assert result.missing == ()


def test_with_assumed_values_the_plan_states_them(world: World, planner: TaskPlanner) -> None:
    result = planner.plan(world.goal, assume=True)
    assert result.verdict is Verdict.PLANNED
    assert result.plan is not None
    assert result.plan.missing == ("Push.Force", "Push.Pattern")
