"""Names in goals and in parameters of work masters are checked against the scene."""

from __future__ import annotations

from skiros2_gateway.core.goal_check import goal_problems
from support.planning_world import PlanningWorld


def test_each_wrong_element_is_named_with_the_nearest_ones() -> None:
    world = PlanningWorld()
    place = world.thing("skiros:Location")
    product = world.thing("skiros:Product", inside=place)
    goal = f'(skiros:contain "{place}" "{product}")'
    fields = {"parameters.Product": (product, "skiros:Product"), "parameters.Place": (place, "skiros:Location")}
    assert goal_problems(world.wm, [], goal, fields) == []
    fields = {"parameters.Product": (place, "skiros:Product"), "parameters.Place": (f"{place}9", "skiros:Location")}
    problems = {problem.where: problem for problem in goal_problems(world.wm, [], goal, fields)}
    assert {where: problem.code for where, problem in problems.items()} == {
        "parameters.Product": "wrong_type", "parameters.Place": "unknown_name",
    }  # fmt: skip
    assert problems["parameters.Place"].nearest[0] == place


def test_goal_with_an_unknown_element_is_a_problem_of_the_goal() -> None:
    world = PlanningWorld()
    place = world.thing("skiros:Location")
    (problem,) = goal_problems(world.wm, [], f'(skiros:contain "{place}" "skiros:Product-999")', {})
    assert (problem.code, problem.where) == ("goal", "goal") and "skiros:Product-999" in problem.message
