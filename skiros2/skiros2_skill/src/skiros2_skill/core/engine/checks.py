"""Whether a change of the world model concerns a task: whether its running skills have to be looked at anew."""

from __future__ import annotations

from typing import Any

from skiros2_common.core.abstract_skill import State
from skiros2_common.core.world_element import Element


def concerns(root: Any, change: Any) -> bool:
    """Whether a hold-condition of a running node speaks of something that a change has touched.

    Called by the thread that brings the change, while another may tick the tree: an answer that is too old costs a tick
    too many, or one that comes with the next slot of the grid.
    """
    changed = {element.id for element in change.elements}
    for relation in change.relations:
        changed.update((relation["src"], relation["dst"]))
    waiting = [root]
    while waiting:
        node = waiting.pop()
        if node._state is not State.Running:
            continue
        waiting += node._children
        for condition in node._hold_conditions:
            if not changed or any(_names(node, key, changed) for key in condition.getKeys()):
                return True
    return False


def _names(node: Any, key: str, changed: set[str]) -> bool:
    """Whether a parameter is one of these elements, or stands for any of its class."""
    param = node._params._params.get(key)
    if param is None or not param.is_element:
        return False
    values = param._values
    return not values or any(isinstance(v, Element) and (v.id in changed or v.isAbstract()) for v in values)
