"""Reading scenes under their lock: the same for the server, in process, and for a client's replica."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence

from skiros2_common.core.errors import UnknownName
from skiros2_common.core.world_element import Element, RelationDict
from skiros2_world_model.core.ontology import Ontology
from skiros2_world_model.core.queries import branch_ids, holds_between, matching_ids, relations_between
from skiros2_world_model.core.scene import Provenance, Scene


class SceneReader:
    """Reads of scenes. Safe to use from all threads.

    :param lock: guards the scenes.
    :param scenes: the scenes of a context, all for ""; called under the lock.
    :param ontology: what the ontologies say now; called without the lock.
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
        """The element as it is now, or None."""
        with self._lock:
            for scene in self._scenes(context):
                element = scene.element(eid)
                if element is not None:
                    return element
        return None

    def refreshed(self, element: Element, context: str) -> Element | None:
        """The given element if it has not changed since it was read, else the element as it is now, or None."""
        with self._lock:
            for scene in self._scenes(context):
                record = scene.record(element.id)
                if record is not None:
                    return element if record.provenance.version == element.version else scene.element(element.id)
        return None

    def has(self, eid: str, context: str) -> bool:
        """Whether there is an element of that id."""
        with self._lock:
            return any(eid in scene for scene in self._scenes(context))

    def removal(self, eid: str, context: str) -> Provenance | None:
        """The change that removed an element; None: the element exists, or its removal is not known."""
        with self._lock:
            known = (scene.removals.get(eid) for scene in self._scenes(context))
            return next((provenance for provenance in known if provenance is not None), None)

    def matching(self, wanted: Element, context: str) -> list[Element]:
        """The elements like an abstract one."""
        ontology = self._ontology()
        with self._lock:
            return [e for s in self._scenes(context) for e in _elements(s, matching_ids(s, ontology, wanted))]

    def branch(self, eid: str, relation_filter: str, type_filter: str, context: str) -> list[Element]:
        """An element and what is under it, nearest first.

        :raises UnknownName: there is no such element.
        """
        ontology = self._ontology()
        with self._lock:
            for scene in self._scenes(context):
                if eid in scene:
                    return _elements(scene, branch_ids(scene, ontology, eid, relation_filter, type_filter))
        raise UnknownName(no_element(eid, context))

    def related(self, src: str, pred: str, dst: str, context: str) -> list[RelationDict]:
        """The relations along a predicate and those under it; an empty part matches any."""
        ontology = self._ontology()
        with self._lock:
            return [r for scene in self._scenes(context) for r in relations_between(scene, ontology, src, pred, dst)]

    def holds(self, subj: Element, pred: str, obj: Element, context: str) -> bool:
        """Whether a relation holds; a side without id stands for some element like it."""
        ontology = self._ontology()
        with self._lock:
            for scene in self._scenes(context):  # noqa: SIM110 - any() takes twice the time
                if holds_between(scene, ontology, subj, pred, obj):
                    return True
            return False


def no_element(eid: str, context: str) -> str:
    """What is said where a context has no element of an id."""
    return f"there is no element {eid!r} in context {context!r}"


def _elements(scene: Scene, ids: Sequence[str]) -> list[Element]:
    return [element for eid in ids if (element := scene.element(eid)) is not None]
