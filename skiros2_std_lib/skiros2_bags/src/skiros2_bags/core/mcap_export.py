"""Converts a bag to MCAP with ROS 1 messages, which Foxglove and Lichtblick open.

The messages and their definitions are copied as they are (profile `ros1`, schema encoding `ros1msg`). Messages with the
frames, shapes and robots of the cell are added for the 3D view; see `skiros2_bags.core.mcap_scene`.
"""

from __future__ import annotations

import json
import math
from pathlib import Path

from mcap.writer import Writer

from skiros2_bags.core.mcap_scene import SCHEMAS, scene_messages
from skiros2_bags.core.run import Run


def export_mcap(run: Run, target: Path) -> int:
    """Writes all messages of a run, and the scene for the 3D view; returns the number of the former.

    :raises BagError: the bag cannot be read.
    :raises OSError: the file cannot be written.
    """
    schemas: dict[tuple[str, str], int] = {}
    channels: dict[tuple[str, str, str], int] = {}
    counts: dict[int, int] = {}
    with target.open("wb") as file:
        writer = Writer(file)
        writer.start(profile="ros1", library="skiros2_bags")
        scene = _Scene(writer, run)
        for message in run.messages():
            scene.write(message.time, message.nanoseconds)
            schema = (message.type, message.md5)
            if schema not in schemas:
                definition = message.definition.encode()
                schemas[schema] = writer.register_schema(message.type, "ros1msg", definition)
            channel = (message.topic, message.md5, message.caller)
            if channel not in channels:
                metadata = {"md5sum": message.md5, "callerid": message.caller, "topic": message.topic}
                channels[channel] = writer.register_channel(message.topic, "ros1", schemas[schema], metadata)
            number = channels[channel]
            time = message.nanoseconds
            writer.add_message(number, time, bytes(message.data), time, counts.get(number, 0))
            counts[number] = counts.get(number, 0) + 1
        scene.write(math.inf, 2**63)
        writer.finish()  # type: ignore[no-untyped-call]
    return sum(counts.values())


class _Scene:
    """The messages for the 3D view."""

    def __init__(self, writer: Writer, run: Run) -> None:
        self._writer = writer
        self._messages = scene_messages(run)
        self._next = next(self._messages, None)
        self._last = 0  # ns
        self._channels: dict[str, int] = {}
        self._schemas: dict[str, int] = {}

    def write(self, until: float, nanoseconds: int) -> None:
        """Writes the next messages up to a time.

        :param until, nanoseconds: in s and in ns since the epoch. A float does not hold a time exactly.
        """
        while self._next is not None and self._next[0] <= until:
            seconds, topic, schema, data = self._next
            if schema not in self._schemas:
                text = json.dumps(SCHEMAS[schema]).encode()
                self._schemas[schema] = self._writer.register_schema(schema, "jsonschema", text)
            if topic not in self._channels:
                self._channels[topic] = self._writer.register_channel(topic, "json", self._schemas[schema])
            time = max(self._last, min(round(seconds * 1e9), nanoseconds))
            self._writer.add_message(self._channels[topic], time, data, time)
            self._next = next(self._messages, None)
        self._last = nanoseconds
