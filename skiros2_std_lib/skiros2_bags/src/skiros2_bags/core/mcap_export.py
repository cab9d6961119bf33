"""Converts a bag to MCAP with ROS 1 messages, which Foxglove and Lichtblick open.

The messages and their definitions are copied as they are (profile `ros1`, schema encoding `ros1msg`).
"""

from __future__ import annotations

from pathlib import Path

from mcap.writer import Writer

from skiros2_bags.core.run import Run


def export_mcap(run: Run, target: Path) -> int:
    """Writes all messages of a run; returns their number.

    :raises BagError: the bag cannot be read.
    :raises OSError: the file cannot be written.
    """
    schemas: dict[tuple[str, str], int] = {}
    channels: dict[tuple[str, str, str], int] = {}
    counts: dict[int, int] = {}
    with target.open("wb") as file:
        writer = Writer(file)
        writer.start(profile="ros1", library="skiros2_bags")
        for message in run.messages():
            schema = (message.type, message.md5)
            if schema not in schemas:
                definition = message.definition.encode()
                schemas[schema] = writer.register_schema(message.type, "ros1msg", definition)
            channel = (message.topic, message.md5, message.caller)
            if channel not in channels:
                metadata = {"md5sum": message.md5, "callerid": message.caller, "topic": message.topic}
                channels[channel] = writer.register_channel(message.topic, "ros1", schemas[schema], metadata)
            number = channels[channel]
            time = round(message.time * 1e9)
            writer.add_message(number, time, bytes(message.data), time, counts.get(number, 0))
            counts[number] = counts.get(number, 0) + 1
        writer.finish()  # type: ignore[no-untyped-call]
    return sum(counts.values())
