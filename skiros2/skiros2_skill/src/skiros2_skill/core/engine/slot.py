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
        "provenance", "pushed_by", "shared", "start_values", "suggested",
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
        self.ids: tuple[Any, ...] = ()
        #: The elements that a plan suggests for this start, which inference tries first.
        self.suggested: Sequence[Element] = ()
        #: The ids of a default that is kept unless the blackboard has elements with the same ids; () for a default
        #: that is always kept; None when there is none to keep.
        self.default_ids: tuple[Any, ...] | None = None
        #: The list with an abstract element as the default, which is not pushed.
        self.placeholder: list[Any] | None = None
        default = param.defaults
        if self.is_element:
            self.ids = ids_of(param.current)
            default_ids = self.ids if default == param.current else ids_of(default)
            if default_ids and default_ids[0]:
                self.default_ids = default_ids
            elif default:
                self.placeholder = param.current
        elif default:
            self.default_ids = ()
        #: The list that was last pulled or pushed.
        self.shared: list[Any] | None = None
        #: A list that is not pulled, because elements in it are gone.
        self.ignored: list[Any] | None = None
        #: An element on the blackboard that was not given, which inference tries first.
        self.candidate: list[Any] | None = None
        #: The values at the start; None: the skill has declared the parameter in its `onStart`.
        self.start_values: tuple[Any, ...] | None = None

    def bind(self, origin: Origin) -> None:
        """Notes the origin of the present values, and their ids."""
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

    def copy_default(self) -> None:
        """Copies the default, which the parameter shares with the declared one until then."""
        self.param.current = self.param.new_default()
        if self.placeholder is not None:
            self.placeholder = self.param.current

    @property
    def is_at_placeholder(self) -> bool:
        return self.param.current is self.placeholder and not any(e.id or e.may_be_changed for e in self.param.current)


def is_same(values: list[Any], other: list[Any] | None) -> bool:
    """Whether two lists are equal; values that cannot be compared are not."""
    try:
        return values == other
    except FOREIGN_ERRORS:
        return False


def ids_of(elements: list[Any]) -> tuple[Any, ...]:
    if len(elements) == 1:  # nearly always
        return (getattr(elements[0], "id", None),)
    return tuple([getattr(element, "id", None) for element in elements])


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
