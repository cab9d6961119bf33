"""One request to a world model, over any number of contexts: applied as a whole, or rolled back."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from skiros2_common.core.changeset import UNKNOWN, ChangeInfo, ChangeSet, ElementRecord
from skiros2_common.core.operations import SCENE, UPDATE, Change, Operation, Outcome
from skiros2_world_model.core.change_notifier import ChangeNotifier, PendingChange, pending_changes
from skiros2_world_model.core.checks import Checks
from skiros2_world_model.core.context import Contexts
from skiros2_world_model.core.ontology import Ontology
from skiros2_world_model.core.reasoning import Offer, Reasoning
from skiros2_world_model.core.request_log import LogLine
from skiros2_world_model.core.scene import Scene, apply
from skiros2_world_model.core.transaction import Transaction


@dataclass(eq=False)
class Part:
    """The part of a request that concerns one context.

    :param pending: its changes to publish.
    :param change_info: that of its first change.
    """

    context: str
    scene: Scene
    pending: list[PendingChange] = field(default_factory=list)
    change_info: ChangeInfo = UNKNOWN
    _committed: ChangeSet = field(default_factory=ChangeSet)
    _touched: list[ElementRecord] = field(default_factory=list)  # before, elements of which only relations changed

    def commit(self) -> None:
        """Ends the transaction of the scene."""
        if not self.pending:
            self.scene.roll_back()  # nothing changed: restore the versions of the elements, too
        changes, records = self.scene.changes, map(self.scene.record, self.scene.changes.ids())
        self._touched = [r for r in records if r is not None and r.id not in changes.records]
        self._committed = self.scene.commit(self.change_info)

    def revert(self) -> None:
        """Undoes `commit`. Nothing may have changed since."""
        apply(self._committed.inverse(), self.scene)
        for record in self._touched:
            self.scene.replace(record.id, record)
        self.scene.recent.add(self._committed.ids())  # other threads may have looked up what was undone


class Request:
    """Applies operations to one context, and what follows from them to others. Used once, under the lock.

    Relations whose subjects are in another context are added there, and relations of other contexts to removed elements
    are removed. Reasoners parse what changes in the scene.

    :param checks: creates the checks of one part.
    """

    def __init__(
        self, contexts: Contexts, ontology: Ontology, reasoning: Reasoning, checks: Callable[[], Checks], author: str
    ) -> None:
        self._contexts = contexts
        self._ontology = ontology
        self._reasoning = reasoning
        self._checks = checks
        self._author = author
        self._existing = set(contexts)
        self._transactions: dict[str, Transaction] = {}  # by context
        #: The parts, that of the requested context first; valid after `apply`.
        self.parts: list[Part] = []
        #: The numbered changes, and the line for the journal (None: nothing changed); valid after `commit`.
        self.changes: list[Change] = []
        self.line: LogLine | None = None
        self._ids: list[str] = []
        self._is_committed = False
        self._offered: list[Offer] = []

    @property
    def renamed(self) -> list[tuple[str, str]]:
        """The requested and the assigned ids of elements whose number was taken."""
        return [pair for transaction in self._transactions.values() for pair in transaction.renamed]

    @property
    def outcome(self) -> Outcome:
        """The result; valid after `commit`."""
        return Outcome(self._ids, self.changes)

    def apply(self, operations: Sequence[Operation], context: str) -> None:
        """Applies the operations. Call `roll_back` after an exception.

        :raises SkirosError: an operation is refused.
        """
        self._ids = self._apply(operations, context)
        for name, done in self._transactions.items():
            scene, pending = self._scene(name), [PendingChange(UPDATE)]
            if name == SCENE:
                pending = pending_changes(scene.changes, done.updated, done.related, done.removed_recursively)
            self.parts.append(Part(name, scene, pending))

    def commit(self, notifier: ChangeNotifier) -> None:
        """Numbers the changes and commits the scenes. Nothing is written or published. As `apply` when it raises.

        :raises Refused: the changes cannot be written to a journal.
        """
        self.line = numbered_line(self.parts, notifier, self._author)
        for part in self.parts:
            part.commit()
            self.changes += notifier.number_changes(part.pending, part.change_info, part.context, part.scene)
        self._is_committed = True
        self._offered = self._reasoning.take_offered()

    def roll_back(self) -> None:
        """Undoes everything, also what is committed, if nothing has changed since."""
        if self._is_committed:
            for part in self.parts:
                part.revert()
        else:
            self._offered = self._reasoning.take_offered()
            for name in self._transactions:
                self._scene(name).roll_back()
        if SCENE in self._transactions:
            self._reasoning.undo(self._scene(SCENE), self._offered)
        for name in set(self._contexts) - self._existing:
            del self._contexts[name]

    def _apply(self, operations: Sequence[Operation], context: str) -> list[str]:
        transaction = self._transactions.get(context)
        scene = self._scene(context)
        if transaction is not None:
            ids = transaction.include(operations, self._checks(), self._author)
        else:
            others = self._contexts.others(context)
            transaction = Transaction(scene, self._ontology, self._checks(), self._author, others)
            self._transactions[context] = transaction
            scene.begin()
            ids = transaction.run(operations)
        if context == SCENE:
            self._reasoning.offer(scene, transaction)
        elsewhere, transaction.in_other_contexts = transaction.in_other_contexts, {}
        for other, relations in elsewhere.items():
            self._apply(relations, other)
        for other, patches in self._contexts.dangling(scene.changes):
            self._apply(patches, other)
        return ids

    def _scene(self, context: str) -> Scene:
        return self._contexts.named(context).scene


def numbered_line(parts: Sequence[Part], notifier: ChangeNotifier, author: str) -> LogLine | None:
    """Numbers the parts of a request. Returns its line for the journal; None when nothing changed.

    :raises Refused: the changes cannot be written to a journal.
    """
    number = notifier.number
    for part in parts:
        part.change_info = notifier.next(author, number)
        number += len(part.pending)
    changed = [part for part in parts if part.pending]
    if not changed:
        return None
    return LogLine.of((p.change_info, p.change_info.version + len(p.pending) - 1, p.context, p.scene) for p in changed)
