"""The newest requests are in the log of the journal until they are merged; none is lost or applied twice."""

from __future__ import annotations

import os
import shutil
import sqlite3
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from skiros2_common.core.errors import Refused
from skiros2_common.core.world_element import Element
from skiros2_world_model.core import request_log
from skiros2_world_model.core.history import History
from skiros2_world_model.core.journal import Journal, recorded_state
from skiros2_world_model.core.local_world_model import LocalWorldModel
from skiros2_world_model.core.world_model import WorldModel


class Cell:
    """A world model whose requests stay in the log until something is read from the journal."""

    def __init__(self, folder: Path) -> None:
        self.path = folder / "wm.journal"
        self.journal = Journal(self.path)
        self.wm = LocalWorldModel("tester", WorldModel(journal=self.journal))
        self.part = Element("skiros:Part")

    def add(self) -> None:
        self.wm.add_element(self.part)

    def count(self, number: int) -> None:
        self.part.setProperty("skiros:Count", number)
        self.wm.update_element(self.part)

    def copy(self, *endings: str) -> None:
        """Copies files to the folder `killed`, as a kill at this moment leaves them."""
        killed = self.path.parent / "killed"
        killed.mkdir(exist_ok=True)
        for ending in endings or ("", "-wal", "-log"):
            shutil.copy(f"{self.path}{ending}", killed)

    @property
    def copied(self) -> Path:
        return self.path.parent / "killed" / "wm.journal"


@pytest.fixture
def cell(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Cell]:
    monkeypatch.setattr(request_log, "_DELAY", 3600.0)
    cell = Cell(tmp_path)
    yield cell
    cell.journal.close()


def recovered(path: Path, part: Element) -> list[int]:
    """The values of `skiros:Count` in the history of a part; the last one is also that of the recovered scene."""
    journal = Journal(path)
    model = WorldModel(journal=journal)
    counts = [entry.after[0].value_of("skiros:Count") for entry in model.history.changes(part.id)]
    assert model.recovered and model.scene().element(part.id).value_of("skiros:Count") == counts[-1]
    assert model.number == model.history.changes()[-1].number
    journal.close()
    return counts


def test_killed_world_model_recovers_what_was_in_its_log_only(cell: Cell) -> None:
    cell.add()
    for number in range(3):
        cell.count(number)
    cell.copy()
    assert recovered(cell.copied, cell.part) == [None, 0, 1, 2]


def test_what_was_merged_before_the_kill_is_not_applied_again(cell: Cell) -> None:
    cell.add()
    cell.count(0)
    cell.copy("-log")
    cell.journal.flush()
    cell.copy("", "-wal")
    assert cell.copied.with_name("wm.journal-log").stat().st_size
    assert recovered(cell.copied, cell.part) == [None, 0]


@pytest.mark.parametrize("cut", [1, 2, 30])
def test_torn_last_line_is_no_request(cell: Cell, cut: int) -> None:
    cell.add()
    cell.count(0)
    cell.count(1)
    cell.copy()
    log = cell.copied.with_name("wm.journal-log")
    log.write_bytes(log.read_bytes()[:-cut])
    expected = [None, 0, 1] if cut == 1 else [None, 0]  # only its end is missing
    assert recovered(cell.copied, cell.part) == expected


def test_changed_byte_ends_the_log(cell: Cell) -> None:
    cell.add()
    size = cell.path.with_name("wm.journal-log").stat().st_size
    cell.count(0)
    cell.copy()
    log = cell.copied.with_name("wm.journal-log")
    content = bytearray(log.read_bytes())
    content[size + 20] ^= 1
    log.write_bytes(content)
    assert recovered(cell.copied, cell.part) == [None]


def test_log_that_continues_a_lost_state_is_discarded(cell: Cell, caplog: pytest.LogCaptureFixture) -> None:
    """Without `journal_sync`, a power failure may lose what was merged, while the log is on disk."""
    cell.add()
    cell.journal.flush()
    cell.copy("", "-wal")
    cell.count(0)
    cell.journal.flush()
    cell.count(1)
    cell.copy("-log")
    assert recovered(cell.copied, cell.part) == [None]
    assert "are lost" in caplog.text


def test_journal_of_a_killed_world_model_is_read_with_its_log(cell: Cell) -> None:
    cell.add()
    cell.count(0)
    cell.copy()
    [context] = recorded_state(cell.copied).contexts
    assert cell.part.id in [record.id for record in context.records]
    cell.copy()
    assert len(History(cell.copied).changes(cell.part.id)) == 2


def test_history_of_a_running_world_model_has_the_last_request(cell: Cell) -> None:
    cell.add()
    history = cell.wm.model.history
    for number in range(3):
        cell.count(number)
        assert history.changes(limit=1)[0].after[0].value_of("skiros:Count") == number


def test_load_and_declarations_keep_their_place_between_requests(cell: Cell) -> None:
    cell.add()
    cell.wm.add_class("skiros:OddPart", "skiros:Part")
    cell.count(0)
    cell.copy()
    assert recovered(cell.copied, cell.part) == [None, 0]
    actions = [entry.action for entry in History(cell.copied).changes(context="ontology")]
    assert actions == ["ontology"]


def test_log_is_emptied_when_many_requests_wait(cell: Cell, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(request_log, "_MAX_WAITING", 10)
    cell.add()
    log = cell.path.with_name("wm.journal-log")
    sizes = []
    for number in range(100):
        cell.count(number)
        sizes.append(log.stat().st_size)
    assert max(sizes[20:]) < 1.2 * max(sizes[:20])


def test_requests_do_not_wait_for_a_merge(cell: Cell) -> None:
    cell.add()
    begun = threading.Event()
    cell.journal._file.writer.set_trace_callback(lambda _: begun.set())
    other = sqlite3.connect(cell.path, isolation_level=None)
    other.execute("BEGIN IMMEDIATE")  # the merge waits for it
    merge = threading.Thread(target=cell.journal.flush)
    merge.start()
    assert begun.wait(10.0)
    cell.count(0)
    assert merge.is_alive()
    other.close()
    merge.join()
    assert len(cell.wm.history(cell.part.id)) == 2


def test_each_request_is_synced_if_wanted(cell: Cell, monkeypatch: pytest.MonkeyPatch) -> None:
    synced: list[int] = []
    monkeypatch.setattr(os, "fdatasync", synced.append)
    cell.add()
    assert not synced
    cell.journal.full_sync = True
    for number in range(3):
        cell.count(number)
    assert len(synced) == 3


def test_request_that_cannot_be_synced_is_refused_and_not_recovered(
    cell: Cell, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(_: int) -> None:
        raise OSError("input/output error")

    cell.add()
    cell.journal.full_sync = True
    monkeypatch.setattr(os, "fdatasync", fails)
    with pytest.raises(Exception, match="cannot be written: input/output error"):
        cell.count(0)
    monkeypatch.undo()
    cell.copy()
    assert recovered(cell.copied, cell.part) == [None]


def test_requests_are_refused_while_the_tables_cannot_be_written(cell: Cell) -> None:
    """What was accepted before stays in the log, and is merged when they can be written again."""
    cell.add()
    db = cell.journal._file.writer
    db.execute("PRAGMA query_only=ON")
    with pytest.raises(Refused, match="readonly"):
        cell.journal.flush()
    with pytest.raises(Exception, match=r"cannot be written: .*readonly"):
        cell.count(0)
    db.execute("PRAGMA query_only=OFF")
    cell.part.setProperty("skiros:Count", 1)
    cell.wm.update_element(cell.part)
    assert [e.after[0].value_of("skiros:Count") for e in cell.wm.history(cell.part.id)] == [None, 1]
