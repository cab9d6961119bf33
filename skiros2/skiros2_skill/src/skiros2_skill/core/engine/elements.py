"""The elements in the parameters of a node: read again when they have changed, dropped when they are gone, written when
a skill has assigned them."""

from __future__ import annotations

import time
from collections.abc import Iterator

from skiros2_common.core.errors import SkirosError
from skiros2_common.core.wording import moment
from skiros2_common.core.world_element import Element, ElementChanges
from skiros2_common.core.world_model_port import Revisions, WorldModelPort
from skiros2_skill.core.engine.slot import Slot


def refresh_elements(slots: list[Slot], wmi: WorldModelPort, revisions: Revisions | None) -> list[str]:
    """Reads elements that have changed in the world model again, keeping local changes; removed elements are dropped.

    :param slots: those of element type.
    :param revisions: of the world model's elements; None: not known.
    :returns: the ids of the dropped elements.
    """
    dropped = []
    for slot in slots:
        gone = read_again(slot.param.current, wmi, revisions)
        if gone:
            slot.drop(gone)
            dropped += [v.id for v in gone if v.id]
        if slot.param.shared_snapshot is not None:
            slot.param.shared_snapshot = list(slot.param.current)
    return dropped


def read_again(values: list[Element], wmi: WorldModelPort, revisions: Revisions | None) -> list[Element]:
    """Replaces the elements of a list that have changed in the world model by their present state, with the local
    changes. Returns those that are no longer in the world model.

    :param revisions: of the world model's elements; None: not known.
    """
    gone = []
    for index, value in enumerate(values):
        eid = value.id
        if not eid:
            if is_removed(value):
                gone.append(value)
            continue
        revision = revisions.element(eid) if revisions is not None else None
        if revision is not None and revision.version == value.version:
            continue
        found = wmi.find_element(eid)
        if found is None:
            gone.append(value)
        elif found.version != value.version or found.version < 0:
            changes = value.changes() if value.may_be_changed else None
            values[index] = apply_changes(found, changes) if changes else found
    return gone


def is_removed(element: Element) -> bool:
    """Whether an element was read from the world model and removed since, which clears its id."""
    return not element.id and element.version >= 0


def apply_changes(element: Element, changes: ElementChanges) -> Element:
    """Applies local changes to an element that was read again. Returns the element."""
    for key, prop in changes.properties.items():
        element.setProperty(key, prop.dataType())
        element.setProperty(key, list(prop.current))
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


def removal_text(eid: str, wmi: WorldModelPort) -> str:
    """States that an element is missing and, if the world model knows, who removed it and when."""
    removal = removal_of(eid, wmi)
    return f"element {eid} was {removal}" if removal else f"element {eid} is no longer in the scene"


def missing_text(element: Element, wmi: WorldModelPort) -> str:
    """Same as `removal_text`, after the name of a parameter."""
    removal = removal_of(element.id, wmi)
    return f"is {element!r}, which is not in the scene{f': it was {removal}' if removal else ''}"


def removal_of(eid: str, wmi: WorldModelPort) -> str:
    """States who removed an element and when: "removed by NAME at TIME"; "" if the world model does not know."""
    try:
        removed = wmi.removal_of(eid) if eid and hasattr(wmi, "removal_of") else None
    except SkirosError:
        removed = None
    if removed is None:
        return ""
    return f"removed by {removed.author.strip('/') or 'an unknown author'} at {moment(removed.stamp, time.time())}"


def assigned_elements(slots: list[Slot]) -> list[Element]:
    """The changed elements with an id in assigned parameters, which are written after an `execute`."""
    found: dict[int, Element] = {}
    for slot in slots:
        if not slot.param.assigned:
            continue
        values = slot.param.current
        if values and values[0].id:
            found.update((id(e), e) for e in values if e.id and _has_changes(e))
    return list(found.values())


def unwritten_elements(slots: list[Slot]) -> Iterator[Element]:
    """The elements with changes in place, which are not written."""
    for slot in slots:
        for element in slot.param.current:
            if element.id and element.may_be_changed and element.changes():
                yield element


def discard_changes(slots: list[Slot], wmi: WorldModelPort) -> None:
    """Discards a skill's local changes of elements by reading them again. Elements that are gone are dropped."""
    for slot in slots:
        values, gone = slot.param.current, []
        for index, element in enumerate(values):
            if element.id:
                found = wmi.find_element(element.id)
                if found is None:
                    gone.append(element)
                else:
                    values[index] = found
        if gone:
            slot.drop(gone)


def _has_changes(element: Element) -> bool:
    changes = element.changes()
    return changes is None or bool(changes) or bool(element.local_relations)
