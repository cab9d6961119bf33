"""The numbers of changes, and who is told of them."""

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
class News:
    """What is to be told once a request stands.

    :param elements: those that are gone, as they were.
    :param ids: of those that were added or updated.
    """

    action: str
    elements: Sequence[Element] = ()
    ids: Sequence[str] = ()
    relations: Sequence[RelationDict] = ()


class Announcer:
    """Numbers the changes of a world model and tells its listeners. Used under the world model's lock.

    :param number: of the last change before; numbers only ever grow.
    :param session: the first part of the snapshot ids; "": a new one.
    """

    def __init__(self, number: int, session: str = "") -> None:
        self.number = number
        self.session = session or uuid.uuid4().hex[:8]
        self._listeners: list[Listener] = []

    @property
    def snapshot_id(self) -> str:
        """The name of the present state."""
        return f"{self.session}-{self.number}"

    def next(self, author: str) -> Provenance:
        """The next change, which is now."""
        return Provenance(self.number + 1, time.time(), author)

    def add_listener(self, listener: Listener) -> None:
        self._listeners.append(listener)

    def remove_listener(self, listener: Listener) -> None:
        if listener in self._listeners:
            self._listeners.remove(listener)

    def tell_all(self, news: Iterable[News], made: Provenance, context: str, scene: Scene) -> list[Change]:
        """Tells what came of one request, in this order."""
        return [self.tell(n.action, made, context, _elements(n, scene), n.relations) for n in news]

    def tell(
        self,
        action: str,
        made: Provenance,
        context: str,
        elements: Iterable[Element] = (),
        relations: Iterable[RelationDict] = (),
    ) -> Change:
        """Tells one change.

        :param made: the first change of the request; this one has the next number.
        """
        before = self.snapshot_id
        self.number += 1
        local_revision.advance()
        change = Change(
            self.number,
            before,
            self.snapshot_id,
            made.stamp,
            made.author,
            action,
            context,
            tuple(elements),
            tuple(relations),
        )
        for listener in list(self._listeners):
            try:
                listener(change)
            except Exception:
                log.exception("a listener failed on change %s; the change stands", change.snapshot_id)
        return change


def news_of(transaction: Transaction, scene: Scene) -> list[News]:
    """What is to be told of a transaction on the scene; nothing when all is as it was."""
    news: list[News] = []
    if transaction.removed:
        news.append(News(REMOVE_RECURSIVE if transaction.removed_recursively else REMOVE, transaction.removed))
    for action, ids in ((ADD, transaction.added), (UPDATE, transaction.updated)):
        there = [eid for eid in ids if eid in scene]
        if there:
            news.append(News(action, ids=there))
    for action, relations in ((ADD, transaction.related), (REMOVE, transaction.unrelated)):
        if relations:
            news.append(News(action, relations=relations))
    return news


def _elements(news: News, scene: Scene) -> list[Element]:
    now = (scene.element(eid) for eid in news.ids)
    return [*news.elements, *(element for element in now if element is not None)]
