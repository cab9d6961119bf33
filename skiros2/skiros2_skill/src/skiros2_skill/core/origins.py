"""Where the values of a node's parameters came from, in words. Asked on failure only."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from skiros2_common.core.explanation import CHANGED, INFERRED, MAX_EXAMPLES, PULLED, UNSET, Provenance
from skiros2_common.core.property import format_value
from skiros2_common.core.world_element import Element
from skiros2_skill.core.blackboard import Slot


def origins(slots: Iterable[Slot], conditions: Sequence[Any]) -> list[Provenance]:
    """Where the values of the parameters in some slots of a node came from.

    :param conditions: the pre-conditions, for the inferred ones.
    """
    return [_origin(slot, conditions) for slot in slots]


def _origin(slot: Slot, conditions: Sequence[Any]) -> Provenance:
    key, values = slot.param.key, slot.param._values
    if not slot.param.is_bound():
        return Provenance(key, "", UNSET)
    origin = CHANGED if slot.param.assigned else slot.origin
    if origin == INFERRED:
        names = [c.label for c in conditions if key in c.getKeys()]
    else:
        names = [slot.giver] if origin in (PULLED, CHANGED) and slot.giver else []
    return Provenance(key, told_values(values), origin, names)


def told_values(values: Sequence[Any]) -> str:
    """The values of a parameter as a text: of many the first."""
    named = [repr(v) if isinstance(v, Element) else format_value(v) for v in values[:MAX_EXAMPLES]]
    more = f" and {len(values) - MAX_EXAMPLES} more" if len(values) > MAX_EXAMPLES else ""
    return ", ".join(named) + more
