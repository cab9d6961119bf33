"""Checks a goal and the elements of a work master's parameters against the world model."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from skiros2_common.core.names import nearest
from skiros2_gateway.core.problems import Problem
from skiros2_task.core.actions import condition_predicates
from skiros2_task.core.goal_reader import GoalReader
from skiros2_task.core.goal_text import GoalError
from skiros2_task.core.world import WorldView
from skiros2_world_model.core.world_model_client import WorldModelClient


def goal_problems(
    wm: WorldModelClient, robots: Sequence[str], goal: str, elements: Mapping[str, tuple[str, str]]
) -> list[Problem]:
    """Returns what is wrong with the names in a goal. Blocks.

    :param robots: the node names of the connected robots.
    :param elements: (element, class) by the field that names the element; class "": any.
    """
    world, problems = WorldView(wm, lambda _: dict.fromkeys(robots, "")), []
    for field, (name, cls) in elements.items():
        element, expected = world.objects.get(name), f"the id of an element of class {cls}"
        if element is None:
            candidates = [e.id for e in world.objects.values() if not cls or world.is_subclass(e.type, cls)]
            near = tuple(nearest(name, candidates) or candidates[:12])
            problems.append(Problem("unknown_name", field, f"there is no element {name!r}", expected, near))
        elif cls and not world.is_subclass(element.type, cls):
            problems.append(Problem("wrong_type", field, f"{name} is of class {element.type}", expected))
    if not problems:
        try:
            GoalReader(world, condition_predicates(world.robots)).read(goal)
        except GoalError as error:
            problems.append(Problem("goal", "goal", str(error), "a goal text, see docs/planning.md"))
    return problems
