"""Converts changes, operations, history and last wills to and from messages."""

from __future__ import annotations

from collections.abc import Sequence

import genpy

from skiros2_common.core.changeset import ChangeSet
from skiros2_common.core.element_content import relation_dict
from skiros2_common.core.errors import WrongValue
from skiros2_common.core.operations import (
    Add,
    Apply,
    Change,
    Expect,
    Instantiate,
    Operation,
    Patch,
    Relate,
    Remove,
    Update,
    snapshot_number,
)
from skiros2_common.core.property import Property
from skiros2_common.core.world_element import Element, ElementChanges, RelationDict
from skiros2_common.ros.utils import element2msg, msg2element, msg2relation, relation2msg
from skiros2_msgs import msg as msgs
from skiros2_msgs import srv as srvs
from skiros2_world_model.core.history import HistoryEntry, Point

_OP = msgs.WmOperation


def msg2change(msg: msgs.WmMonitor, context: str) -> Change:
    """Converts a `WmMonitor` to a change."""
    return Change(
        snapshot_number(msg.snapshot_id),
        msg.prev_snapshot_id,
        msg.snapshot_id,
        msg.stamp.to_sec(),
        msg.author,
        msg.action,
        context,
        tuple(msg2shared_element(e, snapshot_number(msg.snapshot_id)) for e in msg.elements),
        tuple(msg2relation(r) for r in msg.relation),
    )


def msg2shared_element(msg: msgs.WmElement, version: int) -> Element:
    """Converts a `WmElement` to an element as the world model returns it: its `changes` start from here."""
    read = msg2element(msg)
    if not read.id:
        return read  # a template
    return Element.shared(read.type, read.label, read.id, read.property_view, read.relation_view, version)


def operation2msg(operation: Operation) -> msgs.WmOperation:
    """Converts an operation to a `WmOperation`."""
    if isinstance(operation, Add):
        return _OP(action=_OP.ADD, reference=operation.reference, element=element2msg(operation.element))
    if isinstance(operation, Update):
        return _OP(
            action=_OP.UPDATE,
            element=element2msg(operation.element),
            with_relations=operation.relations,
            keys=sorted(operation.keys or ()),
            with_keys=operation.keys is not None,
        )
    if isinstance(operation, Patch):
        return _patch2msg(operation)
    if isinstance(operation, Remove):
        return _OP(
            action=_OP.REMOVE,
            element=msgs.WmElement(id=operation.id),
            recursive=operation.recursive,
            relation_filter=operation.relation_filter,
            type_filter=operation.type_filter,
        )
    if isinstance(operation, Relate):
        relation = msgs.Relation(operation.src, operation.pred, operation.dst)
        element = msgs.WmElement(relations=[relation])
        return _OP(action=_OP.RELATE if operation.value else _OP.UNRELATE, element=element)
    if isinstance(operation, Expect):
        return _OP(action=_OP.EXPECT, element=msgs.WmElement(id=operation.id), version=operation.version)
    if isinstance(operation, Apply):
        return _OP(action=_OP.APPLY, change_set=operation.change_set.to_json())
    relations = [msgs.Relation(r["src"], r["type"], r["dst"]) for r in operation.relations]
    return _OP(
        action=_OP.INSTANTIATE,
        reference=operation.reference,
        element=msgs.WmElement(label=operation.uri, relations=relations),
        keys=list(operation.relation_filter),
        recursive=operation.recursive,
        relation_filter=" ".join(sorted(operation.known)),
    )


def msg2operation(msg: msgs.WmOperation) -> Operation:
    """Converts a `WmOperation` to an operation.

    :raises WrongValue: the action is unknown, or a part is missing.
    """
    if msg.action == _OP.ADD:
        return Add(msg2element(msg.element), msg.reference)
    if msg.action == _OP.UPDATE:
        return Update(msg2element(msg.element), msg.with_relations, frozenset(msg.keys) if msg.with_keys else None)
    if msg.action == _OP.PATCH:
        return _msg2patch(msg)
    if msg.action == _OP.REMOVE:
        return Remove(msg.element.id, msg.recursive, msg.relation_filter, msg.type_filter)
    if msg.action == _OP.EXPECT:
        return Expect(msg.element.id, msg.version)
    if msg.action == _OP.APPLY:
        return Apply(ChangeSet.from_json(msg.change_set))
    relations = [msg2relation(r) for r in msg.element.relations]
    if msg.action == _OP.INSTANTIATE:
        known = frozenset(msg.relation_filter.split())
        return Instantiate(msg.element.label, msg.recursive, relations, list(msg.keys), known, msg.reference)
    if msg.action in (_OP.RELATE, _OP.UNRELATE):
        if len(relations) != 1:
            raise WrongValue(f"operation {msg.action!r}: expected one relation in its element, got {len(relations)}")
        relation = relations[0]
        return Relate(relation["src"], relation["type"], relation["dst"], msg.action == _OP.RELATE)
    known_actions = (
        *(_OP.ADD, _OP.INSTANTIATE, _OP.UPDATE, _OP.PATCH, _OP.REMOVE),
        *(_OP.RELATE, _OP.UNRELATE, _OP.EXPECT, _OP.APPLY),
    )
    raise WrongValue(f"unknown operation {msg.action!r}; known: {', '.join(known_actions)}")


def _patch2msg(patch: Patch) -> msgs.WmOperation:
    changes = patch.changes
    content = changes.properties, changes.added_relations
    element = Element.with_content(changes.type or "", changes.label or "", patch.id, *content)
    return _OP(
        action=_OP.PATCH,
        element=element2msg(element),
        keys=changes.removed_properties,
        removed=_facts(changes.removed_relations),
        with_label=changes.label is not None,
        with_type=changes.type is not None,
    )


def _msg2patch(msg: msgs.WmOperation) -> Patch:
    element = msg2element(msg.element)
    properties: dict[str, Property] = element.property_view
    changes = ElementChanges(
        properties,
        list(msg.keys),
        [relation_dict(r["src"], r["type"], r["dst"]) for r in element.relation_view],
        [msg2relation(r) for r in msg.removed],
        element.label if msg.with_label else None,
        element.type if msg.with_type else None,
    )
    return Patch(element.id, changes)


def _facts(relations: Sequence[RelationDict]) -> list[msgs.Relation]:
    return [relation2msg(r) for r in relations if r["state"] and not r["abstract"]]


def history_request(
    action: str,
    context: str,
    since: Point | None = None,
    until: Point | None = None,
    element: str = "",
    author: str = "",
    limit: int = 0,
) -> srvs.WmHistoryRequest:
    """Creates a request of `WmHistory`. None as a point: the beginning of the journal, or now."""
    return srvs.WmHistoryRequest(action, context, element, author, *_point2msg(since), *_point2msg(until), limit)


def entry2msg(entry: HistoryEntry) -> msgs.WmHistoryEntry:
    """Converts an entry to a `WmHistoryEntry`."""
    stamp, changes = genpy.Time.from_sec(entry.stamp), entry.changes.to_json()
    return msgs.WmHistoryEntry(entry.number, stamp, entry.author, entry.action, changes)


def msg2entry(msg: msgs.WmHistoryEntry) -> HistoryEntry:
    """Converts a `WmHistoryEntry` to an entry."""
    return HistoryEntry(msg.number, msg.stamp.to_sec(), msg.author, msg.action, ChangeSet.from_json(msg.change_set))


def msg2point(number: int, time: genpy.Time) -> Point | None:
    """The point of a request; None when neither number nor time is set."""
    return int(number) or time.to_sec() or None


def _point2msg(point: Point | None) -> tuple[int, genpy.Time]:
    if isinstance(point, int):
        return point, genpy.Time()
    return 0, genpy.Time.from_sec(point or 0.0)
