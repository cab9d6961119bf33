"""Records a run from a running system, from before its nodes are there."""

from __future__ import annotations

import json
import logging
import queue
import struct
import threading
import time
from collections.abc import Iterable, Mapping
from io import BytesIO
from typing import Any

import rosgraph
import rospy

from skiros2_bags.core.bag_writer import BagWriter
from skiros2_bags.core.errors import BagError
from skiros2_bags.core.selection import PARAMETERS, Selection, action_topics, is_graph_name
from skiros2_bags.ros.scene_start import SceneStart, actions_named
from skiros2_msgs import msg as msgs

log = logging.getLogger(__name__)

#: How often the master is asked for topics that are new (s). An action server tells clients of itself after 0.2 s.
LOOK_PERIOD = 0.1

#: How often parameters are read (s), and what is written given to the disk.
SLOW_PERIOD = 2.0

#: Bytes that a connection reads at once; large messages take many turns otherwise.
_BUFFER = 1 << 20

_DESCRIPTION = "/skill_managers/description"
_STRING_HEADER = {
    "type": "std_msgs/String",
    "md5sum": "992ce8a1687cec8c8bd883ec73ca41d1",
    "message_definition": "string data\n",
    "latching": "1",
}

_Item = tuple[str, Mapping[str, str], int, bytes]


class Recorder:
    """Subscribes, and writes what comes, from its creation until `close`. Needs an initialised node.

    Messages are taken by the threads of their connections, and written by one thread in the order in which they came;
    their times are those of their arrival, by the wall clock, so that nothing waits for simulated time to begin.

    :param writer: the bag; closed by `close`.
    :param robots: the names of skill managers to listen to before they are there; others are found.
    """

    def __init__(self, writer: BagWriter, selection: Selection, robots: Iterable[str] = ()) -> None:
        self.problem = ""  #: why nothing is written any more
        self._writer = writer
        self._selection = selection
        self._queue: queue.Queue[_Item | None] = queue.Queue()
        self._arrival = threading.Lock()
        self._subscribing = threading.Lock()
        self._subscribers: dict[str, Any] = {}
        self._scenes: dict[str, SceneStart] = {}
        self._parameters = ""
        self._ended = threading.Event()
        self._master = rosgraph.Master(rospy.get_name())
        self._listen(selection.named(robots))
        self._threads = [
            threading.Thread(target=work, name=name, daemon=True)
            for work, name in ((self._write, "bag writer"), (self._look, "topic finder"))
        ]
        for thread in self._threads:
            thread.start()

    def close(self) -> None:
        """Ends the recording: what has come is written, the bag is whole.

        :raises BagError: the disk did not take it.
        """
        self._ended.set()
        self._threads[1].join()
        for subscriber in self._subscribers.values():
            subscriber.unregister()
        self._queue.put(None)
        self._threads[0].join()
        if self.problem:
            raise BagError(self.problem)
        self._writer.close()

    # -- listening ---------------------------------------------------------------------------------------------

    def _listen(self, topics: Iterable[str]) -> None:
        with self._subscribing:
            for topic in topics:
                if topic not in self._subscribers:
                    self._subscribers[topic] = rospy.Subscriber(
                        topic, rospy.AnyMsg, self._take, topic, buff_size=_BUFFER, tcp_nodelay=True
                    )

    def _take(self, message: Any, topic: str) -> None:
        with self._arrival:  # so that times and places in the queue agree
            self._queue.put((topic, message._connection_header, time.time_ns(), message._buff))

    def _look(self) -> None:
        """Finds new topics, and reads the parameters; until the end."""
        next_slow = 0.0
        while not self._ended.wait(LOOK_PERIOD):
            try:
                self._listen(self._selection.chosen(map(tuple, self._master.getTopicTypes())))
                if time.monotonic() >= next_slow:
                    next_slow = time.monotonic() + SLOW_PERIOD
                    self._read_parameters()
            except (OSError, rosgraph.MasterException) as error:
                log.debug("the master does not answer: %s", error)
        try:
            self._read_parameters()
        except (OSError, rosgraph.MasterException) as error:
            log.debug("the master has gone before the recorder: %s", error)

    def _read_parameters(self) -> None:
        text = json.dumps(self._master.getParam("/"), sort_keys=True, default=str)
        if text != self._parameters:
            self._parameters = text
            data = text.encode()
            header = {**_STRING_HEADER, "callerid": rospy.get_name()}
            with self._arrival:
                self._queue.put((PARAMETERS, header, time.time_ns(), struct.pack("<I", len(data)) + data))

    # -- writing -----------------------------------------------------------------------------------------------

    def _write(self) -> None:
        """Writes what has come, until the end."""
        try:
            self._write_all()
        except Exception as error:
            self.problem = str(error) if isinstance(error, BagError) else f"{self._writer.path}: {error!r}"
            log.exception("the recording ends here")
            rospy.signal_shutdown(self.problem)

    def _write_all(self) -> None:
        next_flush = time.monotonic() + SLOW_PERIOD
        while True:
            try:
                item = self._queue.get(timeout=SLOW_PERIOD)
                if item is None:
                    return
                self._write_one(item)
            except queue.Empty:
                pass
            if time.monotonic() >= next_flush:
                next_flush = time.monotonic() + SLOW_PERIOD
                self._writer.flush()

    def _write_one(self, item: _Item) -> None:
        topic, header, stamp, data = item
        if header["md5sum"] == msgs.WmMonitor._md5sum:
            for change in self._scenes.setdefault(topic, SceneStart(topic)).following(_change(data)):
                self._listen(action_topics(actions_named(change)))
                self._writer.write(topic, header, stamp, _serialized(change))
            return
        if topic == _DESCRIPTION:
            self._listen_to_manager(data)
        self._writer.write(topic, header, stamp, data)

    def _listen_to_manager(self, data: bytes) -> None:
        """Listens to a manager that has named itself."""
        name = data[4:].decode("utf-8", "replace")
        if is_graph_name(name):
            self._listen(self._selection.named([name]))
        else:
            log.warning("%r on %s is no name of a skill manager", name, _DESCRIPTION)


def _change(data: bytes) -> Any:
    return msgs.WmMonitor().deserialize(data)


def _serialized(message: Any) -> bytes:
    buffer = BytesIO()
    message.serialize(buffer)
    return buffer.getvalue()
