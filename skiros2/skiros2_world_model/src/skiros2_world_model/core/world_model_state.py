"""The read access to a world model."""

from __future__ import annotations

import threading
from collections.abc import Iterator

import pyoxigraph as ox

from skiros2_common.core.errors import Refused
from skiros2_common.core.world_element import Element, RelationDict
from skiros2_world_model.core.change_notifier import ChangeNotifier
from skiros2_world_model.core.changes import ONTOLOGY, SCENE
from skiros2_world_model.core.context import Contexts
from skiros2_world_model.core.history import History
from skiros2_world_model.core.journal import Journal
from skiros2_world_model.core.knowledge_base import KnowledgeBase
from skiros2_world_model.core.ontology import Ontology
from skiros2_world_model.core.prefixes import is_iri
from skiros2_world_model.core.reader import SceneReader
from skiros2_world_model.core.scene import Scene
from skiros2_world_model.core.templates import template_element


class WorldModelState:
    """The read access to a world model. Hold the lock for members that do not take it themselves."""

    knowledge_base: KnowledgeBase
    lock: threading.RLock
    reader: SceneReader
    _contexts: Contexts
    _notifier: ChangeNotifier
    _journal: Journal | None

    @property
    def number(self) -> int:
        """The number of the last change."""
        return self._notifier.number

    @property
    def snapshot_id(self) -> str:
        """The name of the current state."""
        return self._notifier.snapshot_id

    @property
    def ontology(self) -> Ontology:
        """The index of the current ontologies."""
        return self.knowledge_base.index

    def contexts(self) -> list[str]:
        return list(self._contexts)

    def scene(self, context: str = SCENE) -> Scene:
        """The scene of a context, which is created when it does not exist. Read it under the lock.

        :raises WrongValue: the name is invalid.
        """
        return self._contexts.named(context).scene

    def scenes(self, context: str) -> list[Scene]:
        """The scene of a context, or for "" the scenes of all contexts. Read them under the lock."""
        return [self.scene(context)] if context else self._contexts.scenes()

    def file_of(self, context: str) -> str:
        """The file that a context was last loaded from or saved to (successfully or not); "" when there is none."""
        return self._contexts.named(context).file

    def related(self, src: str, pred: str, dst: str) -> list[RelationDict]:
        """The relations along a predicate and its subproperties; an empty part matches any.

        Searches the context of the subject, or the scene when no subject is given.
        """
        with self.lock:
            return self.reader.related(src, pred, dst, self._contexts.home(src) or SCENE)

    def template(self, name: str) -> Element:
        """Returns a template as an element without id.

        :raises UnknownName: it does not exist.
        """
        return template_element(self.ontology, self.knowledge_base.prefixes.name(name) if is_iri(name) else name)

    @property
    def history(self) -> History:
        """Access to past states and changes. Use it without the lock, so that no request waits for it.

        :raises Refused: the world model has no journal.
        """
        if self._journal is None:
            raise Refused("the world model has no journal, so its history is unknown")
        return History(self._journal.path)

    def query(self, query: str, context: str = "", cut_prefix: bool = True) -> list[str]:
        """Answers a SPARQL query with a text for each row.

        :param context: the context to query; "": all, `ontology`: only the ontologies.
        :raises WrongValue: the query cannot be answered.
        """

        def flush() -> None:
            for name in [context] if context else self._contexts:
                if name != ONTOLOGY:
                    self._contexts.named(name).flush()

        return self.knowledge_base.query(query, context, cut_prefix, flush)

    def triples(self, context: str = SCENE) -> Iterator[ox.Triple]:
        """The triples of a context in its current state, generated lazily. Iterating needs no lock."""
        with self.lock:
            return self._contexts.named(context).triples()
