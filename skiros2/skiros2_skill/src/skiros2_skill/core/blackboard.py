"""The blackboard of a task: one flat map from keys to parameters, which all nodes of the task share.

A node's key on it is the key after the remaps of the node and of all nodes above it. A node that starts, and a running
one before each `execute`, *pulls* the values for its keys; afterwards it *pushes* its own. The list of values itself is
passed on: what one holder of a key does to it in place, all holders see.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Collection, Iterable, Iterator, Mapping
from typing import Any

from skiros2_common.core.errors import FOREIGN_ERRORS, SkirosError, UnknownName, WrongType
from skiros2_common.core.explanation import CHANGED, DEFAULT, GIVEN, PULLED, SPECIFIED, UNSET
from skiros2_common.core.names import nearest
from skiros2_common.core.params import Param, ParamHandler, ParamTypes
from skiros2_common.core.world_element import Element, ElementChanges
from skiros2_skill.core.node import SkillInterface

log = logging.getLogger(__name__)


class Slot:
    """A parameter of a running node, and its key on the blackboard.

    :param placeholder: the list that the default, an abstract element, has made; it is not put on the blackboard.
    """

    __slots__ = (
        "candidate", "giver", "inferred", "is_element", "keeps", "key", "origin", "param", "passed", "placeholder",
        "seen",
    )  # fmt: skip

    def __init__(self, param: Param, key: str, origin: str) -> None:
        self.param = param
        self.key = key
        self.is_element = param.is_element
        #: The source of the values, as in `Provenance`, and the label of the node that set them on the blackboard.
        self.origin = origin
        self.giver = ""
        self.inferred = False
        default = param._default
        #: The ids of the default, which is kept unless the blackboard has just these; () for a default without ids,
        #: which is always kept; None when nothing is kept.
        self.keeps: list[str] | tuple[()] | None = None
        self.placeholder = None
        if default and not self.is_element:
            self.keeps = ()
        elif default and default[0].id:
            self.keeps = [e.id for e in default]
        elif default:
            self.placeholder = param._values
        #: The list that was last taken from the blackboard, or put on it, and the one that was last not taken.
        self.seen: list[Any] | None = None
        self.passed: list[Any] | None = None
        #: An inferred value on the blackboard, which is tried first.
        self.candidate: list[Any] | None = None

    @property
    def is_at_placeholder(self) -> bool:
        return self.param._values is self.placeholder and not any(e.id or e.may_be_changed for e in self.param._values)


class Blackboard:
    """The parameters of a task by key. For the thread that ticks the task.

    :param params: those of the task's root, in which it is kept.
    """

    def __init__(self, params: ParamHandler) -> None:
        self._handler = params

    @property
    def _entries(self) -> dict[str, Param]:
        return self._handler._params

    def __contains__(self, key: str) -> bool:
        return key in self._entries

    def values(self, key: str) -> list[Any]:
        """The values for a key; none when it is not there."""
        entry = self._entries.get(key)
        return entry._values if entry is not None else []

    def ids(self) -> set[str]:
        """The ids of all elements on the blackboard."""
        return {v.id for p in self._entries.values() if p.is_element for v in p._values}

    def pull(self, node: SkillInterface, slots: list[Slot], is_start: bool = False) -> bool:
        """Takes what is on the blackboard for the parameters of a node. Returns whether anything was new.

        A parameter with a default keeps it, unless that is an abstract element or elements with the same ids. An
        inferred value is taken by a parameter that is Optional, or, while the node runs, has no value; at the start
        others have it as a candidate.
        """
        entries = self._entries
        new = False
        for slot in slots:
            entry = entries.get(slot.key)
            if entry is None:
                continue
            values, param = entry._values, slot.param
            if values is param._values or values is slot.passed or values is slot.seen or not values:
                continue
            if slot.keeps is not None and slot.keeps != [v.id for v in values if isinstance(v, Element)]:
                slot.passed = values
                continue
            if entry.is_inferred and param._param_type is not ParamTypes.Optional and (is_start or param.is_bound()):
                slot.candidate = values
                continue
            slot.seen = values
            try:
                param._values = param._checked(values)
            except WrongType as error:
                log.error("%s keeps its own value, not the one on the blackboard: %s", node.printState(), error)
                continue
            _looked_at(param)
            slot.inferred = entry.is_inferred
            by_others = PULLED if is_start or not node._children else CHANGED
            slot.origin, slot.giver = by_others if entry.set_by else GIVEN, entry.set_by
            new = True
        return new

    def push(self, node: SkillInterface, slots: list[Slot], everything: bool = False, removes: bool = True) -> bool:
        """Puts the parameters of a node on the blackboard that were assigned, or changed in place, since they were
        last looked at; one without a value takes its key off. Returns whether the blackboard has changed.

        :param everything: also what was not changed, but for abstract elements that the description has declared.
        :param removes: whether keys are taken off.
        """
        entries = self._entries
        params = node._params._params
        if len(params) != len(slots):  # the skill has declared parameters while it runs
            add_slots(node, slots)
        news = False
        for slot in slots:
            param = slot.param
            values = param._values
            changed = param.assigned
            if changed:
                param.assigned = False
                slot.placeholder = None
                slot.inferred = False
                slot.origin, slot.giver = CHANGED, ""
            if param.shared_snapshot is not None and not is_same(values, param.shared_snapshot):
                param.shared_snapshot = list(values)
                changed = True
            if slot.placeholder is not None and values is slot.placeholder and values and values[0].id:
                slot.placeholder = None  # the skill has added the element to the world model
                changed = True
            if not (changed or everything):
                continue
            entry = entries.get(slot.key)
            if not values:
                if removes and entry is not None:
                    del entries[slot.key]
                    news = True
            elif entry is not None and entry._values is values:
                if changed:
                    entry.is_inferred, entry.set_by = slot.inferred, node._label
                    news = True
            elif changed or not (slot.is_at_placeholder or (entry is not None and entry._values is slot.seen)):
                entries[slot.key] = entry = param._copy(values)
                entry._key = slot.key
                entry.is_inferred, entry.set_by = slot.inferred, node._label
                slot.seen = values
                news = True
        return news


def has_changed_in_place(lent: Iterable[Param]) -> bool:
    """Whether a list of values that was handed out holds something else than when it was last looked at."""
    return any(not is_same(param._values, param.shared_snapshot) for param in lent)


def _looked_at(param: Param) -> None:
    if param.shared_snapshot is not None:
        param.shared_snapshot = list(param._values)


def is_same(values: list[Any], other: list[Any] | None) -> bool:
    """Whether two lists hold the same; values that cannot be compared do not."""
    try:
        return values == other
    except FOREIGN_ERRORS:
        return False


def scope(outer: Mapping[str, str], remaps: Mapping[str, str]) -> Mapping[str, str]:
    """The keys on the blackboard that keys below a node stand for, where they differ.

    :param outer: the same for the node above.
    :param remaps: the node's own.
    """
    return {**outer, **{key: outer.get(above, above) for key, above in remaps.items()}} if remaps else outer


def make_slots(node: SkillInterface, declared: ParamHandler) -> tuple[ParamHandler, list[Slot]]:
    """The parameters of a node that starts, set to their defaults or to what the node was given, and their slots.

    Unknown keys and values of another type are logged and ignored.

    :param declared: the parameters of the implementation.
    """
    names = node._scope
    given = {node.own_name(name): values for name, values in node._specified.items()} if node._specified else {}
    fixed = GIVEN if node._parent is not None and node._parent._parent is None else SPECIFIED
    params: dict[str, Param] = {}
    slots = []
    for key, param in declared._params.items():
        own = param._checked_or_log([_own(v) for v in given.pop(key)]) if key in given else None
        if own is None:
            params[key] = param = param.at_default()
        else:
            params[key] = param = param._copy(own)
            param._default = list(own)
        slot = Slot(param, names.get(key, key), DEFAULT if own is None else fixed)
        if slot.placeholder is not None or not param._values:
            slot.origin = UNSET
        slots.append(slot)
    for key in given:
        log.error("%s: %s", node.printState(), declared.unknown(key))
    return ParamHandler(params, is_strict=True), slots


def add_slots(node: Any, slots: list[Slot]) -> None:
    """Slots for the parameters that a skill has declared, or declared again, since it was started."""
    known = {slot.param._key: slot for slot in slots}
    params = node._params._params
    slots[:] = [slot for slot in slots if slot.param._key in params]
    for key, param in params.items():
        slot = known.get(key)
        if slot is None:
            slots.append(Slot(param, node._scope.get(key, key), DEFAULT if param.is_bound() else UNSET))
        elif slot.param is not param:
            slot.__init__(param, slot.key, DEFAULT)  # type: ignore[misc]
    node.element_slots = [slot for slot in slots if slot.is_element]


# -- elements ------------------------------------------------------------------------------------------------------


def refresh(slots: list[Slot], wmi: Any, present: Any) -> list[str]:
    """Reads the elements among the values again where they have changed in the world model; what was changed on them
    here is kept. Elements that are not there any more are dropped.

    :param slots: those of element type.
    :param present: the world model's `Revisions`, which tells which are the same; None: it is not known.
    :returns: the ids of those that were dropped.
    """
    gone = []
    for slot in slots:
        values = slot.param._values
        is_complete = True
        for index, value in enumerate(values):
            eid = value.id
            if not eid:
                is_complete = is_complete and value.version < 0
                continue
            mark = present.element(eid) if present is not None else None
            if mark is not None and mark.version == value.version:
                continue
            found = wmi.find_element(eid)
            if found is None:
                gone.append(eid)
                is_complete = False
            elif found.version != value.version or found.version < 0:
                changes = value.changes() if value.may_be_changed else None
                values[index] = with_changes(found, changes) if changes else found
        if not is_complete:
            slot.param._values = [v for v in values if v.id not in gone and not is_removed(v)]
            slot.seen = None
        _looked_at(slot.param)
    return gone


def is_removed(element: Element) -> bool:
    """Whether an element was read from the world model, and has lost its id since, as it was removed."""
    return not element.id and element.version >= 0


def with_changes(element: Element, changes: ElementChanges) -> Element:
    """An element with the changes that were made on an earlier reading of it."""
    for key, prop in changes.properties.items():
        element.setProperty(key, prop.dataType())
        element.setProperty(key, list(prop._values))
    for key in changes.removed_properties:
        if element.hasProperty(key):
            element.removeProperty(key)
    element.removeRelations(changes.removed_relations)
    for r in changes.added_relations:
        element.addRelation(r["src"], r["type"], r["dst"], r["state"], r["abstract"])
    if changes.label is not None:
        element.label = changes.label
    if changes.type is not None:
        element.type = changes.type
    return element


def removal(eid: str, wmi: Any) -> str:
    """That an element is gone, who removed it and when, as far as the world model tells."""
    try:
        removed = wmi.removal_of(eid) if hasattr(wmi, "removal_of") else None
    except SkirosError:
        removed = None
    if removed is None:
        return f"element {eid} is not in the scene any more"
    when = time.strftime("%Y-%m-%d %H:%M:%S", time.localtime(removed.stamp))
    return f"element {eid} was removed by {removed.author or 'an unknown author'} at {when}"


def assigned_elements(slots: list[Slot]) -> list[Element]:
    """The elements that are to be written after an `execute`: those with an id in parameters that were assigned."""
    found: dict[int, Element] = {}
    for slot in slots:
        values = slot.param._values
        if slot.param.assigned and values and values[0].id:
            found.update((id(e), e) for e in values if e.id and _has_news(e))
    return list(found.values())


def unwritten_elements(slots: list[Slot]) -> Iterator[Element]:
    """The elements that were changed in place and not written."""
    for slot in slots:
        for element in slot.param._values:
            if element.id and element.may_be_changed and element.changes():
                yield element


def drop_changes(slots: list[Slot], wmi: Any) -> None:
    """Discards what a skill has changed on its elements: they are read again."""
    for slot in slots:
        values = slot.param._values
        for index, element in enumerate(values):
            if element.id and element.may_be_changed:
                values[index] = wmi.find_element(element.id) or element


def _has_news(element: Element) -> bool:
    changes = element.changes()
    return changes is None or bool(changes) or bool(element.local_relations)


def _own(value: Any) -> Any:
    return value.view() if isinstance(value, Element) else value


# -- remaps to nowhere ---------------------------------------------------------------------------------------------


def why_not_provided(node: Any, slot: Slot, board: Blackboard) -> str:
    """Why a parameter is not inferred that was remapped to a key which no other node has; "" when one has it."""
    if slot.key == slot.param._key or slot.key in board:
        return ""
    known: set[str] = set()
    root = node
    while root._parent is not None:
        root = root._parent
    waiting: list[tuple[Any, Mapping[str, str]]] = [(root, {})]
    while waiting:
        other, outer = waiting.pop()
        names = scope(outer, other._remaps)
        waiting += [(child, names) for child in other._children]
        if other is not node:
            known.update(names.get(key, key) for key in _declared_keys(other))
    if slot.key in known:
        return ""
    near = nearest(slot.key, known | set(board._entries))
    return (
        f"parameter {slot.param._key!r} is remapped to {slot.key!r}, which no other node of the task has"
        f"{'; near: ' + ', '.join(near) if near else ''}"
    )


def _declared_keys(node: Any) -> Collection[str]:
    """The keys that a node declares; none for a group, or a skill that no library has."""
    try:
        return list(node.declared_params()) if hasattr(node, "declared_params") else ()
    except UnknownName:
        return ()
