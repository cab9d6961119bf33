"""Numbers the changes of a world model and notifies listeners."""

from __future__ import annotations

import logging
import time
import uuid
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

from skiros2_common.core.revision import local_revision
from skiros2_common.core.world_element import Element, RelationDict
from skiros2_world_model.core.changes import ADD, REMOVE, REMOVE_RECURSIVE, UPDATE, Change
from skiros2_world_model.core.scene import Provenance, Scene
from skiros2_world_model.core.transaction import Transaction

log = logging.getLogger(__name__)

Listener = Callable[[Change], None]


@dataclass
class PendingChange:
    """A change to report once its request is committed.

    :param elements: removed elements, as they were.
    :param ids: added or updated elements.
    """

    action: str
    elements: Sequence[Element] = ()
    ids: Sequence[str] = ()
    relations: Sequence[RelationDict] = ()


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

    def next(self, author: str) -> Provenance:
        """The provenance of the next change, with the current time."""
        return Provenance(self.number + 1, time.time(), author)

    def add_listener(self, listener: Listener) -> None:
        self._listeners.append(listener)

    def remove_listener(self, listener: Listener) -> None:
        if listener in self._listeners:
            self._listeners.remove(listener)

    def notify_all(
        self, pending: Iterable[PendingChange], provenance: Provenance, context: str, scene: Scene
    ) -> list[Change]:
        """Numbers the changes of one request, in order, and notifies the listeners."""
        return [self.notify(n.action, provenance, context, _elements(n, scene), n.relations) for n in pending]

    def notify(
        self,
        action: str,
        provenance: Provenance,
        context: str,
        elements: Iterable[Element] = (),
        relations: Iterable[RelationDict] = (),
    ) -> Change:
        """Numbers one change and notifies the listeners.

        :param provenance: that of the request's first change.
        """
        before = self.snapshot_id
        self.number += 1
        local_revision.advance()
        change = Change(
            self.number,
            before,
            self.snapshot_id,
            provenance.stamp,
            provenance.author,
            action,
            context,
            tuple(elements),
            tuple(relations),
        )
        for listener in list(self._listeners):
            try:
                listener(change)
            except Exception:
                log.exception("a listener failed on change %s; the change is kept", change.snapshot_id)
        return change


def pending_changes(transaction: Transaction, scene: Scene) -> list[PendingChange]:
    """The changes to report for a transaction; none when it changed nothing."""
    pending: list[PendingChange] = []
    if transaction.removed:
        action = REMOVE_RECURSIVE if transaction.removed_recursively else REMOVE
        pending.append(PendingChange(action, transaction.removed))
    for action, ids in ((ADD, transaction.added), (UPDATE, transaction.updated)):
        existing = [eid for eid in ids if eid in scene]
        if existing:
            pending.append(PendingChange(action, ids=existing))
    for action, relations in ((ADD, transaction.related), (REMOVE, transaction.unrelated)):
        if relations:
            pending.append(PendingChange(action, relations=relations))
    return pending


def _elements(pending: PendingChange, scene: Scene) -> list[Element]:
    current = (scene.element(eid) for eid in pending.ids)
    return [*pending.elements, *(element for element in current if element is not None)]
