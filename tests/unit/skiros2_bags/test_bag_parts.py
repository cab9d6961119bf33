"""Recordings in several bags."""

from __future__ import annotations

from pathlib import Path

from skiros2_bags.core.bag_file import MONITOR, BagFile
from skiros2_bags.core.bag_parts import BagParts
from unit.skiros2_bags.test_bag_writer import TEXT, string_data

SAID = {**TEXT, "latching": "0"}


def texts(path: Path) -> list[tuple[str, str]]:
    return [(message.topic, message.content.data) for message in BagFile(path).messages()]


def recorded(folder: Path, count: int, keep: int = 0) -> BagParts:
    """Ten messages of 104 bytes fit into a part."""
    parts = BagParts(folder / "run.bag", most_bytes=1040, keep=keep)
    parts.write("/robot", TEXT, 1, string_data("r" * 100))
    for number in range(count):
        parts.write("/said", SAID, 2 + number, string_data(f"{number:100}"))
    parts.close()
    return parts


def test_new_part_begins_with_latched_messages(tmp_path: Path) -> None:
    parts = recorded(tmp_path, 25)
    names = sorted(file.name for file in tmp_path.iterdir())
    assert names == ["run.bag", "run_2.bag", "run_3.bag"]
    assert (parts.part, parts.path.name) == (3, "run_3.bag")
    said = [texts(tmp_path / name) for name in names]
    assert [part[0][0] for part in said] == ["/robot"] * 3
    numbers = [int(text) for part in said for topic, text in part if topic == "/said"]
    assert numbers == list(range(25))
    assert parts.count == 25 + 3


def test_only_the_last_parts_are_kept(tmp_path: Path) -> None:
    recorded(tmp_path, 100, keep=3)
    names = sorted(file.name for file in tmp_path.iterdir())
    assert names == ["run_10.bag", "run_11.bag", "run_9.bag"]


def test_changes_of_the_world_model_are_not_repeated(tmp_path: Path) -> None:
    parts = BagParts(tmp_path / "run.bag", most_bytes=100)
    monitor = {**TEXT, "type": MONITOR}
    parts.write("/wm/monitor", monitor, 1, string_data("x" * 90))
    parts.write("/said", SAID, 2, string_data("y" * 90))
    parts.close()
    assert [message.topic for message in BagFile(tmp_path / "run_2.bag").messages()] == ["/said"]


def test_unlimited_recording_is_one_file(tmp_path: Path) -> None:
    parts = BagParts(tmp_path / "run.bag")
    for number in range(50):
        parts.write("/said", SAID, number, string_data("z" * 100))
    parts.close()
    assert [file.name for file in tmp_path.iterdir()] == ["run.bag"]
