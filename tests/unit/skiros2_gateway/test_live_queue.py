"""The live view of a long queue."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Any

import pytest

from skiros2_gateway.core import live
from skiros2_gateway.core.live import LiveView
from skiros2_live.core.patch import EntriesChanged

Run = Callable[..., None]


def test_document_has_the_first_jobs_of_a_long_queue_and_their_number(
    in_gateway: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(live, "_MAX_WAITING", 4)
    monkeypatch.setattr(live, "_MAX_JOBS", 2)

    async def test(gateway: Any) -> None:
        def shown(states: str) -> set[str]:
            return {key for key, job in view.snapshot()["document"]["jobs"].items() if job["state"].startswith(states)}

        async def until(hidden: int) -> None:
            while view.snapshot()["document"]["queue"].get("hidden", {"count": 0})["count"] != hidden:
                await asyncio.sleep(0)

        for number in range(6):
            await gateway.put(f"job-{number}")  # the first one is sent to the cell
        view = LiveView(gateway.cell.document)
        task = asyncio.get_running_loop().create_task(view.follow(gateway.service))
        try:
            await until(2)
            for number in range(6, 9):
                await gateway.put(f"job-{number}")
            await until(5)
            for number in range(8):
                gateway.cell.run(f"job-{number}")
                gateway.cell.end(f"job-{number}")
                await gateway.collected(f"job-{number}")
            await until(0)
            assert shown("AllowedToStart") == {"job-8"}
            assert shown("Ended") == {"job-6", "job-7"}
        finally:
            task.cancel()

    in_gateway(test)


def test_jobs_have_the_names_of_elements_that_come_later(in_gateway: Run) -> None:
    async def test(gateway: Any) -> None:
        await gateway.put("job-1", work_master="place", parameters={"Tray": "Tray-1"})
        view = LiveView(gateway.cell.document)
        task = asyncio.get_running_loop().create_task(view.follow(gateway.service))
        try:
            while not view.entry("jobs", "job-1"):
                await asyncio.sleep(0)
            assert view.entry("jobs", "job-1")["title"] == "Tray-1 contains Product-2"
            gateway.cell.document.apply(EntriesChanged("elements", {"Tray-1": {"label": "Tray B"}}, is_whole=True))
            assert view.entry("jobs", "job-1")["title"] == "Tray B contains Product-2"
        finally:
            task.cancel()

    in_gateway(test)
