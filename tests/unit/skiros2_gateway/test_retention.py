"""Ended jobs and the audit log are kept for a time."""

from __future__ import annotations

import asyncio
import time
from pathlib import Path

import pytest

from skiros2_gateway.core import retention, store
from skiros2_gateway.core.job import Job, Order, Response, State
from skiros2_gateway.core.retention import keep_days
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
        sizes.append(sum(file.stat().st_size for file in tmp_path.iterdir()))
    assert sizes[-1] <= 1.1 * sizes[1]
