"""The loop waits for no disk: answers, and goals of jobs, wait for a sync that they share."""

from __future__ import annotations

import asyncio
import os
import sqlite3
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from skiros2_gateway.core import group_sync, outbox
from skiros2_gateway.core.job import Method
from skiros2_gateway.core.problems import StoreFailed
from skiros2_gateway.core.store import JobStore
from unit.skiros2_gateway.conftest import OPERATOR

Run = Callable[..., None]


class Disk:
    """Syncs as slowly as a test wants."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.ready = threading.Event()
        self.ready.set()
        self.error: OSError | None = None
        self.syncs = 0
        monkeypatch.setattr(group_sync.os, "fdatasync", self._sync)

    def _sync(self, file: int) -> None:
        assert self.ready.wait(20.0)
        self.syncs += 1
        if self.error is not None:
            raise self.error


@pytest.fixture
def disk(monkeypatch: pytest.MonkeyPatch) -> Disk:
    return Disk(monkeypatch)


async def others_run() -> None:
    for _ in range(10):
        await asyncio.sleep(0.001)


def test_answer_and_goal_wait_for_the_disk_and_the_loop_does_not(in_gateway: Run, disk: Disk) -> None:
    async def test(gateway: Any) -> None:
        disk.ready.clear()
        put = asyncio.create_task(gateway.put("a"))
        await others_run()
        assert gateway.state("a") == "AllowedToStart/Loaded"
        assert not put.done()
        assert not gateway.cell.sent
        disk.ready.set()
        await put
        assert [goal.id for goal in gateway.cell.sent] == ["a"]

    in_gateway(test)


def test_commands_share_a_sync_and_are_answered_in_their_order(in_gateway: Run, disk: Disk) -> None:
    async def test(gateway: Any) -> None:
        await gateway.put("before")
        disk.ready.clear()
        before, answered = disk.syncs, []

        async def put(job_id: str) -> None:
            await gateway.put(job_id)
            answered.append(job_id)

        ids = [f"job-{number}" for number in range(30)]
        tasks = [asyncio.create_task(put(job_id)) for job_id in ids]
        await others_run()
        disk.ready.set()
        await asyncio.gather(*tasks)
        assert answered == ids
        assert disk.syncs - before == 2  # the first has begun before the second job was written

    in_gateway(test)


def test_job_that_is_aborted_before_it_is_on_the_disk_is_never_sent(in_gateway: Run, disk: Disk) -> None:
    async def test(gateway: Any) -> None:
        disk.ready.clear()
        put = asyncio.create_task(gateway.put("a"))
        await others_run()
        abort = asyncio.create_task(gateway.service.apply(OPERATOR, Method.ABORT, "a"))
        await others_run()
        assert not abort.done()
        disk.ready.set()
        await asyncio.gather(put, abort)
        assert (gateway.state("a"), gateway.cell.sent, gateway.cell.stopped) == ("Aborted", [], [])

    in_gateway(test)


def test_disk_that_refuses_is_an_error_of_the_answer_and_the_goal_is_sent_later(
    in_gateway: Run, disk: Disk, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(outbox, "_RETRY", 0.01)

    async def test(gateway: Any) -> None:
        await gateway.put("runs")
        gateway.cell.accept("runs")
        disk.error = OSError(28, "No space left on device")
        with pytest.raises(StoreFailed, match="No space left"):
            await gateway.put("waits")
        await gateway.service.apply(OPERATOR, Method.STOP, "runs")
        assert gateway.cell.stopped == ["runs"]  # whatever the disk does
        gateway.cell.end("runs")
        await others_run()
        assert [goal.id for goal in gateway.cell.sent] == ["runs"]
        disk.error = None
        while len(gateway.cell.sent) < 2:
            await asyncio.sleep(0.005)

    in_gateway(test)


def test_stop_does_not_wait_for_the_disk(in_gateway: Run, disk: Disk) -> None:
    async def test(gateway: Any) -> None:
        await gateway.put("a")
        gateway.cell.accept("a")
        disk.ready.clear()
        stop = asyncio.create_task(gateway.service.apply(OPERATOR, Method.STOP, "a"))
        await others_run()
        assert (gateway.cell.stopped, stop.done()) == (["a"], False)
        disk.ready.set()
        await stop

    in_gateway(test)


def test_what_was_synced_is_in_the_log_without_the_process(tmp_path: Path) -> None:
    async def main() -> None:
        path = tmp_path / "jobs.sqlite"
        store = JobStore(path)
        for number in range(250):  # also beyond checkpoints
            store.put_key("user", f"key-{number}", "digest")
            if number % 50 == 0:
                await store.synced()
        await store.synced()
        copy = tmp_path / "copy.sqlite"
        for end in ("", "-wal"):
            Path(f"{copy}{end}").write_bytes(Path(f"{path}{end}").read_bytes())
        with sqlite3.connect(copy) as database:
            assert database.execute("SELECT COUNT(*) FROM keys").fetchone() == (250,)
            assert database.execute("PRAGMA integrity_check").fetchone() == ("ok",)
        store.close()
        assert not os.path.exists(f"{path}-wal")

    asyncio.run(main())
