"""Where the values of a node's parameters came from, in words. Asked on failure only."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from skiros2_common.core.explanation import (
    ABOVE,
    CHANGED,
    DEFAULT,
    FIXED,
    GIVEN,
    INFERRED,
    MOST_NAMED,
    UNSET,
    Origin,
)
from skiros2_common.core.property import shown
from skiros2_common.core.world_element import Element
from skiros2_skill.core.blackboard import Slot, Source, declared_above, giver_of
from skiros2_skill.core.node import SkillInterface


def origins(node: SkillInterface, slots: Iterable[Slot], conditions: Sequence[Any]) -> list[Origin]:
    """Where the values of the parameters in some slots of a node came from.

    :param conditions: the pre-conditions, for the inferred ones.
    """
    return [_origin(node, slot, conditions) for slot in slots]


def _origin(node: SkillInterface, slot: Slot, conditions: Sequence[Any]) -> Origin:
    key, values = slot.param.key, slot.param._values
    if not slot.param.isSpecified():
        return Origin(key, "", UNSET)
    text = told_values(values)
    if slot.source is Source.Changed or values is not slot.known:
        giver = giver_of(slot.param)
        return Origin(key, text, CHANGED, [giver] if giver else [])
    if slot.source is Source.Inferred:
        return Origin(key, text, INFERRED, [c.label for c in conditions if key in c.getKeys()])
    if slot.source is Source.Taken:
        return _taken(node, key, text)
    if node.name_above(key) not in node._specified:
        return Origin(key, text, DEFAULT)
    is_asked_for = node._parent is not None and node._parent._parent is None
    return Origin(key, text, GIVEN if is_asked_for else FIXED)


def _taken(node: SkillInterface, key: str, text: str) -> Origin:
    """From the sibling that put it above, else from the node above that has it; what the root has was given."""
    above, holder, _ = declared_above(node, key)
    giver = giver_of(above) if above is not None else ""
    parent = node._parent
    while parent is not None and parent._params is not holder:
        parent = parent._parent
    if not giver and parent is not None and parent._parent is not None:
        giver = parent._label
    return Origin(key, text, ABOVE, [giver]) if giver else Origin(key, text, GIVEN)


def told_values(values: Sequence[Any]) -> str:
    """The values of a parameter as a text: of many the first."""
    named = [repr(v) if isinstance(v, Element) else shown(v) for v in values[:MOST_NAMED]]
    more = f" and {len(values) - MOST_NAMED} more" if len(values) > MOST_NAMED else ""
    return ", ".join(named) + more
