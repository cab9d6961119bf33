"""Requests of several threads share the syncs of the journal; none is acknowledged or seen before it is on disk."""

from __future__ import annotations

import os
import shutil
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path

import pytest

from skiros2_common.core.discrete_reasoner import DiscreteReasoner
from skiros2_common.core.errors import Refused, SkirosError
from skiros2_common.core.operations import Add, Change, Operation, Outcome, Relate, Remove, Update
from skiros2_common.core.world_element import Element
from skiros2_world_model.core.group_commit import GroupCommit
from skiros2_world_model.core.journal import Journal
from skiros2_world_model.core.local_world_model import source_ontologies
from skiros2_world_model.core.scene import ROOT
from skiros2_world_model.core.world_model import WorldModel

WAIT = 20.0


class Disk:
    """A disk whose syncs wait until the test ends them, or fail."""

    def __init__(self) -> None:
        self.syncs = 0
        self.begun = threading.Semaphore(0)
        self.end = threading.Semaphore(0)
        self.error: OSError | None = None

    def sync(self, _: int) -> None:
        self.syncs += 1
        self.begun.release()
        assert self.end.acquire(timeout=WAIT)
        if self.error is not None:
            raise self.error


class Cell:
    """A world model on a slow disk, and threads that write to it."""

    def __init__(self, folder: Path, disk: Disk) -> None:
        self.disk = disk
        self.path = folder / "wm.journal"
        self.journal = Journal(self.path)
        self.model = WorldModel(source_ontologies(), journal=self.journal)
        self.commit = GroupCommit(self.model)
        self.threads = ThreadPoolExecutor(16)
        self.arrived = threading.Semaphore(0)
        self.published: list[Change] = []
        self.model.add_listener(self.published.append)

    def start(self, *operations: Operation, author: str = "tester") -> Future[Outcome]:
        """Starts a request in a thread of its own."""

        def transact() -> Outcome:
            self.arrived.release()
            return self.commit.transact(operations, author)

        future = self.threads.submit(transact)
        assert self.arrived.acquire(timeout=WAIT)
        return future

    def start_waiting(self, requests: list[tuple[Operation, ...]]) -> tuple[Future[Outcome], list[Future[Outcome]]]:
        """Starts a request, and others in order while the disk syncs it."""
        first = self.start(Add(part("first")))
        assert self.disk.begun.acquire(timeout=WAIT)
        others = []
        for number, request in enumerate(requests, 1):
            others.append(self.start(*request))
            until(lambda number=number: len(self.commit._waiting) == number)  # type: ignore[misc]
        return first, others

    def labels(self) -> list[str]:
        """The labels of the parts in the order of their changes."""
        with self.model.lock:
            records = [record for record in self.model.scene() if record.type == "skiros:Part"]
        return [record.label for record in sorted(records, key=lambda record: record.version)]


@pytest.fixture
def cell(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Cell]:
    disk = Disk()
    cell = Cell(tmp_path, disk)
    cell.journal.full_sync = True
    monkeypatch.setattr(os, "fdatasync", disk.sync)
    yield cell
    for _ in range(100):
        disk.end.release()
    cell.threads.shutdown()
    cell.journal.close()


def part(label: str) -> Element:
    return Element("skiros:Part", label)


def until(condition: Callable[[], bool]) -> None:
    """Waits for another thread to reach a lock, which has no event."""
    deadline = threading.Event()
    for _ in range(4000):
        if condition():
            return
        deadline.wait(0.005)
    raise AssertionError("the condition has not become true")


def test_requests_that_wait_for_a_sync_share_the_next_one(cell: Cell) -> None:
    first, others = cell.start_waiting([(Add(part(f"{n}")),) for n in range(9)])
    assert not first.done() and not cell.published
    cell.disk.end.release()
    first.result(WAIT)
    assert cell.disk.begun.acquire(timeout=WAIT)
    assert not any(other.done() for other in others) and len(cell.published) == 1
    cell.disk.end.release()
    for other in others:
        other.result(WAIT)
    assert cell.disk.syncs == 2
    assert cell.labels() == ["first", *(f"{n}" for n in range(9))]
    numbers = [change.number for change in cell.published]
    assert numbers == list(range(numbers[0], numbers[0] + 10))
    assert [change.elements[0].label for change in cell.published] == cell.labels()


def test_changes_of_one_element_are_published_as_each_request_left_it(cell: Cell) -> None:
    cell.journal.full_sync = False
    [eid] = cell.commit.transact([Add(part("part"))], "tester").ids
    cell.journal.full_sync = True

    def counted(number: int) -> Update:
        element = Element("skiros:Part", "part", eid)
        element.setProperty("skiros:Count", number)
        return Update(element)

    first, others = cell.start_waiting([(counted(number),) for number in range(3)])
    cell.disk.end.release(2)
    results = [other.result(WAIT) for other in [first, *others]][1:]
    assert [result.changes[0].elements[0].value_of("skiros:Count") for result in results] == [0, 1, 2]
    assert [change.elements[0].value_of("skiros:Count") for change in cell.published[2:]] == [0, 1, 2]
    entries = cell.model.history.changes(eid)
    assert [entry.after[0].value_of("skiros:Count") for entry in entries][-3:] == [0, 1, 2]


def test_failed_sync_refuses_each_request_that_waits_for_it(cell: Cell) -> None:
    first, others = cell.start_waiting([(Add(part(f"{n}")),) for n in range(4)])
    cell.disk.end.release()
    first.result(WAIT)
    assert cell.disk.begun.acquire(timeout=WAIT)
    before = cell.published[-1].number
    cell.disk.error = OSError("input/output error")
    cell.disk.end.release()
    for other in others:
        with pytest.raises(Refused, match="cannot be written: input/output error"):
            other.result(WAIT)
    assert cell.labels() == ["first"] and cell.model.number == before and len(cell.published) == 1
    cell.disk.error = None
    cell.disk.end.release()
    cell.commit.transact([Add(part("next"))], "tester")
    assert cell.published[-1].number == before + 1
    assert cell.labels() == recovered_labels(cell) == ["first", "next"]


def test_failed_sync_restores_elements_relations_and_their_versions(cell: Cell) -> None:
    cell.journal.full_sync = False
    ids = [cell.commit.transact([Add(part(f"{n}"))], "tester").ids[0] for n in range(3)]
    cell.commit.transact([Relate(ROOT, "skiros:contain", ids[0])], "tester")
    cell.journal.full_sync = True
    before = state(cell)
    changed = Element("skiros:Part", "changed", ids[1])
    first, others = cell.start_waiting(
        [
            (Relate(ROOT, "skiros:contain", ids[0], False), Relate(ROOT, "skiros:contain", ids[1])),
            (Update(changed),),
            (Remove(ids[2]),),
            (Add(part("again")), Remove(ids[0])),
        ]
    )
    cell.disk.error = OSError("input/output error")
    cell.disk.end.release(2)
    for other in [first, *others]:
        with pytest.raises(Refused):
            other.result(WAIT)
    assert state(cell) == before
    assert all(cell.model.scene().removal(eid) is None for eid in ids)


def test_refused_request_does_not_touch_those_that_wait_with_it(cell: Cell) -> None:
    unknown = Element("skiros:Part", "unknown", "skiros:Part-99")
    first, others = cell.start_waiting(
        [(Add(part("1")),), (Update(unknown),), (Add(part("\ud800")),), (Add(part("2")),)]
    )
    cell.disk.end.release(2)
    first.result(WAIT), others[0].result(WAIT), others[3].result(WAIT)
    with pytest.raises(SkirosError, match="skiros:Part-99"):
        others[1].result(WAIT)
    with pytest.raises(SkirosError, match="surrogates"):
        others[2].result(WAIT)
    assert cell.labels() == ["first", "1", "2"]
    assert cell.disk.syncs == 2


def test_acknowledged_requests_of_a_group_are_in_the_log(cell: Cell) -> None:
    first, others = cell.start_waiting([(Add(part(f"{n}")),) for n in range(5)])
    cell.disk.end.release(2)
    for other in [first, *others]:
        other.result(WAIT)
    assert recovered_labels(cell) == ["first", *(f"{n}" for n in range(5))]


def test_reasoners_see_the_inverse_of_a_group_in_reverse_order(cell: Cell) -> None:
    class Seen(DiscreteReasoner):
        def __init__(self) -> None:
            self.calls: list[tuple[str, str]] = []

        def parse(self, element: Element, action: str) -> bool:
            self.calls.append((action, element.label))
            return True

    seen = Seen()
    cell.journal.full_sync = False
    cell.model.add_reasoner(seen)
    cell.journal.full_sync = True
    first, others = cell.start_waiting([(Add(part("1")),), (Add(part("2")),)])
    cell.disk.end.release()
    first.result(WAIT)
    seen.calls.clear()
    cell.disk.error = OSError("input/output error")
    cell.disk.end.release()
    for other in others:
        with pytest.raises(Refused):
            other.result(WAIT)
    assert seen.calls[-2:] == [("remove", "2"), ("remove", "1")]


def state(cell: Cell) -> tuple[object, ...]:
    with cell.model.lock:
        scene = cell.model.scene()
        return sorted((r.id, r.label, r.version) for r in scene), sorted(scene.relations()), cell.model.number


def recovered_labels(cell: Cell) -> list[str]:
    """The labels of the parts that a world model recovers from what is on disk now."""
    killed = cell.path.parent / "killed"
    killed.mkdir()
    for ending in ("", "-wal", "-log"):
        shutil.copy(f"{cell.path}{ending}", killed)
    journal = Journal(killed / cell.path.name)
    model = WorldModel(source_ontologies(), journal=journal)
    assert model.recovered
    records = [record for record in model.scene() if record.type == "skiros:Part"]
    journal.close()
    return [record.label for record in sorted(records, key=lambda record: record.version)]
