"""Reads the messages of a bag without ROS; the bag contains the definitions of their types."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

from rosbags.interfaces import Connection
from rosbags.rosbag1 import Reader
from rosbags.serde import SerdeError
from rosbags.typesys import Stores, TypesysError, get_types_from_msg, get_typestore

from skiros2_bags.core.salvage import DAMAGE, BoundedReader, SalvageReader
from skiros2_common.core.errors import SkirosError


class BagError(SkirosError):
    """A bag cannot be read, or lacks required messages. The text names the bag, the location and what was expected."""

    code = "bag"


@dataclass(eq=False)
class Message:
    """A recorded message.

    :param time: when it was recorded (s since the epoch; simulated time if the recorder used it).
    :param type: as `rostopic type` prints it: `std_msgs/String`.
    :param caller: the publishing node; "" if the bag does not name it.
    :param definition: of its type and of all types in it.
    :param data: the serialised message.
    :param bag: the file.
    :param nanoseconds: the exact `time` (ns).
    """

    time: float
    topic: str
    type: str
    md5: str
    caller: str
    definition: str = field(repr=False)
    data: bytes = field(repr=False)
    bag: Path = field(repr=False)
    _decode: Callable[[Message], Any] = field(repr=False)
    nanoseconds: int = 0

    @property
    def location(self) -> str:
        """File, topic and time, for error messages."""
        return f"{self.bag}: {self.topic} at {self.time:.3f} s"

    @cached_property
    def content(self) -> Any:
        """The decoded message.

        :raises BagError: the data does not match the type.
        """
        return self._decode(self)


MONITOR = "skiros2_msgs/WmMonitor"
PROGRESS = "skiros2_msgs/TreeProgress"

#: MD5 sums of the contract. Bags with other sums were recorded with an incompatible version.
MD5_SUMS = {
    MONITOR: "ecc40ec88cb57baaf7cf8c07fd40a3c7",
    PROGRESS: "82e5478691b0800a9d96112287389bb2",
    "skiros2_msgs/AssignTaskActionGoal": "e802f6f9a9d68b5f918998a172f98b55",
    "skiros2_msgs/AssignTaskActionResult": "fbfe2da64b877db0724fa15bf68e147a",
    "skiros2_msgs/AssignTaskActionFeedback": "6fd05a4dc6f460247a7e95d6246a678f",
}


def check_md5(message: Message) -> None:
    """Checks that a message of a contract type has the contract's MD5 sum.

    :raises BagError: the sum differs.
    """
    expected = MD5_SUMS.get(message.type)
    if expected is not None and message.md5 != expected:
        what = f"{message.location}: {message.type} has the md5 sum {message.md5}, expected {expected}"
        raise BagError(f"{what}: it was recorded with another version")


class BagFile:
    """A bag. No file stays open between calls. Not thread-safe.

    A truncated bag is read up to its last complete record; `damage` then says where it ends.

    :raises BagError: the file does not exist or is not a bag.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.damage = ""
        self._decoders: dict[tuple[str, str, str], Any] = {}
        with self._opened() as reader:
            self.connections: list[Connection] = list(reader.connections)
            self.start = reader.start_time / 1e9 if reader.chunk_infos else 0.0
            self.end = (reader.end_time - 1) / 1e9 if reader.chunk_infos else 0.0
            if isinstance(reader, SalvageReader):
                self.damage = f"{path}: the bag is cut off {reader.end_reason}"

    @property
    def topics(self) -> dict[str, str]:
        """The type of each topic."""
        return {c.topic: plain_type(c.msgtype) for c in self.connections}

    def messages(self, *wanted: str, until: float | None = None) -> Iterator[Message]:
        """Yields the messages of topics (`/tf`) or types (`tf2_msgs/TFMessage`), oldest first; by default all messages.

        :param until: the last time to include (s since the epoch).
        :raises BagError: the bag cannot be read.
        """
        connections = [c for c in self.connections if not wanted or {c.topic, plain_type(c.msgtype)} & {*wanted}]
        if not connections:
            return
        numbers = {c.id for c in connections}
        stop = None if until is None else round(until * 1e9) + 1000  # a float does not hold a time exactly
        with self._opened() as reader:
            chosen = [c for c in reader.connections if c.id in numbers]
            known = {c.id: (c.topic, plain_type(c.msgtype), c.digest, _caller(c), c.msgdef.data) for c in chosen}
            for connection, time, data in reader.messages(chosen, stop=stop):
                yield Message(time / 1e9, *known[connection.id], data, self.path, self._decode, time)

    def _decode(self, message: Message) -> Any:
        key = (message.type, message.md5, message.definition)
        decoder = self._decoders.get(key)
        if decoder is None:
            decoder = self._decoders[key] = self._decoder(message)
        try:
            return decoder(message.data)
        except (SerdeError, *DAMAGE) as error:
            text = f"{message.location} is not a valid {message.type}: {error or type(error).__name__}"
            raise BagError(text) from error

    def _decoder(self, message: Message) -> Any:
        """Returns a decoder for the type of a message, from the definition in the bag.

        :raises BagError: the definition is invalid, or differs from the contract's.
        """
        location = f"{self.path}: {message.topic}: {message.type}"
        check_md5(message)
        name = message.type.replace("/", "/msg/")
        store = get_typestore(Stores.ROS1_NOETIC)
        try:
            types = get_types_from_msg(message.definition, name)
            for known, fields in types.items():  # the bag's definition replaces the current one
                if store.fielddefs.get(known) != fields:
                    store.fielddefs.pop(known, None)
                    store.register({known: fields})
            found = store.generate_msgdef(name)[1]
        except (TypesysError, *DAMAGE) as error:
            raise BagError(f"{location}: its definition in the bag is invalid: {error}") from error
        if found != message.md5:
            raise BagError(f"{location}: its definition in the bag has the md5 sum {found}, expected {message.md5}")
        return lambda data: store.deserialize_ros1(data, name)

    @contextmanager
    def _opened(self) -> Iterator[Reader]:
        if not self.path.is_file():
            raise BagError(f"{self.path}: there is no such file")
        try:
            with self._reader() as reader:
                yield reader
        except DAMAGE as error:
            raise BagError(f"{self.path}: the bag cannot be read: {error or type(error).__name__}") from error

    def _reader(self) -> Reader:
        if self.damage:
            return SalvageReader(self.path)
        reader = BoundedReader(self.path)
        try:
            reader.open()
        except DAMAGE:
            return SalvageReader(self.path)
        reader.close()
        return BoundedReader(self.path)


def plain_type(name: str) -> str:
    """Returns `std_msgs/String` for `std_msgs/msg/String`."""
    package, _, rest = name.partition("/")
    return f"{package}/{rest.rpartition('/')[2]}"


def _caller(connection: Connection) -> str:
    return getattr(connection.ext, "callerid", None) or ""
