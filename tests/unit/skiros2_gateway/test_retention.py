"""Ended jobs and the audit log are kept for a time."""

from __future__ import annotations

import asyncio
import time
from pathlib import Path

import pytest

from skiros2_gateway.core import retention, store
from skiros2_gateway.core.job import Job, Order, Response, State
from skiros2_gateway.core.retention import Ages, keep_days
from skiros2_gateway.core.store import JobStore

DAY = 86_400.0


def ended_job(number: int, ended: float | None) -> Job:
    """A job; `ended` None: it has not ended."""
    response = Response(outcome="done", ended=ended, collected=True) if ended else Response()
    state = State.ENDED if ended else State.ALLOWED_TO_START
    return Job(Order(id=f"job-{number}", goal="(a)"), "", number, 0.0, 0.0, state, response=response)


def filled(path: Path | str, days: int, per_day: int) -> JobStore:
    """A store with a history of some days."""
    kept, now = JobStore(path), time.time()
    for number in range(days * per_day):
        at = now - DAY * (days - number / per_day)
        kept.save(ended_job(number + 1, at), "tests", "Store")
        kept.audit({"time": at, "user": "a", "way": "http", "action": "Store", "object": "", "outcome": "ok"})
    return kept


async def settled(kept: JobStore, days: float) -> None:
    task = asyncio.get_running_loop().create_task(keep_days(kept, days))
    while kept.prune(time.time() - days * DAY) if days else False:
        await asyncio.sleep(0.0)
    await asyncio.sleep(0.05)
    task.cancel()


def counts(kept: JobStore) -> list[int]:
    return [kept._read(f"SELECT COUNT(*) FROM {table}")[0][0] for table in ("jobs", "job_events", "audit")]


@pytest.mark.parametrize("days", [7.1, 0.0])
def test_old_jobs_and_audit_entries_are_removed(days: float, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(store, "_PRUNED", 7)
    monkeypatch.setattr(retention, "PAUSE", 0.0)
    kept = filled(":memory:", 30, 4)
    asyncio.run(settled(kept, days))
    assert counts(kept) == ([28] * 3 if days else [120] * 3)
    assert kept.next_sequence() == 121


def test_jobs_that_have_not_ended_and_the_last_number_are_kept() -> None:
    kept = JobStore(":memory:")
    kept.save(ended_job(1, None), "tests", "Store")
    kept.save(ended_job(2, time.time() - 100 * DAY), "tests", "Store")
    kept.save(ended_job(3, time.time() - 99 * DAY), "tests", "Store")
    while kept.prune(time.time()):
        pass
    assert {job.id for job in kept.jobs()} == {"job-1", "job-3"}
    assert kept.next_sequence() == 4


@pytest.mark.parametrize("jump", [DAY, -DAY])
def test_clock_that_is_set_by_a_day_removes_nothing_early_and_nothing_late(
    monkeypatch: pytest.MonkeyPatch, jump: float
) -> None:
    kept = filled(":memory:", 1, 24)
    hour = 3600.0
    wall, begin = time.time(), time.monotonic()
    ages = Ages(kept, 0.5 * DAY + 60.0)

    def left(at: float, set_by: float = 0.0) -> list[int]:
        monkeypatch.setattr(time, "monotonic", lambda: begin + at)
        monkeypatch.setattr(time, "time", lambda: wall + at + set_by)
        while ages.prune():
            pass
        return sorted(int(job.id.partition("-")[2]) for job in kept.jobs())

    assert left(0.0) == [*range(13, 25)]
    for number in range(25, 31):  # one each hour; the clock is set after three of them
        left((number - 24) * hour, jump * (number > 27))
        kept.save(ended_job(number, time.time()), "tests", "Store")
        kept.audit({"time": time.time(), "user": "a", "way": "", "action": "", "object": "", "outcome": ""})
        ages.mark()
    assert left(6.5 * hour, jump) == [*range(20, 31)]
    assert left(12.5 * hour, jump) == [*range(25, 31)]
    assert left(15.5 * hour, jump) == [28, 29, 30]
    assert left(20.0 * hour, jump) == [30]  # the last one stays
    assert counts(kept) == [1, 1, 0]


def test_audit_log_has_a_largest_size(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(store, "_MAX_AUDIT", 50)
    kept = filled(":memory:", 2, 100)
    while kept.prune(0.0):
        pass
    assert counts(kept) == [200, 200, 50]


def test_size_of_the_file_is_bounded(tmp_path: Path) -> None:
    kept = filled(tmp_path / "jobs.sqlite", 10, 30)
    sizes = []
    for round in range(4):
        while kept.prune(time.time() - 5 * DAY):
            pass
        for number in range(150):
            at = time.time() - DAY * 4
            kept.save(ended_job(1000 * (round + 1) + number, at - 2 * DAY), "tests", "Store")
            kept.audit({"time": at - 2 * DAY, "user": "a", "way": "", "action": "", "object": "", "outcome": ""})
        kept.close()  # the log is copied to the file
        sizes.append(sum(file.stat().st_size for file in tmp_path.iterdir()))
        kept = JobStore(tmp_path / "jobs.sqlite")
    assert sizes[-1] <= 1.1 * sizes[1]
