"""Retention prunes expired states and limits the size of the journal; the current state always stays."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from skiros2_common.core.errors import WrongValue
from skiros2_common.core.world_element import Element
from skiros2_world_model.core import journal_file
from skiros2_world_model.core.journal import Journal
from skiros2_world_model.core.local_world_model import LocalWorldModel
from skiros2_world_model.core.world_model import WorldModel

Start = Callable[..., tuple[LocalWorldModel, Journal]]


@pytest.fixture
def start(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Start]:
    """Starts a world model whose retention runs when the test says so."""
    monkeypatch.setattr(journal_file, "_PERIOD", 3600.0)
    monkeypatch.setattr(journal_file, "_REQUESTS", 1 << 60)
    monkeypatch.setattr(journal_file, "_PAUSE", 0.0)
    journals: list[Journal] = []

    def start(**options: Any) -> tuple[LocalWorldModel, Journal]:
        journals.append(Journal(tmp_path / "wm.journal", **options))
        return LocalWorldModel("tester", WorldModel(journal=journals[-1])), journals[-1]

    yield start
    for journal in journals:
        journal.close(clean=False)


def test_the_size_stays_bounded_under_updates(start: Start, tmp_path: Path) -> None:
    bound = 1_000_000
    wm, journal = start(max_bytes=bound)
    element = Element("skiros:Part")
    element.setProperty("Note", "x" * 1000)
    wm.add_elements([element, *(Element("skiros:Part") for _ in range(50))])
    first = wm.model.number
    sizes = []
    for step in range(5000):
        element.setProperty("Note", f"{step} " + "x" * 1000)
        wm.update_element(element)
        if step % 500 == 499:
            journal._retention.prune()
            sizes.append([(tmp_path / name).stat().st_size for name in ("wm.journal", "wm.journal-wal")])
    assert max(size for size, _ in sizes) < 3 * bound  # what is written between two looks comes on top
    assert sizes[-1][0] <= sizes[2][0] * 1.1
    assert sizes[-1][1] <= sizes[2][1] * 1.5  # SQLite writes its log from the start after each look
    kept = wm.history(element.id)
    assert 200 < len(kept) < 1000
    assert kept[-1].after[0].value_of("Note").startswith("4999 ")
    with pytest.raises(WrongValue, match="the journal begins with change"):
        wm.model.history.scene_at(first)
    assert len(wm.model.history.scene_at(kept[0].number).after) == 52


def test_expired_states_are_pruned_and_the_current_one_is_kept(start: Start, monkeypatch: pytest.MonkeyPatch) -> None:
    wm, journal = start(days=25.0)
    element = Element("skiros:Part")
    wm.add_element(element)
    now, begin_time = time.time(), time.monotonic()
    retention = journal._retention

    def on_day(day: int) -> None:
        monkeypatch.setattr(time, "time", lambda: now + day * 86400.0)
        monkeypatch.setattr(retention, "_monotonic", lambda: begin_time + day * 86400.0)
        element.setProperty("Day", day)
        wm.update_element(element)
        wm.set_relation("skiros:Scene-0", "skiros:contain", element, day % 20 == 0)
        retention.prune()

    for day in range(0, 100, 10):
        on_day(day)
    days = [entry.after[0].value_of("Day") for entry in wm.history(element.id) if entry.after]
    assert days == [70, 80, 90]
    entry = wm.model.history.scene_at(now + 65 * 86400.0)
    assert {e.id: e.value_of("Day") for e in entry.after}[element.id] == 60
    with pytest.raises(WrongValue, match="begins with"):
        wm.model.history.scene_at(now + 55 * 86400.0)
    db = journal._file.writer
    assert db.execute("SELECT count(*) FROM request WHERE stamp < ?", (now + 59.0 * 86400.0,)).fetchone()[0] == 0
    begin = db.execute("SELECT value FROM meta WHERE key='begin'").fetchone()
    for table in ("past_element", "past_relation"):
        assert db.execute(f"SELECT count(*) FROM {table} WHERE until < ?", begin).fetchone()[0] == 0
    assert element.id in wm.model.scene()


@pytest.mark.parametrize("jump", [86400.0, -86400.0])
def test_clock_that_is_set_by_a_day_expires_nothing(start: Start, monkeypatch: pytest.MonkeyPatch, jump: float) -> None:
    wm, journal = start(days=0.5)
    element = Element("skiros:Part")
    wm.add_element(element)
    retention = journal._retention
    now, begin = time.time(), time.monotonic()
    for hour in range(8):
        set_by = jump if hour in (3, 4, 5) else 0.0
        monkeypatch.setattr(time, "time", lambda: now + hour * 3600.0 + set_by)  # noqa: B023
        monkeypatch.setattr(retention, "_monotonic", lambda: begin + hour * 3600.0)  # noqa: B023
        element.setProperty("Hour", hour)
        wm.update_element(element)
        retention.prune()
    hours = [entry.after[0].value_of("Hour") for entry in wm.history(element.id) if entry.after]
    assert hours == [None, *range(8)]
    monkeypatch.setattr(retention, "_monotonic", lambda: begin + 16.5 * 3600.0)
    retention.prune()
    hours = [entry.after[0].value_of("Hour") for entry in wm.history(element.id) if entry.after]
    assert hours == [4, 5, 6, 7], "half a day later, also what was written meanwhile has expired in time"


def test_large_expired_request_is_pruned_completely(start: Start, tmp_path: Path) -> None:
    journal = Journal(tmp_path / "wm.journal", max_bytes=1)
    wm = LocalWorldModel("tester", WorldModel(None, tmp_path, journal=journal))
    for _ in range(2):
        elements = [Element("skiros:Part") for _ in range(3 * journal_file._ROWS)]
        for element in elements:
            element.addRelation("skiros:Scene-0", "skiros:contain", "-1")
        wm.add_elements(elements)
    wm.save("cell.ttl")
    wm.load("cell.ttl")
    wm.load("cell.ttl")
    journal._retention.prune()
    db = journal._file.writer
    begin = db.execute("SELECT value FROM meta WHERE key='begin'").fetchone()
    for table in ("past_element", "past_relation"):
        assert db.execute(f"SELECT count(*) FROM {table} WHERE until < ?", begin).fetchone()[0] == 0
    journal.close()


def test_without_bounds_nothing_is_dropped(start: Start, monkeypatch: pytest.MonkeyPatch) -> None:
    wm, journal = start(days=0.0)
    element = Element("skiros:Part")
    wm.add_element(element)
    now = time.time()
    monkeypatch.setattr(time, "time", lambda: now + 1e9)
    wm.set_relation("skiros:Scene-0", "skiros:contain", element)
    journal._retention.prune()
    assert len(wm.history(element.id)) == 2


def test_current_state_larger_than_the_limit_is_kept(start: Start) -> None:
    wm, journal = start(max_bytes=1)
    wm.add_elements([Element("skiros:Part") for _ in range(100)])
    journal._retention.prune()
    assert len(wm.model.history.scene_at().after) == 101
    journal.close(clean=False)
    wm, _ = start()
    assert len(wm.model.scene()) == 101


def test_requests_and_questions_go_on_meanwhile(start: Start) -> None:
    wm, journal = start(max_bytes=300_000)
    element = Element("skiros:Part")
    wm.add_element(element)
    done = threading.Event()

    def prune() -> None:
        while not done.is_set():
            journal._retention.prune()

    thread = threading.Thread(target=prune)
    thread.start()
    try:
        for step in range(3000):
            element.setProperty("Step", step)
            wm.update_element(element)
            if step % 300 == 0:
                assert wm.history(element.id, limit=1)[0].after[0].value_of("Step") == step
    finally:
        done.set()
        thread.join()
    journal.close(clean=False)
    wm, _ = start()
    assert wm.get_element(element.id).value_of("Step") == 2999


def test_thread_prunes_after_a_number_of_requests(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(journal_file, "_REQUESTS", 10)
    pruned = threading.Event()
    monkeypatch.setattr(journal_file.Retention, "prune", lambda self: pruned.set())
    journal = Journal(tmp_path / "wm.journal")
    wm = LocalWorldModel("tester", WorldModel(journal=journal))
    for _ in range(10):
        wm.add_element(Element("skiros:Part"))
    assert pruned.wait(5.0)
    journal.close()
