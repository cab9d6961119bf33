"""A gateway with 100 readers, 20 writers and 10 000 queued jobs: times of answers, of stops, and CPU of a new job."""

from __future__ import annotations

import asyncio
import json
import os
import statistics
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from support.gateway_load import Client, fill
from support.job_cell import JobCell
from support.stop_load import stop_times, summary

#: What is wanted at most (ms).
_ANSWER_P99, _STOP_P99, _CREATE_CPU, _VISIBLE = 200.0, 100.0, 3.0, 100.0
_CREATED = 300  # jobs whose CPU is measured


def load(cell: JobCell, queued: int, seconds: float, stops: int) -> dict[str, Any]:
    """Measures an empty queue, and a full one. `above` names the figures that are above what is wanted."""
    cell.parameter("/gateway/opcua_address")  # OPC UA has started: it takes most of a core for some seconds
    row: dict[str, Any] = {"empty": _figures(cell, seconds, stops)}
    port, order = _port(cell), {**cell.order("", 0), "start": False}
    asyncio.run(fill(port, order, queued))
    row[f"queued_{queued}"] = full = _figures(cell, seconds, stops)
    full["single_ms"] = asyncio.run(_single(port, order))
    row["load_average"], row["above"] = os.getloadavg()[0], []
    for name, figures in list(row.items())[:2]:
        limits = {"answers": _ANSWER_P99, "stops": _STOP_P99}
        row["above"] += [f"{name}: {each}" for each, limit in limits.items() if figures[each]["p99_ms"] > limit]
        if figures["create_cpu_ms"] > _CREATE_CPU:
            row["above"].append(f"{name}: create_cpu_ms")
    row["above"] += [each for each, time in full["single_ms"].items() if time > _VISIBLE]
    return row


def _figures(cell: JobCell, seconds: float, stops: int) -> dict[str, Any]:
    port, order = _port(cell), {**cell.order("", 1), "start": False}
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(Path(__file__).parents[1]), *sys.path])}
    command = [sys.executable, "-m", "support.gateway_load", str(port), json.dumps(order), str(seconds)]
    with subprocess.Popen(command, env=environment, stdout=subprocess.PIPE) as process:
        stopped = stop_times(cell, stops, cell.parameter("/gateway/stop_address"))
        found = json.loads(process.communicate()[0])
    return {
        "answers": summary([*found["read"], *found["write"]]),
        "creates": summary(found["write"]),
        "stops": summary(stopped),
        "create_cpu_ms": round(asyncio.run(_create_cpu(cell, port, order)), 2),
    }


async def _create_cpu(cell: JobCell, port: int, order: dict[str, Any]) -> float:
    """Returns the CPU that the gateway takes for a new job, beside what it takes without requests (ms)."""
    pid, client = cell.gateway.pid, Client(port, "operate")
    await client.connect()
    begin, loop = _cpu(pid), asyncio.get_running_loop()
    await asyncio.sleep(2.0)
    idle = (_cpu(pid) - begin) / 2.0
    begin, start = _cpu(pid), loop.time()
    for number in range(_CREATED):
        await client.request("POST", "/api/jobs", {**order, "id": f"cpu-{start:.0f}-{number}"})
    await asyncio.sleep(1.0)  # what follows it, such as lists
    return 1000.0 * (_cpu(pid) - begin - idle * (loop.time() - start)) / _CREATED


async def _single(port: int, order: dict[str, Any]) -> dict[str, float]:
    """Returns the medians of times of single requests (ms)."""
    client = Client(port, "operate")
    await client.connect()
    requests: dict[str, Callable[[int], Any]] = {
        "list": lambda number: client.request("GET", "/api/jobs?limit=100"),
        "state": lambda number: client.request("GET", "/api/state"),
        "page": lambda number: client.request("GET", "/api/live"),
        "create": lambda number: client.request("POST", "/api/jobs", {**order, "id": f"single-{number}"}),
    }
    return {
        name: round(1000.0 * statistics.median([await request(number) for number in range(20)]), 1)
        for name, request in requests.items()
    }


def _cpu(pid: int) -> float:
    """Returns the CPU time of a process (s)."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def _port(cell: JobCell) -> int:
    return int(cell.rest.address.rpartition(":")[2])
