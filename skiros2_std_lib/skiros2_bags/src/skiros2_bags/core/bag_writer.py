"""Selects the topics to record, and writes a bag while messages arrive."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

from rosbags.interfaces import Connection
from rosbags.rosbag1 import Writer
from rosbags.rosbag1.writer import WriterError

from skiros2_bags.core.bag_file import MONITOR, PROGRESS, BagError
from skiros2_common.core.errors import WrongValue

COMPRESSIONS = ("none", "bz2", "lz4")

#: Messages of this type are written only when they change: action servers repeat them five times a second.
_STATUS = "actionlib_msgs/GoalStatusArray"

#: Size of sequence number and time in a `Header`; the rest of an unchanged message is the same.
_STAMP_SIZE = 12


class BagWriter:
    """Writes a bag. Not thread-safe.

    The file is named `FILE.active` until `close`. If the process is killed, `BagFile` can read that file up to the last
    `flush`.

    :param compression: one of `COMPRESSIONS`.
    :param replace: whether to replace an existing file.
    :raises WrongValue: the compression is unknown.
    :raises BagError: the file exists, or cannot be created.
    """

    def __init__(self, path: Path, compression: str = "none", replace: bool = False) -> None:
        if compression not in COMPRESSIONS:
            raise WrongValue(f"unknown compression {compression!r}, expected one of {', '.join(COMPRESSIONS)}")
        self.path = path
        self.active = path.with_name(f"{path.name}.active")
        self.count = 0
        if path.exists() and not replace:
            raise BagError(f"{path}: the file exists already")
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self.active.unlink(missing_ok=True)  # left by a killed recorder
            self._writer = Writer(self.active)
            if compression != "none":
                self._writer.set_compression(Writer.CompressionFormat[compression.upper()])
            self._writer.open()
        except (OSError, WriterError) as error:
            raise BagError(f"{path}: the bag cannot be written: {error}") from error
        self._connections: dict[tuple[str, ...], Connection] = {}
        self._last_status: dict[tuple[str, ...], bytes] = {}

    def write(self, topic: str, header: Mapping[str, str], time: int, data: bytes) -> None:
        """Writes a message. Omits an action server's status that has not changed.

        :param header: of the connection: `type`, `md5sum`, `message_definition`, `callerid`, `latching`.
        :param time: ns since the epoch.
        :raises BagError: writing fails.
        """
        kind, md5, caller = header["type"], header["md5sum"], header.get("callerid", "")
        key = (topic, kind, md5, caller)
        if kind == _STATUS:
            if self._last_status.get(key) == data[_STAMP_SIZE:]:
                return
            self._last_status[key] = data[_STAMP_SIZE:]
        try:
            connection = self._connections.get(key)
            if connection is None:
                connection = self._connections[key] = self._writer.add_connection(
                    topic,
                    kind.replace("/", "/msg/"),
                    msgdef=header.get("message_definition", ""),
                    md5sum=md5,
                    callerid=caller,
                    latching=int(header.get("latching") == "1"),
                )
            self._writer.write(connection, time, data)
        except (OSError, WriterError) as error:
            raise BagError(f"{self.active}: the bag cannot be written: {error}") from error
        self.count += 1

    def flush(self) -> None:
        """Writes all messages so far to the disk.

        :raises BagError: writing fails.
        """
        try:
            chunk = self._writer.chunks[-1]
            if chunk.connections:
                self._writer.write_chunk(chunk)
            if self._writer.bio is not None:
                self._writer.bio.flush()
        except OSError as error:
            raise BagError(f"{self.active}: the bag cannot be written: {error}") from error

    def close(self) -> None:
        """Completes the bag and renames it to its final name.

        :raises BagError: writing fails.
        """
        try:
            self._writer.close()
            os.replace(self.active, self.path)
        except OSError as error:
            raise BagError(f"{self.path}: the bag cannot be ended: {error}; see {self.active}") from error


#: Subscribed to at the start, before anyone publishes them.
INITIAL_TOPICS = ("/wm/monitor", "/skill_managers/description", "/tf", "/tf_static", "/clock", "/rosout")

#: The recorder's topic with all ROS parameters as a JSON object, written when they change.
PARAMETERS = "/recorder/parameters"

#: The topic below a manager with what its skills declare.
DECLARATIONS = "declarations"

#: The topic below a manager with what its engine does. Managers collect it while somebody subscribes.
EVIDENCE = "evidence"

#: Actions of the task manager, also subscribed to at the start.
TASK_MANAGER_ACTIONS = ("/tm/task_plan", "/tm/achieve")

#: Topics of a skill manager: the progress of its tasks, and what its skills declare.
MANAGER_TOPICS = ("monitor", DECLARATIONS)

#: Topics of these types are always recorded.
TYPES = (
    MONITOR,
    PROGRESS,
    "rosgraph_msgs/Clock",
    "sensor_msgs/JointState",
    "skiros2_sim_msgs/Contacts",
    "tf2_msgs/TFMessage",
)

#: Topics that repeat other topics.
DUPLICATES = ("/rosout_agg",)

#: Properties that contain the action names of drivers (contract, "Interfaces of robots").
ACTION_PROPERTIES = ("skiros:NavigationExe", "skiros:MotionExe", "skiros:CartesianGoalAction", "skiros:DriverAddress")

#: Name suffixes of the topics of an action, and suffixes of their types.
_ACTION_TYPES = {"goal": "ActionGoal", "feedback": "ActionFeedback", "result": "ActionResult"}
ACTION_PARTS = (*_ACTION_TYPES, "cancel", "status")

_NAME = re.compile(r"/?[A-Za-z][A-Za-z0-9_]*(/[A-Za-z][A-Za-z0-9_]*)*")


@dataclass(frozen=True)
class Selection:
    """The topics to record.

    :param also: pattern for additional topics, matched against the full name.
    :param without: pattern for excluded topics; overrides everything else.
    :param evidence: whether to record what the engines of managers do.
    """

    also: re.Pattern[str] | None = None
    without: re.Pattern[str] | None = None
    evidence: bool = False

    def initial_topics(self, robots: Iterable[str]) -> list[str]:
        """Returns the topics to subscribe to before they exist.

        :param robots: the names of skill managers, with or without leading slash.
        """
        names = [f"/{name.strip('/')}" for name in robots]
        actions = [*TASK_MANAGER_ACTIONS, *(f"{name}/execute" for name in names)]
        topics = [*INITIAL_TOPICS, *(f"{name}/{topic}" for name in names for topic in self._manager_topics)]
        topics += action_topics(actions)
        return self.allowed(topics)

    @property
    def _manager_topics(self) -> tuple[str, ...]:
        return (*MANAGER_TOPICS, EVIDENCE) if self.evidence else MANAGER_TOPICS

    def allowed(self, topics: Iterable[str]) -> list[str]:
        """Returns the topics that are not excluded, each once."""
        return [topic for topic in dict.fromkeys(topics) if not self._is_excluded(topic)]

    def select(self, topics: Iterable[tuple[str, str]]) -> list[str]:
        """Returns the topics to record.

        :param topics: name and type of all existing topics.
        """
        known = dict(topics)
        return [topic for topic, kind in known.items() if self._is_selected(topic, kind, known)]

    def _is_selected(self, topic: str, kind: str, known: dict[str, str]) -> bool:
        if self._is_excluded(topic) or topic in DUPLICATES:
            return False
        if kind in TYPES or topic in INITIAL_TOPICS or (self.also is not None and self.also.fullmatch(topic)):
            return True
        name, _, part = topic.rpartition("/")
        if part in _ACTION_TYPES:
            return kind.endswith(_ACTION_TYPES[part])
        return part in ACTION_PARTS and known.get(f"{name}/goal", "").endswith("ActionGoal")

    def _is_excluded(self, topic: str) -> bool:
        return self.without is not None and self.without.fullmatch(topic) is not None


def action_topics(actions: Iterable[str]) -> list[str]:
    """Returns the topics of actions."""
    return [f"{name}/{part}" for name in actions for part in ACTION_PARTS]


def is_graph_name(name: object) -> bool:
    """Whether a value is a valid ROS graph name."""
    return isinstance(name, str) and _NAME.fullmatch(name) is not None


def pattern(text: str) -> re.Pattern[str] | None:
    """Compiles a pattern for topic names; None for "".

    :raises WrongValue: the text is not a regular expression.
    """
    try:
        return re.compile(text) if text else None
    except re.error as error:
        raise WrongValue(f"{text!r} is not a regular expression: {error}") from None
