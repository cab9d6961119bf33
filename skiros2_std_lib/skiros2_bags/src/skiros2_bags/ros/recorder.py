"""The program `record`: records a run of a system; may start before the other nodes."""

from __future__ import annotations

import argparse
import json
import logging
import queue
import struct
import sys
import threading
import time
from collections.abc import Collection, Iterable, Mapping, Sequence
from io import BytesIO
from pathlib import Path
from typing import Any, NoReturn

import rosgraph
import rospy

from skiros2_bags.core.bag_file import BagError
from skiros2_bags.core.bag_parts import BagParts
from skiros2_bags.core.bag_writer import (
    ACTION_PROPERTIES,
    COMPRESSIONS,
    PARAMETERS,
    Selection,
    action_topics,
    is_graph_name,
    pattern,
)
from skiros2_bags.core.run import Run, check
from skiros2_common.command_line.command import INTERRUPTED, OK, REFUSED, USAGE, Parser, command_arguments
from skiros2_common.core.errors import SkirosError, WrongValue
from skiros2_common.core.operations import RESET, SCENE, snapshot_number
from skiros2_common.core.signals import TOPIC
from skiros2_common.ros.master_watch import watch_master
from skiros2_common.ros.node import bridge_logging, shutdown_in_thread, spin
from skiros2_msgs import msg as msgs
from skiros2_msgs import srv as srvs

log = logging.getLogger(__name__)

#: Period of queries to the master for new topics (s). An action server waits 0.2 s before it publishes its status.
POLL_PERIOD = 0.1

#: Period of reading the parameters and of flushing the bag (s).
FLUSH_PERIOD = 2.0

#: Receive buffer of a connection (bytes); large messages would take many reads otherwise.
_BUFFER = 1 << 20

_DESCRIPTION = "/skill_managers/description"
_STRING_HEADER = {
    "type": "std_msgs/String",
    "md5sum": "992ce8a1687cec8c8bd883ec73ca41d1",
    "message_definition": "string data\n",
    "latching": "1",
}

#: The most bytes of messages that wait for the disk; further ones are lost.
MAX_WAITING = 256_000_000

#: The default size of a part of the recording (MB).
SPLIT = 4000

_Item = tuple[str, Mapping[str, str], int, bytes]


class Recorder:
    """Records all selected topics from its creation until `close`. Needs an initialised node.

    The threads of the connections queue messages, one thread writes them in order of arrival. Message times are arrival
    times by the wall clock, so that recording does not depend on simulated time.

    :param writer: the bags; closed by `close`.
    :param robots: the names of skill managers to expect; others are found later.
    """

    def __init__(self, writer: BagParts, selection: Selection, robots: Iterable[str] = ()) -> None:
        self.problem = ""  #: why recording has stopped
        self.lost = 0  #: the number of messages for which there was no memory
        self._waiting = 0  # bytes in the queue
        self._part = writer.part
        self._writer = writer
        self._selection = selection
        self._queue: queue.Queue[_Item | None] = queue.Queue()
        self._arrival = threading.Lock()
        self._subscribing = threading.Lock()
        self._subscribers: dict[str, Any] = {}
        self._chains: dict[str, ChangeChain] = {}
        self._parameters = ""
        self._ended = threading.Event()
        self._master = rosgraph.Master(rospy.get_name())
        self._listen(selection.initial_topics(robots))
        self._threads = [
            threading.Thread(target=work, name=name, daemon=True)
            for work, name in ((self._write, "bag writer"), (self._poll_master, "topic finder"))
        ]
        for thread in self._threads:
            thread.start()

    def close(self) -> None:
        """Stops recording, writes the queued messages and completes the bag.

        :raises BagError: writing failed.
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
                        topic, rospy.AnyMsg, self._receive, topic, buff_size=_BUFFER, tcp_nodelay=True
                    )

    def _receive(self, message: Any, topic: str) -> None:
        self._put(topic, message._connection_header, message._buff)

    def _put(self, topic: str, header: Mapping[str, str], data: bytes) -> None:
        with self._arrival:  # keeps the queue ordered by time
            if self._waiting + len(data) <= MAX_WAITING:
                self._waiting += len(data)
                self._queue.put((topic, header, time.time_ns(), data))
                return
            self.lost += 1
        if self.lost == 1:
            log.error("%s MB of messages wait for the disk, which is too slow; some are lost", MAX_WAITING // 10**6)

    def _poll_master(self) -> None:
        """Subscribes to new topics and records parameter changes until the recorder is closed."""
        next_slow = 0.0
        while not self._ended.wait(POLL_PERIOD):
            try:
                self._listen(self._selection.select(map(tuple, self._master.getTopicTypes())))
                if time.monotonic() >= next_slow:
                    next_slow = time.monotonic() + FLUSH_PERIOD
                    self._read_parameters()
            except (OSError, rosgraph.MasterException) as error:
                log.debug("the master does not answer: %s", error)
        try:
            self._read_parameters()
        except (OSError, rosgraph.MasterException) as error:
            log.debug("the master ended before the recorder: %s", error)

    def _read_parameters(self) -> None:
        text = json.dumps(self._master.getParam("/"), sort_keys=True, default=str)
        if text != self._parameters:
            self._parameters = text
            data = text.encode()
            header = {**_STRING_HEADER, "callerid": rospy.get_name()}
            self._put(PARAMETERS, header, struct.pack("<I", len(data)) + data)

    # -- writing -----------------------------------------------------------------------------------------------

    def _write(self) -> None:
        """Writes queued messages until the recorder is closed."""
        try:
            self._write_all()
        except Exception as error:
            self.problem = str(error) if isinstance(error, BagError) else f"{self._writer.path}: {error!r}"
            log.exception("recording has stopped")
            rospy.signal_shutdown(self.problem)

    def _write_all(self) -> None:
        next_flush = time.monotonic() + FLUSH_PERIOD
        while True:
            try:
                item = self._queue.get(timeout=FLUSH_PERIOD)
                if item is None:
                    return
                self._write_one(item)
                with self._arrival:
                    self._waiting -= len(item[3])
                if self._part != self._writer.part:
                    self._part = self._writer.part
                    self._chains.clear()  # the next change is preceded by the whole scene
            except queue.Empty:
                pass
            if time.monotonic() >= next_flush:
                next_flush = time.monotonic() + FLUSH_PERIOD
                self._writer.flush()

    def _write_one(self, item: _Item) -> None:
        topic, header, arrival, data = item
        if header["md5sum"] == msgs.WmMonitor._md5sum:
            for change in self._chains.setdefault(topic, ChangeChain(topic)).extend(_change(data)):
                self._listen(self._selection.allowed([*action_topics(driver_actions(change)), *signal_topics(change)]))
                self._writer.write(topic, header, arrival, _serialized(change))
            return
        if topic == _DESCRIPTION:
            self._listen_to_manager(data)
        self._writer.write(topic, header, arrival, data)

    def _listen_to_manager(self, data: bytes) -> None:
        """Subscribes to the topics of a manager that has announced its name."""
        name = data[4:].decode("utf-8", "replace")
        if is_graph_name(name):
            self._listen(self._selection.initial_topics([name]))
        else:
            log.warning("%r on %s is not a name of a skill manager", name, _DESCRIPTION)


def _change(data: bytes) -> Any:
    return msgs.WmMonitor().deserialize(data)


def _serialized(message: Any) -> bytes:
    buffer = BytesIO()
    message.serialize(buffer)
    return buffer.getvalue()


#: Timeout of the world model's snapshot service (s).
SERVICE_TIMEOUT = 5.0

#: Author of a scene that the recorder has requested.
AUTHOR = "recorder"


class ChangeChain:
    """The changes of one world model, as a chain that starts with the whole scene.

    :param topic: the monitor topic, such as `/wm/monitor`.
    """

    def __init__(self, topic: str) -> None:
        self._service = topic.removesuffix("monitor") + "snapshot"
        self._known = ""

    def extend(self, change: Any) -> list[Any]:
        """Returns the changes to write for a received change.

        That is the change itself; with the whole scene before it, if previous changes are missing; nothing, if a
        requested scene contains it already. May block on the snapshot service.
        """
        if change.action != RESET and change.prev_snapshot_id != self._known:
            if self._includes(change):
                return []
            scene = self._whole_scene(change)
            if scene is not None:
                self._known = scene.snapshot_id
                if self._includes(change):
                    return [scene]
                self._known = change.snapshot_id
                return [scene, change]
        self._known = change.snapshot_id
        return [change]

    def _includes(self, change: Any) -> bool:
        """Whether the last written state contains a change."""
        same_session = self._known.rpartition("-")[0] == change.snapshot_id.rpartition("-")[0]
        return same_session and 0 < snapshot_number(change.snapshot_id) <= snapshot_number(self._known)

    def _whole_scene(self, change: Any) -> Any:
        """Requests the scene and returns it as a reset; None if the world model does not answer."""
        try:
            rospy.wait_for_service(self._service, SERVICE_TIMEOUT)
            answer = rospy.ServiceProxy(self._service, srvs.WmSnapshot)(SCENE)
        except (rospy.ServiceException, rospy.ROSException) as error:
            log.warning("the scene before %s is unknown: %s: %s", change.snapshot_id, self._service, error)
            return None
        log.info("requested the scene from %s, as changes before %s are missing", self._service, change.snapshot_id)
        state = answer.snapshot_id
        return msgs.WmMonitor(state, state, change.stamp, AUTHOR, RESET, answer.elements, [])


def driver_actions(change: Any) -> list[str]:
    """Returns the driver actions that the elements of a change name."""
    return _names_in(change, ACTION_PROPERTIES)


def signal_topics(change: Any) -> list[str]:
    """Returns the topics of the signals that the elements of a change describe."""
    return _names_in(change, (TOPIC,))


def _names_in(change: Any, keys: Collection[str]) -> list[str]:
    """Returns the full graph names that properties of the elements of a change have as values."""
    names = []
    for element in change.elements:
        for prop in element.properties:
            if prop.key in keys:
                names += [rospy.resolve_name(name) for name in _values(prop.dataValue) if is_graph_name(name)]
    return names


def _values(text: str) -> list[Any]:
    try:
        values = json.loads(text)
    except ValueError:  # reported when the bag is read
        return []
    return values if isinstance(values, list) else [values]


#: Period of checks for a missing master (s).
_MASTER_PERIOD = 0.2


def run(arguments: Sequence[str] | None = None) -> NoReturn:
    """Records until the node is shut down (Ctrl-C, SIGTERM, `rosnode kill`), then exits with its status.

    :param arguments: of the command line; None for those of this process.
    """
    options = _parser().parse_args(command_arguments(arguments))
    try:
        status = _record(options)
    except SkirosError as error:
        sys.stderr.write(f"record: {error}\n")
        status = USAGE if isinstance(error, WrongValue) else REFUSED
    except KeyboardInterrupt:
        status = INTERRUPTED
    sys.exit(status)


def _parser() -> argparse.ArgumentParser:
    parser = Parser(
        prog="record",
        description="Records a run: changes of the world model, progress of tasks, goals and results of actions, tf, "
        "clock, joint states, logs, parameters. May be started before all other nodes.",
        epilog="Exit status: 0 the recording is complete, 1 it is incomplete or the bag cannot be written, "
        "2 wrong usage.",
    )
    parser.add_argument("-o", "--output", type=Path, metavar="FILE", help="the bag (default: run_DATE_TIME.bag)")
    parser.add_argument("--force", action="store_true", help="replace an existing file")
    parser.add_argument(
        "--robots", nargs="*", default=[], metavar="NAME", help="skill managers to expect; others are found later"
    )
    parser.add_argument(
        "--evidence", action="store_true", help="record conditions, hooks and pushed values, which re-runs compare"
    )
    parser.add_argument("--also", default="", metavar="REGEX", help="additional topics, by their full name")
    parser.add_argument("--without", default="", metavar="REGEX", help="topics to exclude")
    parser.add_argument("--compression", default="none", metavar="HOW", help=f"{', '.join(COMPRESSIONS)}")
    parser.add_argument(
        "--split", type=int, default=SPLIT, metavar="MB", help=f"begin a new file then (default: {SPLIT}; 0: never)"
    )
    parser.add_argument("--keep", type=int, default=0, metavar="N", help="keep only the last N files (default: 0, all)")
    parser.add_argument("--no-check", action="store_true", help="do not check the bag for missing messages at the end")
    return parser


def _record(options: argparse.Namespace) -> int:
    output = options.output or Path(time.strftime("run_%Y-%m-%d_%H-%M-%S.bag"))
    selection = Selection(pattern(options.also), pattern(options.without), options.evidence)
    writer = BagParts(output.absolute(), options.compression, options.force, options.split * 10**6, options.keep)
    try:
        _wait_for_master()
    except KeyboardInterrupt:
        writer.close()
        raise
    with shutdown_in_thread():
        rospy.init_node("recorder", disable_signals=True)
        bridge_logging()
        watch_master()
        recorder = Recorder(writer, selection, options.robots)
        _print(f"recording to {output}")
        spin()
        recorder.close()
    parts = f" and further files up to {writer.path.name}" if writer.part > 1 else ""
    _print(f"{writer.count} messages in {output}{parts}")
    if recorder.lost:
        _print(f"MISSING: {recorder.lost} messages, because the disk was too slow")
        return REFUSED
    if options.no_check or writer.part > 1:  # goals and tasks may have begun in another part
        return OK
    findings = check(Run.open(output))
    for finding in findings:
        _print(f"{'ok' if finding.holds else 'MISSING'}: {finding.text}")
    return OK if all(finding.holds for finding in findings) else REFUSED


def _wait_for_master() -> None:
    if rosgraph.is_master_online():
        return
    _print(f"waiting for the master {rosgraph.get_master_uri()}")
    while not rosgraph.is_master_online():
        time.sleep(_MASTER_PERIOD)


def _print(text: str) -> None:
    sys.stdout.write(f"{text}\n")
    sys.stdout.flush()
