"""The connection to the world model."""

from __future__ import annotations

from collections.abc import Callable

from skiros2_common.core.operations import RESET, Change
from skiros2_gui.app.events import WorldChanged
from skiros2_live.core.patch import Connection
from skiros2_live.ros.world_model_watch import WorldModelWatch
from skiros2_world_model.core.ontology import Ontology
from skiros2_world_model.core.queries import SceneReader
from skiros2_world_model.core.replica import Snapshot
from skiros2_world_model.core.replica_transport import ReplicaTransport
from skiros2_world_model.core.world_model_client import WorldModelClient
from skiros2_world_model.ros.ros_transport import SERVER, RosTransport
from skiros2_world_model.ros.world_model_interface import load_reasoners


class _WatchedTransport(RosTransport):
    """A transport that reports each fetch and remembers the last ontologies.

    :param on_fetch: called, in any thread, when the scene or the ontologies were fetched.
    """

    def __init__(self, author: str, on_fetch: Callable[[], None]) -> None:
        super().__init__(author)
        self._on_fetch = on_fetch
        self._last_ontology: Ontology | None = None
        self.scenes_fetched = 0

    @property
    def known_ontology(self) -> Ontology:
        """The ontologies as fetched last; fetches them if they never were."""
        if self._last_ontology is None:
            return self.ontology
        return self._last_ontology

    def fetch(self) -> Snapshot:
        snapshot = super().fetch()
        self.scenes_fetched += 1
        self._on_fetch()
        return snapshot

    def fetch_ontology(self) -> Ontology:
        self._last_ontology = super().fetch_ontology()
        self._on_fetch()
        return self._last_ontology


class CachedWorldModel(WorldModelClient):
    """A client of a world model with a replica whose last state can be read without blocking.

    :param on_fetch: called, in any thread, when the scene or the ontologies were fetched.
    """

    def __init__(self, author_name: str, on_fetch: Callable[[], None]) -> None:
        self.remote = remote = _WatchedTransport(author_name, on_fetch)
        transport = ReplicaTransport(remote)
        super().__init__(transport)
        replica = transport.replica
        self.known_scene = SceneReader(replica.lock, lambda _: [replica.scene()], lambda: remote.known_ontology)
        remote.follow()
        load_reasoners(SERVER)


class WorldModelConnection:
    """Follows the world model node `wm` in this node's namespace.

    :param on_event: called with changes, in any thread.
    :param report: called with each new status of the connection, in any thread; must not block.
    """

    def __init__(
        self, author: str, on_event: Callable[[WorldChanged], None], report: Callable[[Connection], None]
    ) -> None:
        self.world: CachedWorldModel | None = None
        self._author = author
        self._on_event = on_event
        self._known: tuple[int, Ontology | None] = (-1, None)  # the scene and the ontologies that were reported
        self._watch = WorldModelWatch(report, self._update)
        #: Detects that it does not answer. To be called periodically by another thread.
        self.check = self._watch.check
        self._watch.start()

    def close(self) -> None:
        """Disconnects. Does not block."""
        self._watch.close()
        if self.world is not None:
            self.world.remove_listener(self._on_change)
            self.world.remote.unfollow()

    def _update(self) -> None:
        """Brings the replica up to date, and reports what was fetched.

        :raises WmException: the world model does not answer.
        """
        if self.world is None:
            world = CachedWorldModel(self._author, self._watch.wake)
            world.revisions()
            world.add_listener(self._on_change)
            self.world = world
        self.world.catch_up()
        self.world.revisions()
        remote = self.world.remote
        scene, ontology = self._known
        self._known = (remote.scenes_fetched, remote.known_ontology)
        event = WorldChanged((), self._known[0] != scene, self._known[1] is not ontology)
        if event.is_reset or event.ontology:
            self._on_event(event)

    def _on_change(self, change: Change) -> None:
        """Reports a change that the replica has applied. Called in the thread of the subscription."""
        if change.action == RESET or not (change.elements or change.relations):
            self._watch.wake()  # its thread fetches the scene or the ontologies
        self._on_event(WorldChanged((change,)))  # also without content: the next change continues it
