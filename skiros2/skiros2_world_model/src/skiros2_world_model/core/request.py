"""One request to a world model, over any number of contexts: applied as a whole, or rolled back."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from skiros2_common.core.changeset import UNKNOWN, ChangeInfo
from skiros2_common.core.operations import SCENE, UPDATE, Operation
from skiros2_world_model.core.change_notifier import PendingChange, pending_changes
from skiros2_world_model.core.checks import Checks
from skiros2_world_model.core.context import Contexts
from skiros2_world_model.core.ontology import Ontology
from skiros2_world_model.core.reasoning import Reasoning
from skiros2_world_model.core.scene import Scene
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

    def commit(self) -> None:
        if not self.pending:
            self.scene.roll_back()  # nothing changed: restore the versions of the elements, too
        self.scene.commit(self.change_info)


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

    @property
    def renamed(self) -> list[tuple[str, str]]:
        """The requested and the assigned ids of elements whose number was taken."""
        return [pair for transaction in self._transactions.values() for pair in transaction.renamed]

    def apply(self, operations: Sequence[Operation], context: str) -> list[str]:
        """Applies the operations and returns the id that each affected. Call `roll_back` after an exception.

        :raises SkirosError: an operation is refused.
        """
        ids = self._apply(operations, context)
        for name, done in self._transactions.items():
            scene, pending = self._scene(name), [PendingChange(UPDATE)]
            if name == SCENE:
                pending = pending_changes(scene.changes, done.updated, done.related, done.removed_recursively)
            self.parts.append(Part(name, scene, pending))
        return ids

    def roll_back(self) -> None:
        """Undoes everything."""
        for name in self._transactions:
            self._scene(name).roll_back()
        if SCENE in self._transactions:
            self._reasoning.undo(self._scene(SCENE))
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
