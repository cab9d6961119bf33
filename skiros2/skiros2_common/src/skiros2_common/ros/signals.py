"""Signals over ROS: subscribes to a topic while a condition needs it, with the type that the master knows."""

from __future__ import annotations

import functools
import logging
import threading
import time
from typing import Any

import rosgraph
import roslib.message
import rospy

from skiros2_common.command_line.master import XMLRPC_ERRORS
from skiros2_common.core.signals import LocalSignals, SignalTopic

log = logging.getLogger(__name__)

#: How long a topic without readers stays subscribed (s): the next skill usually needs it again.
LINGER = 1.0

#: Period of queries to the master for the types of topics that nobody publishes yet (s).
POLL_PERIOD = 0.05

_ERRORS = (*XMLRPC_ERRORS, rosgraph.MasterException, rospy.ROSException)


class RosSignals(LocalSignals):
    """A `SignalSource` of topics. Needs an initialised node; `close` ends it.

    Values are read in the threads of the connections, one for each publisher. A thread of its own subscribes and
    unsubscribes, because that calls the master. Values arrive by the monotonic clock, or by simulated time if the node
    uses it.
    """

    def __init__(self) -> None:
        super().__init__()
        self._subscribers: dict[str, Any] = {}
        self._master = rosgraph.Master(rospy.get_name())
        self._is_closed = False
        self._unusable: dict[str, str] = {}  # topic -> its type, which is not installed
        self._thread = threading.Thread(target=self._run, name="signals", daemon=True)
        self._thread.start()

    def now(self) -> float:
        return time.monotonic() if rospy.rostime.is_wallclock() else float(rospy.get_time())

    def full_name(self, topic: str) -> str:
        return str(rospy.resolve_name(topic))

    def close(self) -> None:
        """Ends all subscriptions."""
        with self._lock:
            self._is_closed = True
            self._lock.notify_all()
        self._thread.join()

    # -- the subscribing thread ----------------------------------------------------------------------------------

    def _run(self) -> None:
        while True:
            with self._lock:
                if self._is_closed:
                    break
                now = time.monotonic()
                wanted = {n: t for n, t in self._topics.items() if t.readers and n not in self._subscribers}
                over = [n for n, t in self._topics.items() if not t.readers and now >= t.released_at + LINGER]
                for name in over:
                    del self._topics[name]
                unwanted = [self._subscribers.pop(name) for name in over if name in self._subscribers]
                if not wanted and not unwanted:
                    ends = [t.released_at + LINGER for t in self._topics.values() if not t.readers]
                    self._lock.wait(min(ends) - now if ends else None)
                    continue
            for subscriber in unwanted:
                subscriber.unregister()
            if wanted and not self._subscribe_to(wanted):
                with self._lock:
                    self._lock.wait_for(lambda: self._is_closed, POLL_PERIOD)
        for subscriber in self._subscribers.values():
            subscriber.unregister()

    def _subscribe_to(self, wanted: dict[str, SignalTopic]) -> bool:
        """Subscribes to the topics whose types are known. Returns whether these are all."""
        try:
            self._subscribe_to_known(wanted, dict(self._master.getTopicTypes()))
        except _ERRORS as error:
            log.debug("the master does not answer: %s", error)
        return wanted.keys() <= self._subscribers.keys()

    def _subscribe_to_known(self, wanted: dict[str, SignalTopic], types: dict[str, str]) -> None:
        for name, topic in wanted.items():
            message_class = self._message_class(name, types.get(name, "*"))
            if message_class is not None:
                receive = functools.partial(self.deliver, topic)
                self._subscribers[name] = rospy.Subscriber(name, message_class, receive, tcp_nodelay=True)

    def _message_class(self, topic: str, name: str) -> Any:
        """The class of a message type; None if the type is unknown or not installed."""
        if name == "*" or self._unusable.get(topic) == name:
            return None
        found = roslib.message.get_message_class(name)
        if found is None:
            self._unusable[topic] = name
            log.error("signals on %s cannot be read: the message type %s is not installed", topic, name)
        return found
