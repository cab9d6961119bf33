"""A job that ends while the gateway is dead: all interfaces and figures have its end."""

from __future__ import annotations

import asyncio
import json
import subprocess
from collections import Counter
from collections.abc import Iterator
from typing import Any

import pytest

from skiros2_factory_demo.mes import OpcuaChannel
from skiros2_gateway.opcua.model import NAMESPACE
from skiros2_msgs import msg as msgs
from support.broker import broker, needs_broker
from support.job_cell import TOKENS, JobCell, job_cell
from support.programs import PATIENCE, ProcessId
from support.ros import RosMaster, wait_until

pytestmark = [needs_broker, pytest.mark.timeout(600)]


@pytest.fixture(scope="module")
def port() -> Iterator[int]:
    """A broker's port."""
    with broker() as port:
        yield port


@pytest.fixture(scope="module")
def cell(ros_master: RosMaster, port: int, tmp_path_factory: pytest.TempPathFactory) -> Iterator[JobCell]:
    settings = {"skill": "carry_when_released", "mqtt": f"127.0.0.1:{port}", "opcua_port": 0}
    with job_cell(ros_master, tmp_path_factory.mktemp("killed"), **settings) as made:
        yield made


@pytest.mark.parametrize(("product", "outcome", "state"), [(0, "succeeded", "Ended"), (1, "failed", "Aborted")])
def test_end_of_a_job_while_the_gateway_is_dead_is_counted_and_published(
    cell: JobCell, port: int, product: int, outcome: str, state: str
) -> None:
    before, job_id, released = _counters(cell), f"job-{outcome}", cell.folder / "released"
    released.unlink(missing_ok=True)
    results = cell.ros.messages("/tm/achieve/result", msgs.AchieveActionResult).connected()
    assert cell.rest.post("/api/jobs", cell.order(job_id, product))[0] == 201
    wait_until(lambda: cell.rest.get(f"/api/jobs/{job_id}")["response"]["steps"], what="a running step")
    wait_until(lambda: '"Running"' in _retained(port, f"job/{job_id}/state"), what="the state at the broker")

    process = ProcessId(cell.gateway.pid)
    process.kill()
    process.wait()
    wait_until(lambda: _retained(port, "status") == "offline", what="the last will")
    released.write_text("fail" if outcome == "failed" else "")
    results.wait_for(lambda message: message.status.goal_id.id == job_id)
    assert '"Running"' in _retained(port, f"job/{job_id}/state")
    cell.replace("/gateway", processes=[])

    job = cell.wait_for([job_id])[job_id]
    assert (job["state"], job["response"]["outcome"]) == (state, outcome)
    wait_until(lambda: f'"{state}"' in _retained(port, f"job/{job_id}/state"), what="the state at the broker")
    response = json.loads(wait_until(lambda: _retained(port, f"job/{job_id}/response"), what="the response"))
    assert (response["outcome"], response["steps"]) == (outcome, job["response"]["steps"])
    assert asyncio.run(_opcua_response(cell, job_id))["outcome"] == outcome
    ends = Counter(step["state"] for step in job["response"]["steps"])
    assert ends[outcome] > 0
    wait_until(lambda: _counters(cell) == before + ends, what=f"{before} + {ends}, not {_counters(cell)}")
    assert {"outcome": outcome, "jobs": 1} in cell.rest.get("/api/figures")["jobs"]


def _counters(cell: JobCell) -> Counter[str]:
    found = cell.rest.get("/api/state")["robots"][0]["counters"]
    return Counter({name: found[name] for name in ("succeeded", "failed")})


def _retained(port: int, topic: str) -> str:
    """Returns what the broker retains; "" for nothing."""
    command = ["mosquitto_sub", "-p", str(port), "-t", f"skiros2/{topic}", "-C", "1", "-W", "1", "--retained-only"]
    return subprocess.run(command, capture_output=True, text=True).stdout.strip()


async def _opcua_response(cell: JobCell, job_id: str) -> dict[str, Any]:
    address = cell.parameter("/gateway/opcua_address")
    channel = await OpcuaChannel.connect(address, "operate", TOKENS["operate"], NAMESPACE)
    try:
        return await asyncio.wait_for(channel.response(job_id), PATIENCE)
    finally:
        await channel.close()
