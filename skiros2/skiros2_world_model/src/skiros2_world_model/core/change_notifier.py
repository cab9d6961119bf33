"""Numbers the changes of a world model and notifies listeners."""

from __future__ import annotations

import logging
import time
import uuid
from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass

from skiros2_common.core.changeset import ChangeInfo, ChangeSet, Relation
from skiros2_common.core.element_content import relation_dict
from skiros2_common.core.operations import ADD, REMOVE, REMOVE_RECURSIVE, UPDATE, Change
from skiros2_common.core.revision import local_revision
from skiros2_common.core.world_element import Element
from skiros2_world_model.core.scene import Scene

log = logging.getLogger(__name__)

Listener = Callable[[Change], None]


@dataclass
class PendingChange:
    """A change to publish once its request is committed.

    :param elements: removed elements, as they were.
    :param ids: added or updated elements.
    :param relations: relations added or removed without their elements.
    """

    action: str
    elements: Sequence[Element] = ()
    ids: Sequence[str] = ()
    relations: Sequence[Relation] = ()


class ChangeNotifier:
    """Numbers changes and calls listeners. Used under the world model's lock.

    :param number: the number of the last change so far; numbers only increase.
    :param session: the first part of the snapshot ids; "" generates one.
    """

    def __init__(self, number: int, session: str = "") -> None:
        self.number = number
        self.session = session or uuid.uuid4().hex[:8]
        self._listeners: list[Listener] = []

    @property
    def snapshot_id(self) -> str:
        """The name of the current state."""
        return f"{self.session}-{self.number}"

    def next(self, author: str, number: int | None = None) -> ChangeInfo:
        """The number, time and author of the change after this one (None: the last), with the current time."""
        return ChangeInfo((self.number if number is None else number) + 1, time.time(), author)

    def add_listener(self, listener: Listener) -> None:
        self._listeners.append(listener)

    def remove_listener(self, listener: Listener) -> None:
        if listener in self._listeners:
            self._listeners.remove(listener)

    def publish(
        self, pending: Iterable[PendingChange], change_info: ChangeInfo, context: str, scene: Scene
    ) -> list[Change]:
        """Numbers the changes of one request, in order, and notifies the listeners.

        :param change_info: that of the request's first change.
        """
        changes = self.number_changes(pending, change_info, context, scene)
        for change in changes:
            self.notify(change)
        return changes

    def number_changes(
        self, pending: Iterable[PendingChange], change_info: ChangeInfo, context: str, scene: Scene
    ) -> list[Change]:
        """Numbers the changes of one request, in order, for `notify`; parameters as for `publish`."""
        return [self._number(change, change_info, context, scene) for change in pending]

    def notify(self, change: Change) -> None:
        """Notifies the listeners of a numbered change."""
        local_revision.advance()
        for listener in list(self._listeners):
            try:
                listener(change)
            except Exception:
                log.exception("a listener failed on change %s; the change is kept", change.snapshot_id)

    def _number(self, pending: PendingChange, change_info: ChangeInfo, context: str, scene: Scene) -> Change:
        current = (scene.element(eid) for eid in pending.ids)
        elements = (*pending.elements, *(element for element in current if element is not None))
        relations = tuple(relation_dict(*relation) for relation in pending.relations)
        before = self.snapshot_id
        self.number += 1
        stamp, author = change_info.stamp, change_info.author
        return Change(
            self.number, before, self.snapshot_id, stamp, author, pending.action, context, elements, relations
        )


def pending_changes(
    change_set: ChangeSet,
    updated: Iterable[str] = (),
    related: Collection[Relation] = (),
    recursively: bool = False,
) -> list[PendingChange]:
    """The changes to publish for a change set; none when nothing changed.

    :param updated: elements to publish as updated, whether they have changed or not.
    :param related: changed relations to publish as such; others are published with their ends, if these are published.
    :param recursively: whether elements were removed together with their descendants.
    """
    added: list[str] = []
    changed = dict.fromkeys(updated)
    for eid, (before, after) in change_set.records.items():
        if before is None and after is not None:
            added.append(eid)
            changed.pop(eid, None)
        elif after is not None:
            changed[eid] = None
        else:
            changed.pop(eid, None)
    removed = change_set.removed()
    published = {*added, *changed, *(element.id for element in removed)}
    pending: list[PendingChange] = []
    if removed:
        pending.append(PendingChange(REMOVE_RECURSIVE if recursively else REMOVE, removed))
    for action, ids in ((ADD, added), (UPDATE, list(changed))):
        if ids:
            pending.append(PendingChange(action, ids=ids))
    for action, wanted in ((ADD, True), (REMOVE, False)):
        relations = [
            relation
            for relation, is_added in change_set.relations.items()
            if is_added == wanted
            and (relation in related or (relation[0] not in published and relation[2] not in published))
        ]
        if relations:
            pending.append(PendingChange(action, relations=relations))
    return pending
