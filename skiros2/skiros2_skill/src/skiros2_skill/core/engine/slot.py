"""The connection of a node's parameter to its key on the blackboard."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from skiros2_common.core.condition import ConditionBase
from skiros2_common.core.errors import FOREIGN_ERRORS
from skiros2_common.core.explanation import CHANGED, INFERRED, MAX_EXAMPLES, PULLED, UNSET, Provenance
from skiros2_common.core.params import Origin, Param
from skiros2_common.core.property import format_value
from skiros2_common.core.world_element import Element


class Slot:
    """The connection of a node's parameter to its key on the blackboard.

    :param provenance: see `Provenance`.
    """

    __slots__ = (
        "candidate", "default_ids", "ids", "ignored", "is_element", "key", "origin", "param", "placeholder",
        "provenance", "pushed_by", "shared", "suggested",
    )  # fmt: skip

    def __init__(self, param: Param, key: str, provenance: str) -> None:
        self.param = param
        self.key = key
        self.is_element = param.is_element
        self.provenance = provenance
        #: The label of the node that has pushed the values.
        self.pushed_by = ""
        self.origin = Origin.GIVEN
        #: Of the elements when they were bound: an assignment of the same ones keeps the origin.
        self.ids: list[Any] = []
        #: The elements that a plan suggests for this start, which inference tries first.
        self.suggested: list[Element] = []
        default = param.defaults
        #: The ids of a default that is kept unless the blackboard has elements with the same ids; () for a default
        #: that is always kept; None when there is none to keep.
        self.default_ids: list[str] | tuple[()] | None = None
        #: The list with an abstract element as the default, which is not pushed.
        self.placeholder = None
        if default and not self.is_element:
            self.default_ids = ()
        elif default and default[0].id:
            self.default_ids = [e.id for e in default]
        elif default:
            self.placeholder = param.current
        #: The list that was last pulled or pushed.
        self.shared: list[Any] | None = None
        #: A list that is not pulled, because elements in it are gone.
        self.ignored: list[Any] | None = None
        #: An element on the blackboard that was not given, which inference tries first.
        self.candidate: list[Any] | None = None

    def bind(self, origin: Origin) -> None:
        """Notes the origin of the present values."""
        self.origin = origin
        if self.is_element:
            self.ids = ids_of(self.param.current)

    def note_change(self) -> None:
        """Notes that the skill's code has changed the values: other elements are `ASSIGNED`."""
        if self.is_element and self.ids != ids_of(self.param.current):
            self.bind(Origin.ASSIGNED)

    def is_given_again(self, entry: Param) -> bool:
        """Whether the blackboard has the given elements of this slot as the outcome of a skill."""
        return self.origin is Origin.GIVEN is not entry.origin and self.ids == ids_of(entry.current)

    def drop(self, gone: list[Any]) -> None:
        """Removes elements that are gone. The list that has them is not pulled again."""
        self.ignored, self.shared = self.param.current, None
        self.param.current = [v for v in self.param.current if v not in gone]

    @property
    def is_at_placeholder(self) -> bool:
        return self.param.current is self.placeholder and not any(e.id or e.may_be_changed for e in self.param.current)


def is_same(values: list[Any], other: list[Any] | None) -> bool:
    """Whether two lists are equal; values that cannot be compared are not."""
    try:
        return values == other
    except FOREIGN_ERRORS:
        return False


def ids_of(elements: list[Any]) -> list[Any]:
    return [getattr(element, "id", None) for element in elements]


def provenance_of(slots: Iterable[Slot], conditions: Sequence[ConditionBase]) -> list[Provenance]:
    """The provenance of the parameters of a node.

    :param conditions: the pre-conditions, which are named for inferred parameters.
    """
    return [_provenance(slot, conditions) for slot in slots]


def _provenance(slot: Slot, conditions: Sequence[ConditionBase]) -> Provenance:
    key, values = slot.param.key, slot.param.current
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
