"""The blackboard of a task: one flat map from keys to parameters, shared by all nodes of the task.

The blackboard key of a node's parameter results from the remaps of the node and its ancestors. At its start, and before
each `execute`, a node *pulls* the values of its keys; afterwards it *pushes* its own. Nodes share the list of values
itself: all of them see changes in place.
"""

from __future__ import annotations

import logging
from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import Any

from skiros2_common.core.condition import ConditionBase
from skiros2_common.core.errors import FOREIGN_ERRORS, UnknownName, WrongType
from skiros2_common.core.explanation import (
    CHANGED,
    DEFAULT,
    GIVEN,
    INFERRED,
    MAX_EXAMPLES,
    PULLED,
    SPECIFIED,
    UNSET,
    Provenance,
)
from skiros2_common.core.names import nearest
from skiros2_common.core.params import Origin, Param, ParamHandler, ParamTypes
from skiros2_common.core.property import format_value
from skiros2_common.core.world_element import Element
from skiros2_skill.core.tree.node import SkillInterface
from skiros2_skill.core.tree.skill_node import SkillWrapper

log = logging.getLogger(__name__)


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
            self.ids = _ids(self.param.current)

    def note_change(self) -> None:
        """Notes that the skill's code has changed the values: other elements are `ASSIGNED`."""
        if self.is_element and self.ids != _ids(self.param.current):
            self.bind(Origin.ASSIGNED)

    def is_given_again(self, entry: Param) -> bool:
        """Whether the blackboard has the given elements of this slot as the outcome of a skill."""
        return self.origin is Origin.GIVEN is not entry.origin and self.ids == _ids(entry.current)

    def drop(self, gone: list[Any]) -> None:
        """Removes elements that are gone. The list that has them is not pulled again."""
        self.ignored, self.shared = self.param.current, None
        self.param.current = [v for v in self.param.current if v not in gone]

    @property
    def is_at_placeholder(self) -> bool:
        return self.param.current is self.placeholder and not any(e.id or e.may_be_changed for e in self.param.current)


class Blackboard:
    """The parameters of a task by key. For the thread that ticks the task.

    :param params: the parameters of the root, which store the blackboard.
    """

    def __init__(self, params: ParamHandler) -> None:
        self._handler = params

    @property
    def _entries(self) -> dict[str, Param]:
        return self._handler._params

    def __contains__(self, key: str) -> bool:
        return key in self._entries

    def origin(self, key: str) -> Origin:
        """The origin of the values of a key."""
        entry = self._entries.get(key)
        return entry.origin if entry is not None else Origin.GIVEN

    def values(self, key: str) -> list[Any]:
        """The values of a key; [] when the blackboard does not have it."""
        entry = self._entries.get(key)
        return entry.current if entry is not None else []

    def ids(self) -> set[str]:
        """The ids of all elements on the blackboard."""
        return {v.id for p in self._entries.values() if p.is_element for v in p.current}

    def pull(self, node: SkillWrapper, slots: list[Slot], is_start: bool = False) -> bool:
        """Copies values from the blackboard to the parameters of a node. Returns whether a parameter has changed.

        A parameter with a default keeps it, unless the default is an abstract element or elements with the same ids. At
        a start, an element that was not given is only a candidate for a parameter that can be inferred, and a key with
        a suggested element is not pulled. While the node runs, an inferred element does not replace another one.
        """
        entries = self._entries
        changed = False
        for slot in slots:
            entry = entries.get(slot.key)
            if entry is None or (is_start and slot.suggested):
                continue
            values, param = entry.current, slot.param
            if values is param.current or values is slot.ignored or values is slot.shared or not values:
                continue
            if slot.default_ids is not None and slot.default_ids != [v.id for v in values if isinstance(v, Element)]:
                continue
            is_open = slot.is_element and slot.default_ids is None and param.paramType is not ParamTypes.Optional
            if is_open and entry.origin is not Origin.GIVEN:
                if not is_start:
                    if entry.origin is Origin.INFERRED and param.is_bound() and _ids(values) != _ids(param.current):
                        continue
                elif len(values) == 1 and _ids(values)[0]:
                    slot.candidate = values
                    continue
            slot.shared = values
            try:
                param.current = param.checked(values)
            except WrongType as error:
                log.error("%s keeps its own value, not the one on the blackboard: %s", node.printState(), error)
                continue
            if param.shared_snapshot is not None:
                param.shared_snapshot = list(param.current)
            slot.bind(entry.origin if slot.default_ids is None else Origin.GIVEN)
            pushed = PULLED if is_start or not node.children else CHANGED
            slot.provenance, slot.pushed_by = pushed if entry.set_by else GIVEN, entry.set_by
            changed = True
        return changed

    def push(self, node: SkillWrapper, slots: list[Slot], everything: bool = False, removes: bool = True) -> list[str]:
        """Copies parameters of a node that were assigned or changed in place to the blackboard; a parameter without a
        value removes its key. Returns the keys that have changed.

        :param everything: also pushes unchanged parameters, except for abstract elements that are defaults.
        :param removes: whether keys are removed.
        """
        entries = self._entries
        params = node._params._params
        if len(params) != len(slots):  # the running skill has declared parameters
            add_slots(node, slots)
        pushed: list[str] = []
        for slot in slots:
            param = slot.param
            values = param.current
            changed = param.assigned
            if changed:
                param.assigned = False
                slot.placeholder = None
                slot.provenance, slot.pushed_by = CHANGED, ""
            if param.shared_snapshot is not None and not is_same(values, param.shared_snapshot):
                param.shared_snapshot = list(values)
                changed = True
            if slot.placeholder is not None and values is slot.placeholder and values and values[0].id:
                slot.placeholder = None  # the skill has added the element to the world model
                changed = True
            if changed:
                slot.note_change()
            elif not everything:
                continue
            entry = entries.get(slot.key)
            if not values:
                # Where its elements are gone, and another skill has set the key since, that value stays.
                is_own = changed or slot.ignored is None or (entry is not None and entry.current is slot.ignored)
                if removes and entry is not None and is_own:
                    del entries[slot.key]
                    pushed.append(slot.key)
            elif entry is not None and entry.current is values:
                if changed or slot.is_given_again(entry):
                    entry.origin, entry.set_by = slot.origin, node._label
                    pushed.append(slot.key)
            elif changed or not (slot.is_at_placeholder or (entry is not None and entry.current is slot.shared)):
                entries[slot.key] = entry = param.with_values(values)
                entry.key = slot.key
                entry.origin, entry.set_by = slot.origin, node._label
                slot.shared = values
                pushed.append(slot.key)
        return pushed


def _ids(elements: list[Any]) -> list[Any]:
    return [getattr(element, "id", None) for element in elements]


def has_changed_in_place(lent: Iterable[Param]) -> bool:
    """Whether a list of values that the skill's code has got was changed in place."""
    return any(not is_same(param.current, param.shared_snapshot) for param in lent)


def is_same(values: list[Any], other: list[Any] | None) -> bool:
    """Whether two lists are equal; values that cannot be compared are not."""
    try:
        return values == other
    except FOREIGN_ERRORS:
        return False


def scope(outer: Mapping[str, str], remaps: Mapping[str, str]) -> Mapping[str, str]:
    """Composes remaps: maps the keys of a node to keys on the blackboard, where they differ.

    :param outer: the result for the parent.
    :param remaps: of the node.
    """
    return {**outer, **{key: outer.get(name, name) for key, name in remaps.items()}} if remaps else outer


def make_slots(node: SkillInterface, declared: ParamHandler) -> tuple[ParamHandler, list[Slot]]:
    """Creates the parameters of a node that starts, with their specified values or defaults, and their slots.

    Unknown keys and values of a wrong type are logged and ignored.

    :param declared: the parameters of the implementation.
    """
    names = node.blackboard_keys
    specified = {node.own_name(name): values for name, values in node.specified_values.items()}
    provenance = GIVEN if node.parent is not None and node.parent.parent is None else SPECIFIED
    params: dict[str, Param] = {}
    slots = []
    for key, param in declared._params.items():
        own = param.checked_or_log([_as_read(v) for v in specified.pop(key)]) if key in specified else None
        if own is None:
            params[key] = param = param.at_default()
        else:
            params[key] = param = param.with_values(own)
            param.defaults = list(own)
        is_default = own is None or (provenance == GIVEN and is_same(own, declared._params[key].defaults))
        slot = Slot(param, names.get(key, key), DEFAULT if is_default else provenance)
        if slot.placeholder is not None or not param.current:
            slot.provenance = UNSET
        slots.append(slot)
    for key in specified:
        log.error("%s: %s", node.printState(), declared.unknown(key))
    return ParamHandler(params, is_strict=True), slots


def add_slots(node: SkillWrapper, slots: list[Slot]) -> None:
    """Updates the slots of a skill that has declared parameters since its start."""
    known = {slot.param.key: slot for slot in slots}
    params = node._params._params
    slots[:] = [slot for slot in slots if slot.param.key in params]
    for key, param in params.items():
        slot = known.get(key)
        if slot is None:
            slots.append(Slot(param, node.blackboard_keys.get(key, key), DEFAULT if param.is_bound() else UNSET))
        elif slot.param is not param:
            slot.__init__(param, slot.key, DEFAULT)  # type: ignore[misc]
    node.element_slots = [slot for slot in slots if slot.is_element]


def _as_read(value: Any) -> Any:
    return value.as_read() if isinstance(value, Element) else value  # an element only names the one to use


# -- provenance, for explanations ------------------------------------------------------------------------------------


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


# -- remaps without a target ---------------------------------------------------------------------------------------


def unprovided_remap(node: SkillWrapper, slot: Slot, blackboard: Blackboard) -> str:
    """The error text when a parameter is remapped to a key that no other node has; else ""."""
    if slot.key == slot.param.key or slot.key in blackboard:
        return ""
    known: set[str] = set()
    root: SkillInterface = node
    while root.parent is not None:
        root = root.parent
    pending: list[tuple[SkillInterface, Mapping[str, str]]] = [(root, {})]
    while pending:
        other, outer = pending.pop()
        names = scope(outer, other.remaps)
        pending += [(child, names) for child in other.children]
        if other is not node:
            known.update(names.get(key, key) for key in _declared_keys(other))
    if slot.key in known:
        return ""
    near = nearest(slot.key, known | set(blackboard._entries))
    return (
        f"parameter {slot.param.key!r} is remapped to {slot.key!r}, which no other node of the task has"
        f"{'; near: ' + ', '.join(near) if near else ''}"
    )


def _declared_keys(node: SkillInterface) -> Collection[str]:
    """The keys that a node declares; () for a group or an unknown skill."""
    try:
        return list(node.declared_params()) if hasattr(node, "declared_params") else ()
    except UnknownName:
        return ()
