"""The memory of the page and of the gateway is flat over an hour: progress 25 times a second, tasks, jobs, motions.

`PAGE_UPDATES` is the number of updates (90 000). They come up to ten times as fast as in a cell; a person at the page
goes from panel to panel meanwhile.
"""

from __future__ import annotations

import asyncio
import gc
import math
import os
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from skiros2_gateway.core import live
from skiros2_gateway.core.live import LiveView
from skiros2_gateway.core.scene_history import SceneHistory
from skiros2_live.core.patch import EntriesChanged, TaskProgress
from support.progress import SUCCESS, pick_and_place
from support.served_page import served_page
from system.test_page import CHROMIUM, PAGE, browser  # noqa: F401
from unit.skiros2_gateway.conftest import TOKENS, Gateway

pytestmark = [
    pytest.mark.long,
    pytest.mark.timeout(3600),
    pytest.mark.skipif(CHROMIUM is None, reason="needs Debian's chromium"),
    pytest.mark.skipif(not PAGE.is_file(), reason="the page is not built: npm had no network at the set-up"),
]

UPDATES = int(os.environ.get("PAGE_UPDATES", "90000"))
PERIOD = 0.004  # s between updates, for 0.04 s of the cell
#: The updates of a task, and of a job.
TASK = 50
#: What may grow between the second and the last quarter: share of the heap, and of the gateway's memory.
HEAP, MEMORY = 0.05, 0.05
PANELS = ("tree", "plan", "log", "signals", "scene", "world")


class Hour:
    """The activity of a cell in four quarters, each of which the test lets begin, and waits for."""

    def __init__(self) -> None:
        self.barrier = threading.Barrier(2)
        self.is_over = threading.Event()

    async def run(self, gateway: Gateway, view: LiveView) -> None:
        gateway.cell.capacity = 100
        document, begin = gateway.cell.document, gateway.cell.document.clock()
        view.scenes = SceneHistory(max_entries=2000)  # full before the second quarter
        for number in range(UPDATES):
            if number % (UPDATES // 4) == 0:
                self.is_over.set()
                await asyncio.to_thread(self.barrier.wait, 600.0)
                self.is_over.clear()
            now, task, age = begin + 100.0 + number * 0.04, number // TASK + 10, number % TASK
            document.clock = lambda now=now: now
            nodes = pick_and_place(task_id=task, **({"state": SUCCESS, "code": 1} if age == TASK - 1 else {}))
            nodes[2].progress_message, nodes[2].progress_code = f"{age} mm", age + 2
            document.apply(TaskProgress("/arm", nodes, now))
            document.apply(EntriesChanged("elements", {f"skiros:Product-{i}": _box(i, number) for i in range(3)}))
            signal = {"name": "Force", "unit": "N", "robot": "/arm", "value": math.sin(number), "time": now}
            document.apply(EntriesChanged("signals", {"skiros:Signal-4": {**signal, "low": -1.0, "high": 1.0}}))
            job = f"job-{task}"
            if age == 0:
                await gateway.put(job, work_master="place", parameters={"Tray": "Tray-1"})
                gateway.cell.run(job)
            elif age == TASK - 1:
                gateway.cell.end(job, "succeeded" if task % 5 else "failed", "it has slipped")
            await asyncio.sleep(PERIOD)
        self.is_over.set()
        await asyncio.to_thread(self.barrier.wait, 600.0)


def _box(number: int, update: int) -> dict[str, Any]:
    pose = [0.3 * number, round(0.5 * math.sin(update / 50.0), 3), 0.1, 0.0, 0.0, 0.0, 1.0]
    marker = {"frame": "map", "own": f"product_{number}", "pose": pose, "shape": "box", "size": [0.1, 0.1, 0.1]}
    return {
        "type": "skiros:Product",
        "label": f"Product {number}",
        "relations": [],
        "properties": {"skiros:PositionY": [pose[1]]},
        "marker": {**marker, "mesh": "", "colour": [0.2, 0.4, 0.8, 1.0], "text": f"Product {number}"},
    }


@pytest.fixture
def hour(monkeypatch: pytest.MonkeyPatch) -> Iterator[Hour]:
    monkeypatch.setattr(live, "PERIOD", PERIOD)
    made = Hour()
    yield made
    made.barrier.abort()


def test_memory_is_flat_over_an_hour(tmp_path: Path, browser: Any, hour: Hour) -> None:  # noqa: F811
    figures: list[dict[str, float]] = []
    documents: list[str] = []
    with served_page(tmp_path, PAGE.parent, hour.run) as address:
        page = browser.new_context(viewport={"width": 1280, "height": 800}).new_page()
        page.on("request", lambda request: documents.append(request.url) if request.url.endswith("/api/live") else None)
        page.goto(address)
        page.fill("#token", TOKENS["operate"])
        page.click("#login")
        page.wait_for_selector(".cell .job, [data-panel=cell] .card")
        devtools = page.context.new_cdp_session(page)
        devtools.send("Performance.enable")
        hour.barrier.wait(60.0)
        for _ in range(4):
            page.wait_for_timeout(1000.0)
            while not hour.is_over.is_set():
                _visit(page)
            figures.append(_figures(page, devtools))
            print(figures[-1])
            hour.barrier.wait(600.0)
        page.context.close()
    _, second, _, last = figures
    assert last["JSHeapUsedSize"] < second["JSHeapUsedSize"] * (1.0 + HEAP), figures
    assert last["Nodes"] <= second["Nodes"] * (1.0 + HEAP), figures
    assert last["JSEventListeners"] <= second["JSEventListeners"] * (1.0 + HEAP), figures
    assert last["memory"] < second["memory"] * (1.0 + MEMORY), figures
    assert len(documents) <= 2, "the page was too slow, and has read the document again"


def _visit(page: Any) -> None:
    """Shows each panel for a while, and opens the dialogs."""
    for panel in PANELS:
        page.click(f"nav [data-tab={panel}]:visible")
        page.wait_for_timeout(300.0)
    for button in ("#new-job", "#all-jobs", "#alarms"):
        page.click(button)
        page.wait_for_timeout(300.0)
        if button == "#alarms" and page.is_visible("#acknowledge-all"):
            page.click("#acknowledge-all")  # alarms stay until then
        page.keyboard.press("Escape")


def _figures(page: Any, devtools: Any) -> dict[str, float]:
    """What the page (bytes, numbers) and this process (MB), which has the gateway, hold; the tree is shown."""
    page.click("nav [data-tab=tree]:visible")
    page.wait_for_timeout(2000.0)
    gc.collect()
    for _ in range(2):
        devtools.send("HeapProfiler.collectGarbage")
    found = {each["name"]: each["value"] for each in devtools.send("Performance.getMetrics")["metrics"]}
    memory = next(line for line in Path("/proc/self/status").read_text().splitlines() if line.startswith("VmRSS"))
    names = ("JSHeapUsedSize", "Nodes", "JSEventListeners")
    return {**{name: found[name] for name in names}, "memory": int(memory.split()[1]) / 1024}
