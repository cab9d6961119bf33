"""Invalid and truncated bags, and bags with other message types: readable part and error."""

from __future__ import annotations

import hashlib
import tracemalloc
from pathlib import Path
from typing import Any

import pytest
from rosbags.rosbag1 import Writer

from skiros2_bags.core.bag_file import BagError
from skiros2_bags.core.run import Run
from skiros2_bags.core.salvage import MAX_CHUNK
from support.recorded_run import good_run, write_bag


@pytest.mark.parametrize(
    ("content", "error"),
    [
        (b"", "does not begin as a bag"),
        (b"hello\nworld", "does not begin as a bag"),
        (b"#ROSBAG V1.2\n", "version 2.0"),
    ],
)
def test_file_that_is_not_a_bag_is_rejected(tmp_path: Path, content: bytes, error: str) -> None:
    file = tmp_path / "x.bag"
    file.write_bytes(content)
    with pytest.raises(BagError, match=rf"x\.bag: the bag cannot be read: .*{error}"):
        Run.open(file)


def test_missing_file_is_rejected(tmp_path: Path) -> None:
    with pytest.raises(BagError, match=r"none\.bag: there is no such file"):
        Run.open(tmp_path / "none.bag")


def test_empty_bag_has_no_messages(tmp_path: Path) -> None:
    with Writer(tmp_path / "run.bag"):
        pass
    run = Run.open(tmp_path / "run.bag")
    assert (run.start, run.end, run.topics, list(run.messages())) == (0.0, 0.0, {}, [])


def test_bag_of_killed_recorder_is_read_completely(tmp_path: Path) -> None:
    whole = Run.open(write_bag(tmp_path / "whole.bag", good_run()))
    writer = Writer(tmp_path / "run.bag")
    writer.open()
    for connection in whole.bag.connections:
        own = writer.add_connection(
            connection.topic, connection.msgtype, msgdef=connection.msgdef.data, md5sum=connection.digest
        )
        for number, message in enumerate(whole.messages(connection.topic)):
            writer.write(own, number, message.data)
    writer.write_chunk(writer.chunks[-1])
    writer.abort()
    run = Run.open(tmp_path / "run.bag")
    assert "without an index: its recorder was killed" in run.damage
    assert len(list(run.messages())) == len(good_run())
    assert run.goals()[0].state == "succeeded"


@pytest.mark.parametrize("part", [0.99, 0.8, 0.6])
def test_truncated_bag_is_read_up_to_the_last_complete_record(tmp_path: Path, part: float) -> None:
    content = write_bag(tmp_path / "whole.bag", good_run()).read_bytes()
    file = tmp_path / "run.bag"
    begin = content.index(b"op=\x05")  # the part before the first chunk has a fixed size
    file.write_bytes(content[: begin + int((len(content) - begin) * part)])
    run = Run.open(file)
    assert "run.bag: the bag is cut off after" in run.damage
    found = [(m.topic, m.data) for m in run.messages()]
    everything = [(m.topic, m.data) for m in Run.open(tmp_path / "whole.bag").messages()]
    assert found == everything[: len(found)]
    assert found


def test_unknown_compression_ends_the_readable_part(tmp_path: Path) -> None:
    file = write_bag(tmp_path / "run.bag", good_run())
    file.write_bytes(file.read_bytes().replace(b"compression=none", b"compression=zstd"))
    run = Run.open(file)
    assert "'zstd' is not supported" in run.damage
    assert list(run.messages()) == []


def test_changes_with_other_md5_sum_are_rejected(tmp_path: Path) -> None:
    file = write_bag(tmp_path / "run.bag", good_run())
    known = b"ecc40ec88cb57baaf7cf8c07fd40a3c7"
    file.write_bytes(file.read_bytes().replace(known, b"0" * 32))
    run = Run.open(file)
    with pytest.raises(
        BagError, match=rf"/wm/monitor at 0.000 s: skiros2_msgs/WmMonitor has the md5 sum 0*, expected {known.decode()}"
    ):
        run.changes()
    assert run.tasks()


def test_definition_with_wrong_md5_sum_is_rejected(tmp_path: Path) -> None:
    file = write_bag(tmp_path / "run.bag", good_run())
    file.write_bytes(file.read_bytes().replace(b"string snapshot_id", b"string snapshot_iq"))
    with pytest.raises(BagError, match="its definition in the bag has the md5 sum"):
        print(next(Run.open(file).messages("/wm/monitor")).content)


def test_data_of_another_type_is_rejected(tmp_path: Path) -> None:
    whole = Run.open(write_bag(tmp_path / "whole.bag", good_run()))
    (monitor,) = [c for c in whole.bag.connections if c.topic == "/wm/monitor"]
    with Writer(tmp_path / "run.bag") as writer:
        own = writer.add_connection("/wm/monitor", monitor.msgtype, msgdef=monitor.msgdef.data, md5sum=monitor.digest)
        writer.write(own, 2_000_000_000, b"\xff" * 40)
    with pytest.raises(BagError, match=r"/wm/monitor at 2\.000 s: the change cannot be read"):
        Run.open(tmp_path / "run.bag").changes()


def test_message_definitions_come_from_the_bag(tmp_path: Path) -> None:
    """Also for types that exist on this system with another definition."""
    definition = "std_msgs/Header header\nint32 value\n"
    header = "MSG: std_msgs/Header\nstring frame\n"
    text = f"{definition}{'=' * 80}\n{header}"
    inner = hashlib.md5(b"string frame").hexdigest()
    md5 = hashlib.md5(f"{inner} header\nint32 value".encode()).hexdigest()
    with Writer(tmp_path / "run.bag") as writer:
        own = writer.add_connection("/x", "some_msgs/msg/Odd", msgdef=text, md5sum=md5)
        writer.write(own, 1, b"\x01\0\0\0a\x07\0\0\0")
    (message,) = Run.open(tmp_path / "run.bag").messages()
    assert (message.content.header.frame, message.content.value) == ("a", 7)


@pytest.mark.parametrize("compression", [Writer.CompressionFormat.BZ2, Writer.CompressionFormat.LZ4])
@pytest.mark.parametrize("is_cut_off", [False, True])
def test_small_chunk_that_grows_without_end_is_not_read(tmp_path: Path, compression: Any, is_cut_off: bool) -> None:
    file = tmp_path / "bomb.bag"
    writer = Writer(file)
    writer.set_compression(compression)
    with writer:
        definition = "string data"
        md5 = hashlib.md5(definition.encode()).hexdigest()
        connection = writer.add_connection("/x", "std_msgs/msg/String", msgdef=definition, md5sum=md5)
        writer.write(connection, 1, bytes(MAX_CHUNK + 1))
    assert file.stat().st_size < 1_000_000
    if is_cut_off:
        file.write_bytes(file.read_bytes()[:-10])
    tracemalloc.start()
    try:
        run = Run.open(file)
        if is_cut_off:
            assert "chunk" in run.damage and list(run.messages()) == []
        else:
            with pytest.raises(BagError, match="chunk"):
                list(run.messages())
        assert tracemalloc.get_traced_memory()[1] < 3 * MAX_CHUNK
    finally:
        tracemalloc.stop()


def test_damaged_length_is_reported_as_damage(tmp_path: Path) -> None:
    """Each length field of the file says 2 GB in turn; no reader takes the memory that it asks for."""
    content = write_bag(tmp_path / "whole.bag", good_run()).read_bytes()
    lengths = [13, content.index(b"index_pos=") - 4, content.index(b"op=\x05") - 8]  # headers and a field
    lengths += [content.index(b"compression=none") + len(b"compression=none") + 13]  # the data of a chunk
    lengths += [content.index(b"op=\x04") - 8, content.index(b"op=\x06") - 8]  # the index
    file = tmp_path / "run.bag"
    tracemalloc.start()
    try:
        for offset in lengths:
            file.write_bytes(content[:offset] + b"\xff\xff\xff\x7f" + content[offset + 4 :])
            assert f"{file}: the bag is cut off after" in Run.open(file).damage, offset
        assert tracemalloc.get_traced_memory()[1] < 2_000_000
    finally:
        tracemalloc.stop()
