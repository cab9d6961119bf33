"""The provenance of parameter values, for explanations."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from skiros2_common.core.explanation import CHANGED, INFERRED, MAX_EXAMPLES, PULLED, UNSET, Provenance
from skiros2_common.core.property import format_value
from skiros2_common.core.world_element import Element
from skiros2_skill.core.engine.blackboard import Slot


def provenance_of(slots: Iterable[Slot], conditions: Sequence[Any]) -> list[Provenance]:
    """The provenance of the parameters of a node.

    :param conditions: the pre-conditions, which are named for inferred parameters.
    """
    return [_provenance(slot, conditions) for slot in slots]


def _provenance(slot: Slot, conditions: Sequence[Any]) -> Provenance:
    key, values = slot.param.key, slot.param._values
    if not slot.param.is_bound():
        return Provenance(key, "", UNSET)
    provenance = CHANGED if slot.param.assigned else slot.provenance
    if provenance == INFERRED:
        names = [c.label for c in conditions if key in c.getKeys()]
    else:
        names = [slot.pushed_by] if provenance in (PULLED, CHANGED) and slot.pushed_by else []
    return Provenance(key, format_values(values), provenance, names)


def format_values(values: Sequence[Any]) -> str:
    """Formats the values of a parameter; only the first of many."""
    named = [repr(v) if isinstance(v, Element) else format_value(v) for v in values[:MAX_EXAMPLES]]
    more = f" and {len(values) - MAX_EXAMPLES} more" if len(values) > MAX_EXAMPLES else ""
    return ", ".join(named) + more
