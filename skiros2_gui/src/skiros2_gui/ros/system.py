"""The running system over ROS: found, watched, lost and found again, without the window waiting for any of it."""

from __future__ import annotations

import logging
import threading
import time
import weakref

import rosgraph

from skiros2_gui.core.events import ConnectionChanged, ManagersChanged, NodeEnded
from skiros2_gui.core.inbox import Inbox
from skiros2_gui.core.system import MANAGER, MASTER, TASK_MANAGER, WORLD_MODEL, Manager, Part, Planner
from skiros2_gui.ros.master import master_answers
from skiros2_world_model.core.ontology import Ontology
from skiros2_world_model.core.reader import SceneReader
from skiros2_world_model.core.world_model_client import WorldModelAbstractInterface

log = logging.getLogger(__name__)

#: How often the connections are looked at (s of wall time).
PERIOD = 0.5


class RosSystem:
    """The port over ROS. Making one takes no time: a thread waits for the master, and then connects.

    :param inbox: gets what is heard.
    :param node_name: of the node that this process becomes when it is none yet; made unique.
    :param author: who makes the changes of the world model; "": the node's name.
    """

    def __init__(self, inbox: Inbox, node_name: str = "skiros_gui", author: str = "") -> None:
        self._inbox = inbox
        self._node_name = node_name
        self._author = author
        self._uri = rosgraph.get_master_uri()
        self._master = Part(MASTER, self._uri, False, time.time(), "Looking for it.")
        self._links: _Links | None = None
        self._marked = ""
        self._ended = threading.Event()
        self._watch = threading.Thread(target=self._run, name="window connections", daemon=True)
        self._watch.start()

    @property
    def parts(self) -> list[Part]:
        links = self._links
        if links is None:
            return [self._master]
        return [self._master, *links.parts()]

    @property
    def world(self) -> WorldModelAbstractInterface | None:
        return self._links.world.world if self._links is not None else None

    @property
    def scene(self) -> SceneReader | None:
        world = self._links.world.world if self._links is not None else None
        return world.known_scene if world is not None else None

    @property
    def ontology(self) -> Ontology | None:
        world = self._links.world.world if self._links is not None else None
        return world.known_ontology if world is not None else None

    @property
    def managers(self) -> dict[str, Manager]:
        return dict(self._links.managers.managers) if self._links is not None else {}

    @property
    def planner(self) -> Planner | None:
        links = self._links
        return links.task_manager if links is not None and links.task_manager.is_up else None

    def mark(self, eid: str) -> None:
        self._marked = eid
        if self._links is not None:
            self._links.markers.mark(eid)

    def close(self) -> None:
        self._ended.set()

    def _run(self) -> None:
        while not self._ended.is_set():
            is_up = master_answers()
            if is_up != self._master.is_up:
                self._set_master(is_up, "" if is_up else "Start one with roscore or roslaunch.")
            elif not is_up and self._master.text == "Looking for it.":
                self._set_master(False, "Start one with roscore or roslaunch.")
            if is_up and self._links is None:
                self._connect()
            if self._links is not None:
                self._links.check()
            self._ended.wait(PERIOD)
        if self._links is not None:
            self._links.close()  # here, for it asks the master, which may not answer

    def _connect(self) -> None:
        try:
            name = become_node(self._node_name)
            links = _Links(self._author or name, self._inbox)
        except Exception as error:  # rospy's are of many kinds, when a master goes while a node starts
            log.exception("connecting to the master %s", self._uri)
            self._set_master(True, f"This window could not register with it: {error}")
            return
        self._links = links
        self._watch_node()
        links.markers.mark(self._marked)
        self._set_master(True, "")

    def _watch_node(self) -> None:
        """Tells when this process is no node any more though the window is open."""
        import rospy

        told = weakref.WeakMethod(self._on_node_end)  # rospy keeps its hooks for good

        def hook(reason: str) -> None:
            if tell := told():
                tell(reason)

        rospy.core.add_preshutdown_hook(hook)

    def _on_node_end(self, reason: str) -> None:
        if not self._ended.is_set():
            self._inbox.put(NodeEnded(reason))

    def _set_master(self, is_up: bool, text: str) -> None:
        since = self._master.since if is_up == self._master.is_up else time.time()
        self._master = Part(MASTER, self._uri, is_up, since, text)
        self._inbox.put(ConnectionChanged())


class _Links:
    """The connections to the parts; this process is a node."""

    def __init__(self, author: str, inbox: Inbox) -> None:
        # Here, because rospy takes a quarter of a second, in which the window is drawn.
        from skiros2_gui.ros.managers import ManagersLink
        from skiros2_gui.ros.markers_link import MarkersLink
        from skiros2_gui.ros.task_manager import TaskManagerLink
        from skiros2_gui.ros.world import WorldLink

        def changed() -> None:
            inbox.put(ConnectionChanged())

        self.world = WorldLink(author, inbox.put, changed)
        self.managers = ManagersLink(author, inbox.put, lambda: inbox.put(ManagersChanged()))
        self.task_manager = TaskManagerLink(changed)
        self.markers = MarkersLink(inbox.put)

    def parts(self) -> list[Part]:
        world, tasks = self.world, self.task_manager
        return [
            Part(WORLD_MODEL, world.name, world.is_up, world.since, world.why),
            *(Part(MANAGER, name, is_up, since) for name, is_up, since in self.managers.states()),
            Part(TASK_MANAGER, tasks.name, tasks.is_up, tasks.since),
        ]

    def check(self) -> None:
        self.world.check()
        self.managers.check()
        self.task_manager.check()
        try:
            self.markers.check(self.world.world)
        except Exception as error:  # rospy's are of many kinds, when a master goes meanwhile; tried again soon
            log.warning("the markers for rviz: %s", error)

    def close(self) -> None:
        self.world.close()
        self.managers.close()
        self.task_manager.close()
        self.markers.close()


def become_node(name: str) -> str:
    """Makes this process a node, if it is none yet; any thread. Returns the node's name."""
    import rospy

    from skiros2_common.ros.inbound_connections import handshake_in_threads
    from skiros2_common.ros.master_watch import watch_master
    from skiros2_common.ros.node import bridge_logging

    if not rospy.core.is_initialized():
        rospy.init_node(name, anonymous=True, disable_signals=True)
        handshake_in_threads()
        bridge_logging()
    watch_master()
    return str(rospy.get_name())
