"""Readers and writers of a gateway, in a process of its own: `python3 -m support.gateway_load PORT ORDERS SECONDS`.

Each sends a request once a second, at times of its own, as a page or a program of a factory does. Prints the times of
the answers (s) as JSON: {read, write}.
"""

from __future__ import annotations

import asyncio
import json
import random
import sys
import time
from collections.abc import Callable
from typing import Any

from support.job_cell import TOKENS

READERS, WRITERS = 100, 20
_PERIOD = 1.0  # s
_PATHS = ("/api/state", "/api/jobs?limit=50", "/api/live", "/api/alarms")


class Client:
    """A connection that stays open."""

    def __init__(self, port: int, role: str) -> None:
        self._port, self._role = port, role

    async def connect(self) -> None:
        self._reader, self._writer = await asyncio.open_connection("127.0.0.1", self._port, limit=2**26)

    async def request(self, method: str, path: str, body: Any = None) -> float:
        """Returns the time until the answer was there (s)."""
        data = b"" if body is None else json.dumps(body).encode()
        head = f"{method} {path} HTTP/1.1\r\nHost: 127.0.0.1\r\nAuthorization: Bearer {TOKENS[self._role]}\r\n"
        head += f"Content-Type: application/json\r\nContent-Length: {len(data)}\r\n\r\n"
        begin = time.monotonic()
        self._writer.write(head.encode() + data)
        answer = (await self._reader.readuntil(b"\r\n\r\n")).decode().lower()
        assert answer.split()[1] in ("200", "201"), answer
        await self._reader.readexactly(int(answer.partition("content-length: ")[2].split()[0]))
        return time.monotonic() - begin


async def load(port: int, order: dict[str, Any], seconds: float) -> dict[str, list[float]]:
    """Returns the times of the answers to readers and writers (s)."""
    end = time.monotonic() + seconds
    found: dict[str, list[float]] = {"read": [], "write": []}

    async def run(role: str, times: list[float], request: Callable[[Client, int], Any]) -> None:
        client = Client(port, role)
        await client.connect()
        number, due = 0, time.monotonic() + random.uniform(0.0, _PERIOD)
        while due < end:
            await asyncio.sleep(max(0.0, due - time.monotonic()))
            times.append(await request(client, number))
            number, due = number + 1, max(due + _PERIOD, time.monotonic())

    def reader(own: int) -> Callable[[Client, int], Any]:
        return lambda client, number: client.request("GET", _PATHS[(own + number) % len(_PATHS)])

    def writer(own: int) -> Callable[[Client, int], Any]:
        job = f"load-{time.time():.0f}-{own}-"
        return lambda client, number: client.request("POST", "/api/jobs", {**order, "id": f"{job}{number}"})

    readers = [run("view", found["read"], reader(own)) for own in range(READERS)]
    writers = [run("operate", found["write"], writer(own)) for own in range(WRITERS)]
    await asyncio.gather(*readers, *writers)
    return found


async def fill(port: int, order: dict[str, Any], count: int) -> None:
    """Stores jobs, from several connections."""

    async def put(own: int) -> None:
        client = Client(port, "operate")
        await client.connect()
        for number in range(own, count, WRITERS):
            await client.request("POST", "/api/jobs", {**order, "id": f"queued-{number}"})

    await asyncio.gather(*(put(own) for own in range(WRITERS)))


if __name__ == "__main__":
    json.dump(asyncio.run(load(int(sys.argv[1]), json.loads(sys.argv[2]), float(sys.argv[3]))), sys.stdout)
