"""Load on a gateway while robots are stopped: readers, tabs, plans, jobs; and the times of stops."""

from __future__ import annotations

import asyncio
import json
import os
import statistics
import sys
import time
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from skiros2_skill.client.description import Step
from skiros2_skill.client.manager import ManagerClient
from support.job_cell import ROBOT, TOKENS, JobCell, operator_token
from support.ros import wait_until

READERS, TABS, PLANNERS = 100, 6, 16


@contextmanager
def full_load(cell: JobCell) -> Iterator[None]:
    """Everything that the gateway does besides stopping, from a process of its own."""
    port = cell.rest.address.rpartition(":")[2]
    orders = json.dumps([cell.order("", number, number % 2) for number in range(2)])
    env = {**cell.ros.master.env, "PYTHONPATH": os.pathsep.join([str(Path(__file__).parents[1]), *sys.path])}
    ready = cell.folder / "load.txt"
    program = cell.ros.program(sys.executable, "-m", "support.stop_load", port, orders, str(ready), env=env)
    try:
        wait_until(lambda: ready.exists() and int(ready.read_text() or 0) >= 200, 120.0, "the load")
        yield
    finally:
        program.stop()
        ready.unlink(missing_ok=True)


def stop_times(cell: JobCell, count: int, address: str) -> list[float]:
    """Stops a moving robot again and again. Returns the times from the request to the robot's stop command (s)."""
    client, times = ManagerClient(ROBOT, "tests"), []
    request = urllib.request.Request(
        f"{address}/api/robots/stop", b'{"robots": []}',
        {"Authorization": f"Bearer {TOKENS['operate']}", "Content-Type": "application/json"}, method="POST",
    )  # fmt: skip
    skill = next(s for s in client.read_skills() if s.label == "wait_for_stop")
    for _ in range(count):
        before = len(cell.stopped())
        task = client.command("start", -1, [Step(skill.type, skill.label)])
        wait_until(lambda t=task: _moves(client, t), 60.0, "a moving robot")
        begin = time.monotonic()
        with urllib.request.urlopen(request, timeout=60.0) as answer:
            assert answer.status == 200
        stopped = wait_until(lambda n=before: cell.stopped()[n:], 60.0, "the stop")
        times.append(stopped[0] - begin)
        wait_until(lambda: not client.read_tasks(), 60.0, "the end of the task")
    client.close()
    return times


def _moves(client: ManagerClient, task: int) -> bool:
    return any(node.progress_message == "moving" for nodes in client.read_tasks(task) for node in nodes)


def summary(times: list[float]) -> dict[str, float]:
    """Returns median and percentiles (ms)."""
    ranked = sorted(times)
    at = {"p90_ms": 0.9, "p99_ms": 0.99, "max_ms": 1.0}
    found = {key: ranked[min(len(ranked) - 1, int(share * len(ranked)))] for key, share in at.items()}
    return {k: round(1000 * v, 1) for k, v in {"median_ms": statistics.median(times), **found}.items()}


# -- the process that makes the load -----------------------------------------------------------------------------------


class _Load:
    def __init__(self, port: int, orders: list[dict[str, Any]], report: Path) -> None:
        self._port, self._orders, self._report = port, orders, report
        self._answers = 0

    async def run(self) -> None:
        readers = [self._read(number) for number in range(READERS)]
        tabs = [self._follow() for _ in range(TABS)]
        planners = [self._plan(number) for number in range(PLANNERS)]
        await asyncio.gather(*readers, *tabs, *planners, self._put_jobs())

    async def _read(self, number: int) -> None:
        path = "/api/world" if number % 2 else "/api/state"
        while True:
            await self._request("GET", path, TOKENS["view"])

    async def _plan(self, number: int) -> None:
        token, goal = operator_token(number // 2), self._orders[number % 2]["parameters"]
        body = {"goal": f"(skiros:contain {goal['Place']} {goal['Product']})", "quality": "best"}
        while True:
            await self._request("POST", "/api/plan", token, body)

    async def _put_jobs(self) -> None:
        number = 0
        while True:
            order = {**self._orders[0], "id": f"load-{os.getpid()}-{number}", "start": False}
            await self._request("POST", "/api/jobs", TOKENS["operate"], order)
            number += 1

    async def _follow(self) -> None:
        reader, _ = await self._send("GET", "/api/live/patches?beats=true", TOKENS["view"])
        while await reader.readline():
            pass

    async def _request(self, method: str, path: str, token: str, body: Any = None) -> None:
        try:
            reader, writer = await self._send(method, path, token, body)
            await reader.read()
            writer.close()
        except OSError:
            await asyncio.sleep(0.1)
            return
        self._answers += 1
        if self._answers % 50 == 0:
            self._report.write_text(str(self._answers))

    async def _send(
        self, method: str, path: str, token: str, body: Any = None
    ) -> tuple[asyncio.StreamReader, asyncio.StreamWriter]:
        reader, writer = await asyncio.open_connection("127.0.0.1", self._port)
        data = b"" if body is None else json.dumps(body).encode()
        head = f"{method} {path} HTTP/1.1\r\nHost: 127.0.0.1\r\nConnection: close\r\nAuthorization: Bearer {token}\r\n"
        head += f"Content-Type: application/json\r\nContent-Length: {len(data)}\r\n\r\n"
        writer.write(head.encode() + data)
        await writer.drain()
        return reader, writer


if __name__ == "__main__":
    asyncio.run(_Load(int(sys.argv[1]), json.loads(sys.argv[2]), Path(sys.argv[3])).run())
