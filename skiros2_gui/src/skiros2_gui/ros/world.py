"""The window's connection to the world model: found, kept up to date, lost and found again, by a thread of its own."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable

import rospy

from skiros2_common.core.errors import SkirosError
from skiros2_gui.core.events import WorldChanged
from skiros2_msgs import msg as msgs
from skiros2_msgs import srv as srvs
from skiros2_world_model.core.changes import RESET, Change
from skiros2_world_model.core.ontology import Ontology
from skiros2_world_model.core.reader import SceneReader
from skiros2_world_model.core.replica import Snapshot
from skiros2_world_model.core.scene import Scene
from skiros2_world_model.ros.ontology_interface import SERVER
from skiros2_world_model.ros.service_pool import ServicePool
from skiros2_world_model.ros.world_model_interface import WorldModelInterface

log = logging.getLogger(__name__)

#: How often the world model is asked whether it is there (s), and how long it may take to answer.
PERIOD, PATIENCE = 1.0, 5.0

#: Nothing has this label: the answer is the name of the server's state alone.
_NOTHING = ("skiros:Scene", "(none)")


class WindowWorld(WorldModelInterface):
    """A world model with a replica that can be read as it was known last, without waiting.

    :param fetched: called, in any thread, when the scene or the ontologies were fetched anew.
    """

    def __init__(self, author_name: str, fetched: Callable[[], None]) -> None:
        self._fetched = fetched
        self._known: Ontology | None = None
        self.scenes_fetched = 0
        super().__init__(author_name, make_cache=True)
        assert self._replica is not None
        self.known_scene = SceneReader(self._replica.lock, self._known_scenes, lambda: self.known_ontology)

    def close(self) -> None:
        """Follows the world model no more."""
        self._monitor.unregister()

    @property
    def known_ontology(self) -> Ontology:
        """The ontologies as they were known last; they are fetched if they never were."""
        if self._known is None:
            return self._ontology
        return self._known

    def _known_scenes(self, _: str) -> list[Scene]:
        assert self._replica is not None
        return [self._replica.scene()]

    def _fetch_scene(self) -> Snapshot:
        snapshot = super()._fetch_scene()
        self.scenes_fetched += 1
        self._fetched()
        return snapshot

    def _fetch_ontology(self) -> Ontology:
        self._known = super()._fetch_ontology()
        self._fetched()
        return self._known


class WorldLink:
    """Follows the world model node `wm` in this node's namespace.

    :param told: called with what has changed, in any thread.
    :param changed: called, in any thread, when the world model has come up or gone.
    """

    def __init__(self, author: str, told: Callable[[WorldChanged], None], changed: Callable[[], None]) -> None:
        self.world: WindowWorld | None = None
        self.is_up = False
        self.since = 0.0
        self.why = ""
        self.name = rospy.resolve_name(SERVER)
        self._author = author
        self._told = told
        self._changed = changed
        self._server = ""  # the address of the server that has answered
        self._asked_at = 0.0  # monotonic; 0.0 while nothing is asked
        self._lock = threading.Lock()
        self._ended = threading.Event()
        self._wanted = threading.Event()
        self._ping = ServicePool(f"{SERVER}/get", srvs.WmGet, 0.0)
        threading.Thread(target=self._follow, name="window world model", daemon=True).start()

    def check(self) -> None:
        """Notices that the world model does not answer any more. Called from time to time, by another thread."""
        asked_at = self._asked_at
        if asked_at and time.monotonic() - asked_at > PATIENCE:
            self._set(False, f"It has not answered for {PATIENCE:g} s.")

    def close(self) -> None:
        """Follows it no more. Does not wait."""
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
                world = self._look()
                self._asked_at = 0.0
                self._set(True, "")
                news = WorldChanged((), world.scenes_fetched != scene, world.known_ontology is not ontology)
                scene, ontology = world.scenes_fetched, world.known_ontology
                if news.is_new or news.ontology:
                    self._told(news)
            except SkirosError as error:
                self._asked_at = 0.0
                log.debug("the world model: %s", error)
                self._set(False, "")
            except Exception as error:  # what a server answers that makes no sense; it may have another version
                self._asked_at = 0.0
                log.exception("the world model")
                self._set(False, f"What it answers makes no sense: {type(error).__name__}: {error}")
            self._wanted.wait(PERIOD)
        self._ping.close()
        if self.world is not None:
            self.world.close()

    def _look(self) -> WindowWorld:
        """The world model, its scene and ontologies as they are now.

        :raises WmException: it does not answer.
        """
        nothing = msgs.WmElement(type=_NOTHING[0], label=_NOTHING[1])
        self._ping.call(srvs.WmGetRequest(srvs.WmGetRequest.RESOLVE, "scene", nothing, "", ""))
        if self._server not in ("", self._ping.server):
            self._set(False, "")  # it was started anew so fast that nobody missed it
        self._server = self._ping.server
        if self.world is None:
            world = WindowWorld(self._author, self._wanted.set)
            world.present()
            world.add_listener(self._on_change)
            self.world = world
        self.world.catch_up()
        self.world.present()
        return self.world

    def _on_change(self, change: Change) -> None:
        """Something has changed; called in the thread of the subscription, when the replica has it."""
        if change.action == RESET or not (change.elements or change.relations):
            self._wanted.set()  # it has to be fetched first
        if change.action == RESET or change.elements or change.relations:
            self._told(WorldChanged((change,)))

    def _set(self, is_up: bool, why: str) -> None:
        with self._lock:
            if (is_up, why) == (self.is_up, self.why):
                return
            if is_up != self.is_up:
                self.since = time.time()
            self.is_up, self.why = is_up, why
        self._changed()
