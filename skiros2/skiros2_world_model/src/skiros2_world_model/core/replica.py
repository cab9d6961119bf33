"""A client's copy of the scene. It starts from a snapshot and follows the published changes."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from skiros2_common.core.changeset import UNKNOWN, ChangeSet
from skiros2_common.core.operations import REMOVE, REMOVE_RECURSIVE, RESET, Change
from skiros2_common.core.revision import local_revision
from skiros2_common.core.world_element import Element
from skiros2_world_model.core.scene import ChangeInfo, ElementRecord, Scene


def apply_change(scene: Scene, change: Change) -> ChangeSet:
    """Applies a change to a scene and returns what it changed. It must be the next change; nothing is checked.

    A reset replaces the scene with its elements; a reset without elements empties it.
    """
    scene.begin()
    if change.action == RESET:
        for record in list(scene):
            scene.drop(record.id)
    if change.action in (REMOVE, REMOVE_RECURSIVE):
        for element in change.elements:
            if element.id in scene:
                scene.drop(element.id)
    else:
        for element in change.elements:
            scene.put(ElementRecord(element.id, element.type, element.label, element.property_view))
        for element in change.elements:
            _set_relations(scene, element, change.action == RESET)
    for relation in change.relations:
        ends = relation["src"], relation["type"], relation["dst"]
        if change.action in (REMOVE, REMOVE_RECURSIVE):
            scene.unrelate(*ends)
        else:
            scene.relate(*ends)
    return scene.commit(ChangeInfo(change.number, change.stamp, change.author))


def scene_of(elements: Sequence[Element], change_info: ChangeInfo = UNKNOWN) -> Scene:
    """A scene of elements with at least their outgoing relations."""
    scene = Scene()
    for element in elements:
        scene.put(ElementRecord(element.id, element.type, element.label, element.property_view, change_info))
    for element in elements:
        for relation in element.relation_view:
            if relation["src"] == "-1":
                scene.relate(element.id, relation["type"], relation["dst"])
    return scene


def _set_relations(scene: Scene, element: Element, is_reset: bool) -> None:
    """Replaces the relations of an element; in a reset, only adds its outgoing relations."""
    eid = element.id
    wanted = dict.fromkeys(
        (eid if r["src"] == "-1" else r["src"], r["type"], eid if r["dst"] == "-1" else r["dst"])
        for r in element.relation_view
    )
    if not is_reset:
        for relation in [*scene.relations(eid), *scene.relations(dst=eid)]:
            if relation not in wanted:
                scene.unrelate(*relation)
    for relation in wanted:
        scene.relate(*relation)


@dataclass
class Snapshot:
    """A whole scene.

    :param snapshot_id, number: the name of the state and the number of its last change.
    :param elements: each with at least its outgoing relations.
    """

    snapshot_id: str
    number: int
    elements: Sequence[Element]


class Replica:
    """A copy of the scene. Thread-safe.

    It receives the changes in two ways: all changes in the order in which the server publishes them (`follow`), and
    the changes of this client with the answers to its requests (`include`). A change that does not continue the known
    state waits for its predecessors. After a gap in the published changes, the next read fetches the scene again.

    :param fetch: fetches a snapshot from the server. Called without the lock.
    :param timeout: how long `include` and `reach` wait for earlier changes (s).
    """

    def __init__(self, fetch: Callable[[], Snapshot], timeout: float = 2.0) -> None:
        self.lock = threading.RLock()
        self._fetch = fetch
        self._timeout = timeout
        self._scene = Scene()
        self._snapshot_id: str | None = None
        self._number = 0
        self._waiting: dict[str, Change] = {}
        self._version = 0
        self._reset: ChangeInfo | None = None  # the change that replaced the scene, until the new one is fetched
        self._progress = threading.Condition(self.lock)
        self._fetching = threading.Lock()
        self._is_fetching = False

    @property
    def version(self) -> int:
        """A counter that increases with every possible change."""
        return self._version

    @property
    def snapshot_id(self) -> str:
        """The name of the known state; "" when the scene is unknown. Read it and the scene under the lock."""
        return self._snapshot_id or ""

    def scene(self) -> Scene:
        """The scene. Call `refresh` first, then read the scene under the lock.

        It may be older than the server's scene, but it is always a consistent state.
        """
        return self._scene

    def refresh(self) -> None:
        """Fetches the scene if it is unknown. Called before each read; blocks for the server if it fetches."""
        if self._snapshot_id is not None:
            return
        with self._fetching:
            while self._snapshot_id is None:
                with self.lock:
                    self._waiting = {}
                    self._is_fetching = True
                try:
                    self._load(self._fetch())
                finally:
                    self._is_fetching = False

    def follow(self, change: Change) -> None:
        """Takes a published change. Called in the order of publication."""
        with self.lock:
            self._take(change)
            if self._snapshot_id is not None and self._number < change.number:
                self._forget()  # its predecessors were missed

    def include(self, changes: Sequence[Change]) -> None:
        """Takes the changes of a request of this client and waits until they can be read."""
        if not changes:
            return
        with self.lock:
            for change in changes:
                self._take(change)
            last = changes[-1]
            arrived = self._progress.wait_for(
                lambda: self._snapshot_id is None or self._number >= last.number, self._timeout
            )
            if not arrived:
                self._forget()

    def reach(self, snapshot_id: str) -> None:
        """Waits until the scene is at least as new as a state of the server, or fetches it after the timeout."""
        session, _, number = snapshot_id.rpartition("-")
        with self.lock:
            known = self._snapshot_id
            if known is None:
                return  # the scene will be fetched, and is newer then
            if _session_of(known) != session or not self._progress.wait_for(
                lambda: self._snapshot_id is None or self._number >= int(number), self._timeout
            ):
                self._forget()

    # -- under the lock ----------------------------------------------------------------------------------------

    def _take(self, change: Change) -> None:
        if self._snapshot_id is None:
            if not self._is_fetching:
                return  # the scene will be fetched with this change
        elif _session(change) != _session_of(self._snapshot_id):
            self._forget()
            return
        elif change.number <= self._number:
            return
        self._waiting[change.prev_snapshot_id] = change
        self._catch_up()

    def _catch_up(self) -> None:
        """Applies the waiting changes that continue the known state."""
        while self._snapshot_id is not None and self._snapshot_id in self._waiting:
            change = self._waiting.pop(self._snapshot_id)
            if change.action == RESET:
                self._reset = ChangeInfo(change.number, change.stamp, change.author)
                self._forget()
                return
            apply_change(self._scene, change)
            self._snapshot_id = change.snapshot_id
            self._number = change.number
            self._count()
        self._progress.notify_all()

    def _forget(self) -> None:
        """Marks the scene as unknown."""
        self._snapshot_id = None
        self._count()
        self._progress.notify_all()

    def _count(self) -> None:
        self._version += 1
        local_revision.advance()

    def _load(self, snapshot: Snapshot) -> None:
        change_info = ChangeInfo(snapshot.number, 0.0, "")
        scene = scene_of(snapshot.elements, change_info)
        with self.lock:
            scene.inherit_removals(self._scene, self._reset)
            self._reset = None
            self._scene = scene
            self._snapshot_id = snapshot.snapshot_id
            self._number = snapshot.number
            self._count()
            session = _session_of(snapshot.snapshot_id)
            self._waiting = {
                before: change
                for before, change in self._waiting.items()
                if _session(change) == session and change.number > snapshot.number
            }
            self._catch_up()
            if self._waiting:
                self._forget()  # some changes were published before this client subscribed


def _session(change: Change) -> str:
    return _session_of(change.snapshot_id)


def _session_of(snapshot_id: str) -> str:
    return snapshot_id.rpartition("-")[0]
