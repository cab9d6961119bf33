"""What can be read of a world model."""

from __future__ import annotations

import threading
from collections.abc import Iterator

import pyoxigraph as ox

from skiros2_common.core.errors import Refused
from skiros2_common.core.world_element import Element, RelationDict
from skiros2_world_model.core.announcer import Announcer
from skiros2_world_model.core.context_names import ONTOLOGY, SCENE
from skiros2_world_model.core.contexts import Contexts
from skiros2_world_model.core.history import History
from skiros2_world_model.core.journal import Journal
from skiros2_world_model.core.ontology import Ontology
from skiros2_world_model.core.ontology_base import OntologyBase
from skiros2_world_model.core.prefixes import is_iri
from skiros2_world_model.core.reader import SceneReader
from skiros2_world_model.core.scene import Scene
from skiros2_world_model.core.templates import template_element


class WorldModelState:
    """The state of a world model, read under its lock where a method does not take it."""

    base: OntologyBase
    lock: threading.RLock
    reader: SceneReader
    _contexts: Contexts
    _announcer: Announcer
    _journal: Journal | None

    @property
    def number(self) -> int:
        """The number of the last change."""
        return self._announcer.number

    @property
    def snapshot_id(self) -> str:
        """The name of the present state."""
        return self._announcer.snapshot_id

    @property
    def ontology(self) -> Ontology:
        """What the ontologies say now."""
        return self.base.index

    def contexts(self) -> list[str]:
        return list(self._contexts)

    def scene(self, context: str = SCENE) -> Scene:
        """The scene of a context, which is made when it is named for the first time; to be read under the lock.

        :raises WrongValue: no context can have that name.
        """
        return self._contexts.named(context).scene

    def scenes(self, context: str) -> list[Scene]:
        """The scene of a context, as `scene`, or for "" those of all contexts, to be read under the lock."""
        return [self.scene(context)] if context else self._contexts.scenes()

    def file_of(self, context: str) -> str:
        """The file that a context was last loaded from or saved to, or should have been; "" when with none."""
        return self._contexts.named(context).file

    def related(self, src: str, pred: str, dst: str) -> list[RelationDict]:
        """The relations of the scene along a predicate and its subproperties; an empty part matches any.

        Those of a subject that is not in the scene are of the context that it is in.
        """
        with self.lock:
            return self.reader.related(src, pred, dst, self._contexts.home(src) or SCENE)

    def template(self, name: str) -> Element:
        """A template as an element without id.

        :raises UnknownName: there is none.
        """
        return template_element(self.ontology, self.base.prefixes.name(name) if is_iri(name) else name)

    @property
    def history(self) -> History:
        """What was, and who changed it. To be asked without the lock: it holds up no request.

        :raises Refused: nothing is kept, as there is no journal.
        """
        if self._journal is None:
            raise Refused("the world model keeps no journal: its past is not known")
        return History(self._journal.path)

    def query(self, query: str, context: str = "", cut_prefix: bool = True) -> list[str]:
        """The rows that a SPARQL query gives, as texts.

        :param context: the one to ask; "" asks all, `ontology` the ontologies alone.
        :raises WrongValue: the query cannot be answered.
        """

        def flush() -> None:
            for name in [context] if context else self._contexts:
                if name != ONTOLOGY:
                    self._contexts.named(name).flush()

        return self.base.query(query, context, cut_prefix, flush)

    def triples(self, context: str = SCENE) -> Iterator[ox.Triple]:
        """All that a context holds now; the triples are made while they are read, which needs no lock."""
        with self.lock:
            return self._contexts.named(context).triples()
