"""A store that cannot be written: requests are refused, nothing is half-done, and the jobs continue afterwards."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import pytest

from skiros2_gateway.core import job_control
from skiros2_gateway.core.job import Method
from skiros2_gateway.core.problems import StoreFailed
from unit.skiros2_gateway.conftest import OPERATOR

Run = Callable[..., None]


@pytest.fixture(autouse=True)
def quick_retry(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(job_control, "_RETRY", 0.01)


@contextmanager
def unwritable(gateway: Any) -> Iterator[None]:
    """SQLite refuses each change of the file."""
    database = gateway.store._db
    database.execute("PRAGMA query_only = ON")
    try:
        yield
    finally:
        database.execute("PRAGMA query_only = OFF")


def test_order_is_refused_on_a_full_disk_and_leaves_nothing(in_gateway: Run) -> None:
    async def test(gateway: Any) -> None:
        database, known = gateway.store._db, 0
        pages = database.execute("PRAGMA page_count").fetchone()[0]
        database.execute(f"PRAGMA max_page_count = {pages + 10}")
        order = {"goal": "(at robot home)", "description": "x" * 1000, "start": False}
        with pytest.raises(StoreFailed, match="full"):
            for known in range(1000):
                await gateway.put(f"job-{known}", **order)
        assert len(gateway.control.open_jobs) == len(list(gateway.store.jobs())) == known > 0
        database.execute(f"PRAGMA max_page_count = {pages + 1000}")
        await gateway.put(f"job-{known}", **order)

    in_gateway(test)


def test_job_whose_start_cannot_be_written_is_not_sent_and_starts_later(in_gateway: Run) -> None:
    async def test(gateway: Any) -> None:
        gateway.cell.is_ready = False
        await gateway.put("a")
        gateway.cell.is_ready = True
        with unwritable(gateway):
            gateway.control.cell_changed()
            assert gateway.state("a") == "AllowedToStart/Ready"
            assert not gateway.cell.sent
        while not gateway.cell.sent:
            await asyncio.sleep(0.005)
        assert gateway.state("a") == gateway_state_in_store(gateway, "a") == "AllowedToStart/Loaded"

    in_gateway(test)


def test_end_of_a_job_is_kept_and_written_later_before_another_starts(in_gateway: Run) -> None:
    async def test(gateway: Any) -> None:
        await gateway.put("a")
        await gateway.put("b")
        with unwritable(gateway):
            gateway.cell.end("a")
            assert gateway.state("a") == "Ended/Completed"
            assert gateway_state_in_store(gateway, "a") == "AllowedToStart/Loaded"
            assert [goal.id for goal in gateway.cell.sent] == ["a"]
        while len(gateway.cell.sent) < 2:
            await asyncio.sleep(0.005)
        await gateway.collected("a")
        while gateway_state_in_store(gateway, "a") != "Ended/Closed":
            await asyncio.sleep(0.005)
        methods = [entry["method"] for entry in gateway.store.history("a")]
        assert methods == ["StoreAndStart", "loaded", "accepted", "ended", "collected"]

    in_gateway(test)


def test_running_job_is_stopped_and_not_resumed_without_a_disk(in_gateway: Run) -> None:
    async def test(gateway: Any) -> None:
        await gateway.put("a")
        gateway.cell.accept("a")
        with unwritable(gateway):
            await gateway.service.apply(OPERATOR, Method.PAUSE, "a")
            assert (gateway.state("a"), gateway.cell.paused) == ("Interrupted/Held", {"a"})
            with pytest.raises(StoreFailed):
                await gateway.service.apply(OPERATOR, Method.RESUME, "a")
            assert (gateway.state("a"), gateway.cell.paused) == ("Interrupted/Held", {"a"})
            await gateway.service.apply(OPERATOR, Method.STOP, "a")
            assert gateway.cell.stopped == ["a"]

    in_gateway(test)


def gateway_state_in_store(gateway: Any, job_id: str) -> str:
    job = gateway.store.get(job_id)
    return f"{job.state}/{job.substate}"
