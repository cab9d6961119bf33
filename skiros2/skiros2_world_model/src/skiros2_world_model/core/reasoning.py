"""Runs the reasoners of a world model and passes each change to them before it is committed."""

from __future__ import annotations

import logging
import threading
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager

from skiros2_common.core.discrete_reasoner import DiscreteReasoner
from skiros2_common.core.element_content import ElementChanges
from skiros2_common.core.errors import FOREIGN_ERRORS, Refused, SkirosError, UnknownName
from skiros2_common.core.names import full_name
from skiros2_common.core.operations import ADD, REMOVE, UPDATE, Operation
from skiros2_common.core.reasoner_registry import data_of
from skiros2_common.core.world_element import REASONER_PROPERTY, Element
from skiros2_world_model.core.checks import Checks, made_property
from skiros2_world_model.core.scene import ElementRecord, Scene, apply
from skiros2_world_model.core.transaction import Transaction, Visit

log = logging.getLogger(__name__)

#: How long loading a scene waits for each reasoner to stop (s).
_STOP_TIMEOUT = 2.0


#: A call of `parse`.
Offer = tuple[DiscreteReasoner, str, Element]


class Reasoning:
    """The loaded reasoners. Used under the world model's lock, except `execute`, `stop` and `stopped`.

    Every reasoner parses every change, whether the element names the reasoner or not. Exceptions in reasoners are
    logged and ignored.
    """

    def __init__(self) -> None:
        self._reasoners: dict[str, DiscreteReasoner] = {}
        #: The request that reasoners currently parse; their writes become part of it.
        self.transaction: Transaction | None = None
        #: Held by the thread that runs `offer`, but released during `parse`, while `is_parsing` is true: otherwise two
        #: threads of a reasoner that share a lock could deadlock.
        self.parse_lock = threading.RLock()
        self.is_parsing = False
        self._stopping = threading.RLock()
        self._offered: list[Offer] = []  # in the current request
        self._present: list[Visit] = []  # visits whose changes are in the scene, during one `parse`
        self._visits: list[Visit] = []

    def add(self, reasoner: DiscreteReasoner) -> None:
        """Adds a reasoner under its class name."""
        self._reasoners[_name(reasoner)] = reasoner

    def all(self) -> list[DiscreteReasoner]:
        return list(self._reasoners.values())

    def keys_of(self, name: str) -> frozenset[str]:
        """The properties that a reasoner owns.

        :raises UnknownName: the reasoner is not loaded.
        """
        reasoner = self._reasoners.get(name)
        if reasoner is None:
            loaded = ", ".join(self._reasoners) or "none"
            raise UnknownName(f"there is no reasoner {name!r}; loaded: {loaded}")
        return frozenset(map(full_name, data_of(reasoner)))

    # -- threads -----------------------------------------------------------------------------------------------

    def execute(self) -> None:
        """Starts all reasoners."""
        for reasoner in self.all():
            try:
                reasoner.execute()
            except FOREIGN_ERRORS:
                log.exception("reasoner %s cannot be started", _name(reasoner))

    def stop(self, timeout: float = _STOP_TIMEOUT) -> None:
        """Stops all reasoners and waits for them. Must not be called under the lock, which they may need.

        :param timeout: in s, for each reasoner.
        """
        for reasoner in self.all():
            try:
                reasoner.stop()
            except FOREIGN_ERRORS:
                log.exception("reasoner %s cannot be stopped", _name(reasoner))
        for reasoner in self.all():
            if not reasoner.wait_stopped(timeout):
                log.warning("reasoner %s is still running %g s after the request to stop", _name(reasoner), timeout)

    @contextmanager
    def stopped(self) -> Iterator[None]:
        """Stops all reasoners and restarts them at the end. Must not be entered under the lock."""
        with self._stopping:
            self.stop()
            try:
                yield
            finally:
                self.execute()

    # -- changes -----------------------------------------------------------------------------------------------

    def offer(self, scene: Scene, transaction: Transaction) -> None:
        """Has every reasoner parse each element that a transaction adds, updates or removes.

        The changes that reasoners make to elements become part of the transaction. Call `take_offered` afterwards.

        :raises Refused: a reasoner rejects a change.
        """
        if not self._reasoners:
            return
        asked: set[str] = set()
        with self.parse_lock:
            self.transaction = transaction
            try:
                while changed := [eid for eid in _changed_ids(scene, transaction) if eid not in asked]:
                    asked.update(changed)
                    removed = {element.id: element for element in scene.changes.removed()}
                    for eid in changed:
                        if eid in scene or eid in removed:
                            self._offer(scene, transaction, eid, removed.get(eid))
            finally:
                self.transaction = None

    def visit(self, operations: Iterable[Operation], checks: Checks, author: str) -> list[str]:
        """Applies operations of a thread that a reasoner's `parse` may wait for; see `Visit`. Under `parse_lock`.

        :returns: the id that each operation affected.
        :raises SkirosError: an operation is refused, or the request is being undone.
        """
        if self.transaction is None:
            raise Refused(f"{author}: another change is being undone; write again when `parse` has returned")
        visit = self.transaction.visit(operations, checks, author)
        self._present.append(visit)
        return visit.ids

    def take_visits(self) -> list[Visit]:
        """The requests to apply now that the current one has ended."""
        visits, self._visits = self._visits, []
        return visits

    @property
    def has_visits(self) -> bool:
        """Whether there are requests to apply before the next one."""
        return bool(self._visits)

    def take_offered(self) -> list[Offer]:
        """Ends the request. Returns what the reasoners have parsed, for `undo`."""
        offered, self._offered = self._offered, []
        return offered

    def undo(self, scene: Scene, offered: Sequence[Offer]) -> None:
        """Has the reasoners parse the inverse of each change, after a roll-back."""
        with self.parse_lock:
            for reasoner, action, element in reversed(offered):
                before = scene.element(element.id)
                if before is None:
                    self._parse(scene, reasoner, element, REMOVE)
                else:
                    self._parse(scene, reasoner, before, ADD if action == REMOVE else UPDATE)

    def complete(self, scene: Scene, only: Iterable[DiscreteReasoner] | None = None) -> None:
        """Adds the default properties of reasoners to the elements of a loaded scene that name them.

        :param only: these reasoners; None: all.
        """
        reasoners = {_name(r): r for r in (self.all() if only is None else only)}
        for record in list(scene):
            named = record.properties.get(REASONER_PROPERTY)
            for name in dict.fromkeys(named.values) if named is not None else ():
                if name in reasoners:
                    self._complete(scene, record.id, reasoners[name])

    def _complete(self, scene: Scene, eid: str, reasoner: DiscreteReasoner) -> None:
        element, record = scene.element(eid), scene.record(eid)
        assert element is not None and record is not None
        try:
            reasoner.addProperties(element)
        except NotImplementedError as error:
            log.debug("%s", error)
        except FOREIGN_ERRORS:
            log.exception("reasoner %s failed to add its properties to %s", _name(reasoner), eid)
            return
        changes = element.changes()
        found = changes.properties if changes is not None else {}
        new = {full_name(k): made_property(full_name(k), p.values, empty_type=p.dataType()) for k, p in found.items()}
        if not new.keys() <= record.properties.keys():
            scene.put(ElementRecord(eid, record.type, record.label, {**new, **record.properties}, record.change_info))

    def _offer(self, scene: Scene, transaction: Transaction, eid: str, removed: Element | None) -> None:
        for reasoner in self._reasoners.values():
            element = removed.view() if removed is not None else scene.element(eid)
            if element is None:
                return
            action = REMOVE if removed is not None else ADD if scene.changes.is_added(eid) else UPDATE
            if self._parse(scene, reasoner, element, action) is False:
                raise Refused(f"{_name(reasoner)} refuses to {action} {element!r}")
            self._offered.append((reasoner, action, element))
            changes = element.changes() if removed is None and element.may_be_changed else None
            if changes:
                self._store(scene, transaction, _name(reasoner), element, changes)

    def _store(
        self, scene: Scene, transaction: Transaction, name: str, element: Element, changes: ElementChanges
    ) -> None:
        try:
            with scene.nested():
                transaction.complete(element.id, changes)
        except SkirosError as error:
            log.error("the changes of reasoner %s to %s are discarded: %s", name, element.id, error)
        stored = scene.element(element.id)
        if stored is not None:
            element.adopt(stored, keep_children=True)

    def _parse(self, scene: Scene, reasoner: DiscreteReasoner, element: Element, action: str) -> bool | None:
        self.is_parsing = True
        self.parse_lock.release()
        try:
            return reasoner.parse(element, action)
        except NotImplementedError as error:
            log.debug("%s", error)  # `parse` is optional
        except FOREIGN_ERRORS:
            log.exception("reasoner %s failed to %s %s", _name(reasoner), action, element.id)
        finally:
            self.parse_lock.acquire()
            self.is_parsing = False
            for visit in reversed(self._present):
                apply(visit.changes.inverse(), scene)
            self._visits += self._present
            self._present = []
        return None


def _changed_ids(scene: Scene, transaction: Transaction) -> list[str]:
    """The removed elements, then those that changed. The objects of changed relations count, their subjects do not."""
    changes = scene.changes
    gone = [eid for eid, (_, after) in changes.records.items() if after is None]
    objects = (dst for _, _, dst in changes.relations)
    return list(dict.fromkeys([*gone, *changes.records, *objects, *transaction.updated]))


def _name(reasoner: DiscreteReasoner) -> str:
    return reasoner.__class__.__name__
