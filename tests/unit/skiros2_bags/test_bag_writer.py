"""The bag writer."""

from __future__ import annotations

from pathlib import Path

import pytest
from rosbags.rosbag1 import Reader

from skiros2_bags.core.bag_file import BagError, BagFile
from skiros2_bags.core.bag_writer import COMPRESSIONS, BagWriter
from skiros2_common.core.errors import WrongValue

TEXT = {
    "type": "std_msgs/String",
    "md5sum": "992ce8a1687cec8c8bd883ec73ca41d1",
    "message_definition": "string data\n",
    "callerid": "/speaker",
    "latching": "1",
}
STATUS = {"type": "actionlib_msgs/GoalStatusArray", "md5sum": "8b2b82f13216d0a8ea88bd3af735e619"}


def string_data(text: str) -> bytes:
    return len(text).to_bytes(4, "little") + text.encode()


@pytest.mark.parametrize("compression", COMPRESSIONS)
def test_written_messages_can_be_read(tmp_path: Path, compression: str) -> None:
    writer = BagWriter(tmp_path / "run.bag", compression)
    for number in range(3):
        writer.write("/said", TEXT, 10**9 * number, string_data(str(number)))
    writer.close()
    messages = list(BagFile(tmp_path / "run.bag").messages())
    assert [(m.time, m.topic, m.caller, m.content.data) for m in messages] == [
        (float(number), "/said", "/speaker", str(number)) for number in range(3)
    ]
    with Reader(tmp_path / "run.bag") as reader:
        assert reader.connections[0].ext.latching == 1


def test_file_has_its_final_name_after_close(tmp_path: Path) -> None:
    writer = BagWriter(tmp_path / "run.bag")
    assert [f.name for f in tmp_path.iterdir()] == ["run.bag.active"]
    writer.close()
    assert [f.name for f in tmp_path.iterdir()] == ["run.bag"]


def test_flushed_messages_survive_a_kill(tmp_path: Path) -> None:
    writer = BagWriter(tmp_path / "run.bag", "lz4")
    writer.write("/said", TEXT, 1, string_data("kept"))
    writer.flush()
    writer.write("/said", TEXT, 2, string_data("lost"))
    (tmp_path / "left.bag").write_bytes(writer.active.read_bytes())
    assert [m.content.data for m in BagFile(tmp_path / "left.bag").messages()] == ["kept"]
    writer.close()
    assert [m.content.data for m in BagFile(tmp_path / "run.bag").messages()] == ["kept", "lost"]


def test_existing_file_is_replaced_on_request_only(tmp_path: Path) -> None:
    file = tmp_path / "run.bag"
    file.write_text("old")
    with pytest.raises(BagError, match=r"run\.bag: the file exists already"):
        BagWriter(file)
    writer = BagWriter(file, replace=True)
    assert file.read_text() == "old"
    writer.close()
    assert file.read_bytes().startswith(b"#ROSBAG")


def test_unknown_compression_and_invalid_folder_are_rejected(tmp_path: Path) -> None:
    with pytest.raises(WrongValue, match="'zip', expected one of none, bz2, lz4"):
        BagWriter(tmp_path / "run.bag", "zip")
    (tmp_path / "file").touch()
    with pytest.raises(BagError, match="cannot be written"):
        BagWriter(tmp_path / "file" / "run.bag")


def test_unchanged_status_is_written_once(tmp_path: Path) -> None:
    writer = BagWriter(tmp_path / "run.bag")
    header = {**STATUS, "message_definition": "bool x\n", "callerid": "/server"}
    for number, state in enumerate(b"aabba"):
        stamp = bytes([number]) * 12  # number and time of its Header
        writer.write("/do/status", header, number, stamp + bytes([state]))
    writer.close()
    assert [m.data[-1:] for m in BagFile(tmp_path / "run.bag").messages()] == [b"a", b"b", b"a"]
