"""A ROS master that was started anew knows no node; this one registers with it again, which rospy does not do."""

from __future__ import annotations

import logging
import threading
from typing import Any

import rosgraph
import rospy
from rospy.impl.registration import get_registration_listeners, get_service_manager, get_topic_manager

from skiros2_common.core.xmlrpc_errors import XMLRPC_ERRORS

log = logging.getLogger(__name__)

#: How often the master is looked at (s of wall time).
CHECK_PERIOD = 1.0

#: How long the end of the node waits for a master that does not answer (s).
_PATIENCE = 1.0

_NO_ANSWER = (*XMLRPC_ERRORS, rosgraph.MasterException)

_lock = threading.Lock()
_watch: MasterWatch | None = None


def watch_master() -> None:
    """Registers the publishers, subscribers and services of this process with each new master, until shutdown.

    To be called after `rospy.init_node`, from any thread; calls after the first do nothing, nor do those of a process
    that is no node. Connections that are open stay so, and nothing is published twice. The private parameters that the
    node has at the first call are set again where a new master has none; others are lost with the old one.
    """
    global _watch
    with _lock:
        if _watch is None and rospy.core.is_initialized():
            _watch = MasterWatch()
            _watch.start()
            rospy.on_shutdown(_watch.stop)


class MasterWatch(threading.Thread):
    """The thread that looks at the master. It ends with the node."""

    def __init__(self) -> None:
        super().__init__(name="master watch", daemon=True)
        self._master = rosgraph.Master(rospy.get_name())
        self._parameters: dict[str, Any] = {}
        self._ended = threading.Event()
        self._pid = 0
        self._is_away = False

    def stop(self) -> None:
        """Ends it, before rospy takes the registrations back. Waits for a call of the master that is under way."""
        self._ended.set()
        self.join(_PATIENCE)

    def run(self) -> None:
        while not self._ended.is_set():
            try:
                self._look()
                self._is_away = False
            except _NO_ANSWER as error:
                if not self._is_away:
                    log.warning("the ROS master %s does not answer: %s", self._master.master_uri, error)
                self._is_away = True
            self._ended.wait(CHECK_PERIOD)

    def _look(self) -> None:
        """Registers again if this is another master than before, or one that does not know this node.

        The process number alone does not tell: in containers it is always the same. Nor does the node's name, which a
        new master has as soon as anything is registered.
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
        log.warning("a new ROS master is there; %s has registered with it", rospy.get_name())

    def _restore_parameters(self) -> None:
        """For the node's next life, and for others that read them."""
        for key, value in self._parameters.items():
            name = f"{rospy.get_name()}/{key}"
            if not self._master.hasParam(name):
                self._master.setParam(name, value)

    def _knows_this_node(self) -> bool:
        try:
            self._master.lookupNode(rospy.get_name())
        except rosgraph.MasterError:  # it answers, but with "unknown"
            return False
        return True


def _register_all(master: Any) -> None:
    """Registers what rospy has in this process, as `rospy.impl.registration.RegManager.start` does at its start.

    Under the two locks, as there, so that nothing is registered that is being taken back.
    """
    topics, services, uri = get_topic_manager(), get_service_manager(), rospy.get_node_uri()
    with topics.lock, services.lock:
        for name, kind in topics.get_publications():
            master.registerPublisher(name, kind, uri)
        for name, kind in topics.get_subscriptions():
            publishers = master.registerSubscriber(name, kind, uri)
            for registration in get_registration_listeners().listeners:
                registration.publisher_update(name, publishers)  # connects to those that it is not connected to
        for name, service_uri in services.get_services():
            master.registerService(name, service_uri, uri)
