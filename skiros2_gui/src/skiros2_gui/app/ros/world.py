"""The connection to the world model, kept by a thread of its own."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable

import rospy

from skiros2_common.core.errors import SkirosError
from skiros2_common.core.operations import RESET, SCENE, Change
from skiros2_gui.app.events import WorldChanged
from skiros2_live.core.patch import WORLD_MODEL, Connection
from skiros2_msgs import msg as msgs
from skiros2_msgs import srv as srvs
from skiros2_world_model.core.ontology import Ontology
from skiros2_world_model.core.queries import SceneReader
from skiros2_world_model.core.replica import Snapshot
from skiros2_world_model.core.replica_transport import ReplicaTransport
from skiros2_world_model.core.world_model_client import WorldModelClient
from skiros2_world_model.ros.ros_transport import SERVER, RosTransport
from skiros2_world_model.ros.service_pool import ServicePool
from skiros2_world_model.ros.world_model_interface import load_reasoners

log = logging.getLogger(__name__)

#: The period of the calls that check the world model, and their timeout (s).
PERIOD, TIMEOUT = 1.0, 5.0

#: Type and label of a query that matches no element: the response has the snapshot id only.
_NO_MATCH = ("skiros:Scene", "(none)")


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
        self._connection = Connection(WORLD_MODEL, rospy.resolve_name(SERVER), False, 0.0)
        self._author = author
        self._on_event = on_event
        self._report = report
        report(self._connection)
        self._server = ""  # the address of the server
        self._asked_at = 0.0  # when the pending call was made (monotonic); 0.0 without one
        self._lock = threading.Lock()
        self._ended = threading.Event()
        self._wanted = threading.Event()
        self._ping = ServicePool(f"{SERVER}/get", srvs.WmGet, 0.0)
        threading.Thread(target=self._follow, name="window world model", daemon=True).start()

    def check(self) -> None:
        """Detects that the world model does not answer. To be called periodically by another thread."""
        asked_at = self._asked_at
        if asked_at and time.monotonic() - asked_at > TIMEOUT:
            self._set(False, f"It has not answered for {TIMEOUT:g} s.")

    def close(self) -> None:
        """Disconnects. Does not block."""
        self._ended.set()
        self._wanted.set()
        if self.world is not None:
            self.world.remove_listener(self._on_change)

    def _follow(self) -> None:
        scene, ontology = -1, None
        while not self._ended.is_set():
            self._wanted.clear()
            try:
                self._asked_at = time.monotonic()
                world = self._update()
                self._asked_at = 0.0
                self._set(True, "")
                fetched, known = world.remote.scenes_fetched, world.remote.known_ontology
                event = WorldChanged((), fetched != scene, known is not ontology)
                scene, ontology = fetched, known
                if event.is_reset or event.ontology:
                    self._on_event(event)
            except SkirosError as error:
                self._asked_at = 0.0
                log.debug("the world model does not answer: %s", error)
                self._set(False, "")
            except Exception as error:  # the response cannot be read: the server may have another version
                self._asked_at = 0.0
                log.exception("reading the world model failed")
                self._set(False, f"Its response cannot be read: {type(error).__name__}: {error}")
            self._wanted.wait(PERIOD)
        self._ping.close()
        if self.world is not None:
            self.world.remote.unfollow()

    def _update(self) -> CachedWorldModel:
        """Returns the world model with an up-to-date replica.

        :raises WmException: it does not answer.
        """
        no_match = msgs.WmElement(type=_NO_MATCH[0], label=_NO_MATCH[1])
        self._ping.call(srvs.WmGetRequest(srvs.WmGetRequest.RESOLVE, SCENE, no_match, "", ""))
        if self._server not in ("", self._ping.server):
            self._set(False, "")  # it has restarted between two calls
        self._server = self._ping.server
        if self.world is None:
            world = CachedWorldModel(self._author, self._wanted.set)
            world.revisions()
            world.add_listener(self._on_change)
            self.world = world
        self.world.catch_up()
        self.world.revisions()
        return self.world

    def _on_change(self, change: Change) -> None:
        """Reports a change that the replica has applied. Called in the thread of the subscription."""
        if change.action == RESET or not (change.elements or change.relations):
            self._wanted.set()  # the connection thread fetches the scene or the ontologies
        self._on_event(WorldChanged((change,)))  # also without content: the next change continues it

    def _set(self, is_up: bool, problem: str) -> None:
        with self._lock:
            if (is_up, problem) != (self._connection.is_up, self._connection.text):
                self._connection = self._connection.updated(is_up, problem)
                self._report(self._connection)  # under the lock: in order
