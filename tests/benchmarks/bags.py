"""How long a recorded run takes to be read: a world model's history, beside the mere decoding of its messages.

Both are one thread's work, so the time is that of the CPU: whatever else the machine does is not counted.
"""

from __future__ import annotations

import random
import time
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from rosbags.rosbag1 import Reader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from benchmarks.measurement import Measurement, paired
from skiros2_bags.core.run import Run
from support.recorded_run import Monitor, element, write_bag

SIZE = 100 << 20  # bytes
ELEMENTS = 500
AXES = ("X", "Y", "Z")


def measure(folder: Path) -> Iterator[Measurement]:
    bag = write_bag(folder / "history.bag", history())
    assert bag.stat().st_size >= SIZE

    def read() -> float:
        start = time.process_time()
        run = Run.open(bag)
        assert len(run.world()) == ELEMENTS
        return time.process_time() - start

    def decode() -> float:
        start = time.process_time()
        for _ in decoded(bag):
            pass
        return time.process_time() - start

    yield paired(
        f"world at the end of a bag of {SIZE >> 20} MB", read, "rosbags, decode the messages", decode,
        unit="s", runs=2, warm_up=0, target=3.0,
    )  # fmt: skip


def history() -> Iterator[tuple[str, Any]]:
    """The scene, and updates of a few elements each, until there is enough: poses that change, and what stays."""
    rng = random.Random(0)
    monitor = Monitor()
    poses = {number: [rng.random() for _ in range(7)] for number in range(ELEMENTS)}

    def made(number: int) -> Any:
        *position, qx, qy, qz, qw = poses[number]
        numbers = {f"Position{axis}": [value] for axis, value in zip(AXES, position, strict=True)}
        numbers |= {f"Orientation{a}": [v] for a, v in zip((*AXES, "W"), (qx, qy, qz, qw), strict=True)}
        size = {f"Size{axis}": [0.1] for axis in AXES}
        texts = {"BaseFrameId": ["map"], "FrameId": [f"part_{number}"], "State": ["Idle"], "Weight": [0.5]}
        place = [("-1", "skiros:contain", f"skiros:Part-{number + 1}")] if number % 10 == 0 else []
        return element(f"skiros:Part-{number}", f"Part {number}", place, **numbers, **size, **texts)

    yield "change", monitor("reset", *map(made, range(ELEMENTS)))
    written = 0
    while written < SIZE:
        chosen = rng.sample(range(ELEMENTS), rng.randint(1, 5))
        for number in chosen:
            poses[number][:3] = [rng.random() for _ in AXES]
        elements = [made(number) for number in chosen]
        yield "change", monitor("update", *elements)
        written += sum(len(p.key) + len(p.dataValue) + len(p.dataType) + 12 for e in elements for p in e.properties)


def decoded(bag: Path) -> Iterator[SimpleNamespace]:
    """The messages of the world model, decoded by rosbags and nothing else."""
    store = get_typestore(Stores.ROS1_NOETIC)
    with Reader(bag) as reader:
        connections = [c for c in reader.connections if c.topic == "/wm/monitor"]
        for connection in connections:
            store.register(get_types_from_msg(connection.msgdef.data, connection.msgtype))
        for connection, _, data in reader.messages(connections):
            yield store.deserialize_ros1(data, connection.msgtype)
