"""Reads scenes under their lock: for the server, for the adapter in process and for the replica of a client."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence

from skiros2_common.core.errors import UnknownName
from skiros2_common.core.world_element import Element, RelationDict
from skiros2_world_model.core.ontology import Ontology
from skiros2_world_model.core.queries import branch_ids, holds_between, matching_ids, relations_between
from skiros2_world_model.core.scene import Provenance, Scene


class SceneReader:
    """Reads the scenes of contexts. Thread-safe.

    :param lock: guards the scenes.
    :param scenes: returns the scenes of a context; "": of all contexts. Called under the lock.
    :param ontology: returns the index of the current ontologies. Called without the lock.
    """

    def __init__(
        self,
        lock: threading.RLock,
        scenes: Callable[[str], Sequence[Scene]],
        ontology: Callable[[], Ontology],
    ) -> None:
        self._lock = lock
        self._scenes = scenes
        self._ontology = ontology

    def find(self, eid: str, context: str) -> Element | None:
        """Returns the current state of an element, or None when it does not exist."""
        with self._lock:
            for scene in self._scenes(context):
                element = scene.element(eid)
                if element is not None:
                    return element
        return None

    def refreshed(self, element: Element, context: str) -> Element | None:
        """Returns the given element if it has not changed since it was read, else the result of `find`."""
        with self._lock:
            for scene in self._scenes(context):
                record = scene.record(element.id)
                if record is not None:
                    return element if record.provenance.version == element.version else scene.element(element.id)
        return None

    def has(self, eid: str, context: str) -> bool:
        """Whether an element exists."""
        with self._lock:
            return any(eid in scene for scene in self._scenes(context))

    def removal(self, eid: str, context: str) -> Provenance | None:
        """The change that removed an element; None: the element exists, or its removal is unknown."""
        with self._lock:
            known = (scene.removals.get(eid) for scene in self._scenes(context))
            return next((provenance for provenance in known if provenance is not None), None)

    def matching(self, wanted: Element, context: str) -> list[Element]:
        """The elements that match an abstract element."""
        ontology = self._ontology()
        with self._lock:
            return [e for s in self._scenes(context) for e in _elements(s, matching_ids(s, ontology, wanted))]

    def branch(self, eid: str, relation_filter: str, type_filter: str, context: str) -> list[Element]:
        """An element and its descendants, nearest first; arguments as for `branch_ids`.

        :raises UnknownName: the element does not exist.
        """
        ontology = self._ontology()
        with self._lock:
            for scene in self._scenes(context):
                if eid in scene:
                    return _elements(scene, branch_ids(scene, ontology, eid, relation_filter, type_filter))
        raise UnknownName(no_element(eid, context))

    def related(self, src: str, pred: str, dst: str, context: str) -> list[RelationDict]:
        """The relations along a predicate and its subproperties; an empty part matches any."""
        ontology = self._ontology()
        with self._lock:
            return [r for scene in self._scenes(context) for r in relations_between(scene, ontology, src, pred, dst)]

    def holds(self, subj: Element, pred: str, obj: Element, context: str) -> bool:
        """Whether a relation holds; a side without id stands for any matching element."""
        ontology = self._ontology()
        with self._lock:
            for scene in self._scenes(context):  # noqa: SIM110 - any() takes twice the time
                if holds_between(scene, ontology, subj, pred, obj):
                    return True
            return False


def no_element(eid: str, context: str) -> str:
    """The error text for an element that a context does not have."""
    return f"there is no element {eid!r} in context {context!r}"


def _elements(scene: Scene, ids: Sequence[str]) -> list[Element]:
    return [element for eid in ids if (element := scene.element(eid)) is not None]
