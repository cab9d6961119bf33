"""Registers this node again after a restart of the ROS master, which rospy does not do."""

from __future__ import annotations

import logging
import threading
from typing import Any

import rosgraph
import rospy
from rospy.impl.registration import get_registration_listeners, get_service_manager, get_topic_manager

from skiros2_common.command_line.master import XMLRPC_ERRORS

log = logging.getLogger(__name__)

#: The period of the checks (s of wall time).
CHECK_PERIOD = 1.0

#: How long the shutdown waits for a call of the master (s).
_STOP_TIMEOUT = 1.0

_ERRORS = (*XMLRPC_ERRORS, rosgraph.MasterException)

_lock = threading.Lock()
_watch: MasterWatch | None = None


def watch_master() -> None:
    """Registers the publishers, subscribers and services of this process with each new master, until shutdown.

    Call it after `rospy.init_node`. Thread-safe; further calls, and calls in a process that is not a node, do nothing.
    Open connections stay open. If the new master lacks the node's private parameters, they are restored as of the first
    call; other parameters are lost.
    """
    global _watch
    with _lock:
        if _watch is None and rospy.core.is_initialized():
            _watch = MasterWatch()
            _watch.start()
            rospy.on_shutdown(_watch.stop)


class MasterWatch(threading.Thread):
    """The thread that checks the master until the node ends."""

    def __init__(self) -> None:
        super().__init__(name="master watch", daemon=True)
        self._master = rosgraph.Master(rospy.get_name())
        self._parameters: dict[str, Any] = {}
        self._ended = threading.Event()
        self._pid = 0
        self._is_unreachable = False

    def stop(self) -> None:
        """Ends the thread before rospy unregisters the node. Waits for a call in progress."""
        self._ended.set()
        self.join(_STOP_TIMEOUT)

    def run(self) -> None:
        while not self._ended.is_set():
            try:
                self._check()
                self._is_unreachable = False
            except _ERRORS as error:
                if not self._is_unreachable:
                    log.warning("the ROS master %s does not answer: %s", self._master.master_uri, error)
                self._is_unreachable = True
            self._ended.wait(CHECK_PERIOD)

    def _check(self) -> None:
        """Registers again if the master's process has changed or the master does not know this node.

        Both checks are needed: in containers, the process id is always the same, and a new master knows the node's name
        as soon as anything of it is registered.
        """
        pid = self._master.getPid()
        if self._pid in (0, pid) and self._knows_this_node():
            if self._pid == 0:
                self._parameters = rospy.get_param(rospy.get_name(), {})
            self._pid = pid
            return
        self._restore_parameters()
        _register_all(self._master)
        self._pid = pid
        log.warning("%s has registered with a restarted ROS master", rospy.get_name())

    def _restore_parameters(self) -> None:
        """Sets the private parameters for the node's next start and for other readers."""
        for key, value in self._parameters.items():
            name = f"{rospy.get_name()}/{key}"
            if not self._master.hasParam(name):
                self._master.setParam(name, value)

    def _knows_this_node(self) -> bool:
        try:
            self._master.lookupNode(rospy.get_name())
        except rosgraph.MasterError:  # an answer, with the code for an unknown node
            return False
        return True


def _register_all(master: Any) -> None:
    """Registers all topics and services of this process, like `rospy.impl.registration.RegManager.start`.

    It holds both locks, so that a concurrent unregistration is not undone.
    """
    topics, services, uri = get_topic_manager(), get_service_manager(), rospy.get_node_uri()
    with topics.lock, services.lock:
        for name, kind in topics.get_publications():
            master.registerPublisher(name, kind, uri)
        for name, kind in topics.get_subscriptions():
            publishers = master.registerSubscriber(name, kind, uri)
            for registration in get_registration_listeners().listeners:
                registration.publisher_update(name, publishers)  # connects to new ones
        for name, service_uri in services.get_services():
            master.registerService(name, service_uri, uri)
