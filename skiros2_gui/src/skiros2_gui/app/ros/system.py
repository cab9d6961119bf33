"""The running system over ROS. Connects, detects failures and reconnects in a thread of its own."""

from __future__ import annotations

import http.client
import logging
import threading
import time
import weakref
import xmlrpc.client
from typing import Any

import rosgraph

from skiros2_common.command_line.master import XMLRPC_ERRORS
from skiros2_common.core.signals import SignalSource
from skiros2_gui.app.events import EventQueue, NodeShutdown
from skiros2_gui.app.system import Manager, Planner, Simulator
from skiros2_live.core.patch import MASTER, Connection
from skiros2_world_model.core.queries import SceneReader
from skiros2_world_model.core.world_model_client import WorldModelClient

#: s.
TIMEOUT = 2.0

#: The parameter with the address of the gateway.
GATEWAY = "gateway/address"


class _Transport(xmlrpc.client.Transport):
    """An XML-RPC transport with a timeout."""

    def make_connection(self, host: Any) -> http.client.HTTPConnection:
        connection = super().make_connection(host)
        connection.timeout = TIMEOUT
        return connection


def master_answers() -> bool:
    """Returns whether the master at `ROS_MASTER_URI` answers within `TIMEOUT` (name resolution not included)."""
    try:
        with xmlrpc.client.ServerProxy(rosgraph.get_master_uri(), transport=_Transport()) as master:
            return bool(master.getPid("/skiros_gui")[0] == 1)
    except (*XMLRPC_ERRORS, TypeError, IndexError):  # the last two: not a master
        return False


log = logging.getLogger(__name__)

#: The period of connection checks (s of wall time).
PERIOD = 0.5


class RosSystem:
    """Implements `app.system.System`. The constructor does not block.

    :param event_queue: gets the events.
    :param node_name: the name of the node to create if this process has none; made unique.
    :param author: the author of changes of the world model; "" for the node name.
    """

    def __init__(self, event_queue: EventQueue, node_name: str = "skiros_gui", author: str = "") -> None:
        self._event_queue = event_queue
        self._node_name = node_name
        self._author = author
        self._master = Connection(MASTER, rosgraph.get_master_uri(), False, time.time(), "Connecting.")
        event_queue.put(self._master)
        self._connections: _Connections | None = None
        self._movable = ""
        self._ended = threading.Event()
        self._watch = threading.Thread(target=self._run, name="window connections", daemon=True)
        self._watch.start()

    @property
    def world(self) -> WorldModelClient | None:
        return self._connections.world.world if self._connections is not None else None

    @property
    def scene(self) -> SceneReader | None:
        world = self._connections.world.world if self._connections is not None else None
        return world.known_scene if world is not None else None

    @property
    def managers(self) -> dict[str, Manager]:
        return dict(self._connections.managers.managers) if self._connections is not None else {}

    @property
    def planner(self) -> Planner | None:
        manager = self._connections.task_manager if self._connections is not None else None
        return manager if manager is not None and manager.connection.is_up else None

    @property
    def signals(self) -> SignalSource | None:
        return self._connections.signals if self._connections is not None else None

    @property
    def simulator(self) -> Simulator | None:
        return self._connections.simulator if self._connections is not None else None

    def set_movable(self, eid: str) -> None:
        self._movable = eid
        if self._connections is not None:
            self._connections.markers.set_movable(eid)

    def gateway_address(self) -> str:
        if not self._master.is_up:
            return ""
        try:
            name = rosgraph.names.ns_join(rosgraph.names.get_ros_namespace(), GATEWAY)
            return str(rosgraph.Master("/skiros_gui").getParam(name))
        except (*XMLRPC_ERRORS, rosgraph.MasterException):
            return ""

    def close(self) -> None:
        self._ended.set()

    def _run(self) -> None:
        while not self._ended.is_set():
            is_up = master_answers()
            if is_up != self._master.is_up:
                self._set_master(is_up, "" if is_up else "Start one with roscore or roslaunch.")
            elif not is_up and self._master.text == "Connecting.":
                self._set_master(False, "Start one with roscore or roslaunch.")
            if is_up and self._connections is None:
                self._connect()
            if self._connections is not None:
                self._connections.check()
            self._ended.wait(PERIOD)
        if self._connections is not None:
            self._connections.close()  # in this thread, as it calls the master, which may not answer

    def _connect(self) -> None:
        try:
            name = become_node(self._node_name)
            connections = _Connections(self._author or name, self._event_queue)
        except Exception as error:  # rospy raises many types when the master dies meanwhile
            log.exception("connecting to the master %s failed", self._master.address)
            self._set_master(True, f"This window could not register with it: {error}")
            return
        self._connections = connections
        self._watch_node()
        connections.markers.set_movable(self._movable)
        self._set_master(True, "")

    def _watch_node(self) -> None:
        """Reports when ROS shuts down the node while the window is open."""
        import rospy

        method = weakref.WeakMethod(self._on_node_end)  # rospy keeps its hooks forever

        def hook(reason: str) -> None:
            if on_node_end := method():
                on_node_end(reason)

        rospy.core.add_preshutdown_hook(hook)

    def _on_node_end(self, reason: str) -> None:
        if not self._ended.is_set():
            self._event_queue.put(NodeShutdown(reason))

    def _set_master(self, is_up: bool, text: str) -> None:
        self._master = self._master.updated(is_up, text)
        self._event_queue.put(self._master)


class _Connections:
    """The connections to the parts. Needs a node."""

    def __init__(self, author: str, event_queue: EventQueue) -> None:
        # Imported here: importing rospy takes 0.25 s, and the window is drawn first.
        from skiros2_common.ros.signals import RosSignals
        from skiros2_gui.app.ros.connections import SimulatorConnection, TaskManagerConnection
        from skiros2_gui.app.ros.world import WorldModelConnection
        from skiros2_gui.view3d.ros.markers import MarkerConnection
        from skiros2_live.ros.managers import ManagerConnections

        self.world = WorldModelConnection(author, event_queue.put, event_queue.put)
        self.managers = ManagerConnections(author, event_queue.put)
        self.task_manager = TaskManagerConnection(event_queue.put, event_queue.put)
        self.markers = MarkerConnection(event_queue.put)
        self.signals = RosSignals()
        self.simulator = SimulatorConnection()

    def check(self) -> None:
        self.world.check()
        self.managers.check()
        self.task_manager.check()
        try:
            self.markers.check(self.world.world)
        except Exception as error:  # rospy raises many types when the master dies; retried in the next check
            log.warning("connecting the markers for rviz failed: %s", error)

    def close(self) -> None:
        self.world.close()
        self.managers.close()
        self.task_manager.close()
        self.markers.close()
        self.signals.close()
        self.simulator.close()


def become_node(name: str) -> str:
    """Creates the node of this process, unless it has one. Any thread. Returns the node name."""
    import rospy

    from skiros2_common.ros.master_watch import watch_master
    from skiros2_common.ros.node import bridge_logging, handshake_in_threads
    from skiros2_common.ros.topic_polls import close_polls_with_topics

    close_polls_with_topics()
    if not rospy.core.is_initialized():
        rospy.init_node(name, anonymous=True, disable_signals=True)
        handshake_in_threads()
        bridge_logging()
    watch_master()
    return str(rospy.get_name())
