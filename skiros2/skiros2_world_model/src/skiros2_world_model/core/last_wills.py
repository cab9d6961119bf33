"""The last wills that a world model has, and how it carries them out."""

from __future__ import annotations

import logging
from collections.abc import Mapping

from skiros2_common.core.element_content import ElementChanges
from skiros2_common.core.errors import SkirosError, WrongValue
from skiros2_common.core.property import Property
from skiros2_common.core.world_element import Element
from skiros2_world_model.core.changes import Operation, Patch, Remove
from skiros2_world_model.core.context_names import SCENE
from skiros2_world_model.core.journal import Journal
from skiros2_world_model.core.wills import Life, Will, author_of_will, read_wills, wills_text
from skiros2_world_model.core.world_model import WorldModel

log = logging.getLogger(__name__)

#: What the journal notes the wills as.
_NOTE = "last wills"


class LastWills:
    """The wills that a world model has, one for each owner. Safe to use from all threads.

    :param model: what they are about; its lock guards them.
    :param journal: keeps them; those that it has of an earlier life of the world model are there at once.
    """

    def __init__(self, model: WorldModel, journal: Journal | None = None) -> None:
        self._model = model
        self._journal = journal
        self._wills = read_wills(journal.kept(_NOTE)) if journal is not None else {}

    def all(self) -> list[Will]:
        """The wills that are left now."""
        with self._model.lock:
            return list(self._wills.values())

    def leave(self, will: Will) -> None:
        """Keeps a will in the place of the owner's earlier one, which is carried out if it is of another life.

        :raises WrongValue: a bequest does not say of which elements it is, or has values that cannot be kept.
        :raises Refused: the journal cannot be written.
        """
        if not will.owner or not all(b.key and b.value for b in will.bequests):
            raise WrongValue(f"the last will of {will.owner!r}: expected an owner, and each bequest with key and value")
        with self._model.lock:
            before = self._wills.get(will.owner)
            if before is not None and before.life != will.life:
                self.carry_out(before.owner, before.life)
            self._keep({**self._wills, will.owner: will})

    def take_back(self, owner: str) -> None:
        """Forgets a will, if there is one.

        :raises Refused: the journal cannot be written.
        """
        with self._model.lock:
            if owner in self._wills:
                self._keep({name: will for name, will in self._wills.items() if name != owner})

    def carry_out(self, owner: str, life: Life) -> None:
        """Does what one life of a node has left to be done, and forgets it; nothing when there is no will of it.

        All of it in one request; where that is refused, each part for itself, and what is refused then is logged.
        """
        with self._model.lock:
            will = self._wills.get(owner)
            if will is None or will.life != life:
                return
            author = author_of_will(owner)
            operations = self._operations(will)
            log.warning("%s is gone: its last will makes %d changes", owner, len(operations))
            try:
                self._model.transact(operations, author)
            except SkirosError as error:
                log.warning("%s: %s; what can be done is done", author, error)
                for operation in operations:
                    self._try(operation, author)
            try:
                self.take_back(owner)
            except SkirosError as error:
                log.error("%s stays in the journal: %s", author, error)
                del self._wills[owner]

    def _try(self, operation: Operation, author: str) -> None:
        try:
            self._model.transact([operation], author)
        except SkirosError as error:
            log.error("%s: %s", author, error)

    def _operations(self, will: Will) -> list[Operation]:
        """What a will means for the scene as it is."""
        reader = self._model.reader
        removed: dict[str, Operation] = {}
        written: list[Operation] = []
        for bequest in will.bequests:
            like = Element("")
            like.setProperty(bequest.key, bequest.value)
            for element in reader.matching(like, SCENE):
                if bequest.relation:
                    for relation in reader.related(element.id, bequest.relation, "", SCENE):
                        if reader.find(relation["dst"], SCENE) is not None:
                            removed[relation["dst"]] = Remove(relation["dst"], True, bequest.below)
                if bequest.properties:
                    written.append(Patch(element.id, _changes(element, bequest.properties)))
        return [*written, *removed.values()]

    def _keep(self, wills: dict[str, Will]) -> None:
        if self._journal is not None:
            self._journal.keep(_NOTE, wills_text(wills))
        self._wills = wills


def _changes(element: Element, properties: Mapping[str, Property]) -> ElementChanges:
    return ElementChanges(
        {key: prop for key, prop in properties.items() if prop.values},
        [key for key, prop in properties.items() if not prop.values and element.hasProperty(key)],
    )
