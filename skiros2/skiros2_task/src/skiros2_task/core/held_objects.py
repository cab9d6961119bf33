"""Which robots hold something."""

from __future__ import annotations

from collections.abc import Collection

from skiros2_common.core.manager_names import manager_of, same_node
from skiros2_common.core.world_element import Element
from skiros2_common.core.world_model_port import WorldModelPort

_HAS, _CONTAINS = "skiros:hasA", "skiros:contain"


def held_objects(wm: WorldModelPort, managers: Collection[str]) -> str:
    """Returns which robots hold something, as text; "" if none does.

    A robot holds what its parts (`skiros:hasA`) contain.

    :param managers: of the robots.
    """
    texts = []
    robots = wm.resolve_elements(Element("sumo:Agent")) if managers else []
    for robot in robots:
        name = manager_of(robot)
        if not any(same_node(name, manager) for manager in managers):
            continue
        held = []
        for part in wm.get_branch(robot.id, _HAS):
            if part.id != robot.id:
                held += [str(relation["dst"]) for relation in part.getRelations("-1", _CONTAINS)]
        if held:
            texts.append(f"{name} holds {', '.join(sorted(held))}")
    return "; ".join(sorted(texts))
