"""A gateway without ROS: a store in a folder of the test, a stand-in for the cell."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine, Iterator
from pathlib import Path
from typing import Any

import pytest

from skiros2_gateway.core.access import Access, Caller, Role, User
from skiros2_gateway.core.events import EventStream
from skiros2_gateway.core.job import Job, read_order
from skiros2_gateway.core.job_control import JobControl
from skiros2_gateway.core.service import Service
from skiros2_gateway.core.store import JobStore
from skiros2_gateway.core.work_masters import WorkMaster, WorkMasters
from support.stand_in_cell import StandInCell

PLACE = WorkMaster.model_validate(
    {
        "id": "place",
        "goal": "(skiros:contain {Tray} {Product})",
        "parameters": [
            {"id": "Tray", "type": "demo:Tray"},
            {"id": "Product", "type": "skiros:Product", "default": "Product-2"},
            {"id": "Speed", "type": "number", "default": 1.0, "minimum": 0.1, "maximum": 2.0, "unit": "m/s"},
        ],
        "quality": [{"element": "Product", "property": "skiros:Weight"}],
    }
)

ROLES = ("agent", "view", "operate", "approve", "maintain")
TOKENS = {name: f"{name}-0123456789abcdef" for name in ROLES}
PERSONS = ("approve", "maintain")


class Gateway:
    """A gateway with a stand-in cell; `restart` is what a kill and a new start do."""

    def __init__(self, path: Path, capacity: int = 1, rate: float = 1e4) -> None:
        self.path = path
        self.capacity = capacity
        self.rate = rate
        self.now = 1000.0
        self.restart()

    def restart(self) -> None:
        self.store = JobStore(self.path)
        self.events = EventStream()
        self.control = JobControl(self.store, WorkMasters([PLACE]), self.events, lambda: self.now)
        users = [User(name=n, role=n, token=t, person=n in PERSONS) for n, t in TOKENS.items()]
        self.access = Access(users, self.store, self.rate, self.rate)
        self.service = Service(self.store, self.access, self.control, self.events)
        self.cell = StandInCell(self.control, self.capacity)
        self.control.start(self.cell)

    async def put(self, job_id: str, *, start: bool = True, **order: Any) -> Job:
        order = order if "work_master" in order else {"goal": "(at robot home)", **order}
        job, _ = await self.control.put(read_order({"id": job_id, **order}), "test", start=start)
        await self.store.synced()
        return job

    def job(self, job_id: str) -> Job:
        return self.control.get(job_id)

    def state(self, job_id: str) -> str:
        job = self.job(job_id)
        return f"{job.state}/{job.substate}" if job.substate else str(job.state)

    async def collected(self, job_id: str) -> Job:
        """Waits until the response of an ended job is complete."""
        while not self.job(job_id).response.collected:
            await asyncio.sleep(0)
        return self.job(job_id)


OPERATOR = Caller("operate", Role.OPERATE, "rest")
VIEWER = Caller("view", Role.VIEW, "rest")


@pytest.fixture
def in_gateway(tmp_path: Path) -> Callable[..., None]:
    """Runs a coroutine function with a gateway."""

    def run(test: Callable[[Gateway], Coroutine[Any, Any, None]], **options: Any) -> None:
        async def main() -> None:
            await test(Gateway(tmp_path / "jobs.sqlite", **options))

        asyncio.run(asyncio.wait_for(main(), 100.0))

    return run


@pytest.fixture(scope="session")
def in_server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Callable[..., None]]:
    """Runs coroutine functions with a gateway that has an OPC UA server at `address`; one for all tests, it is slow."""
    from support.opcua import opcua_server  # imports for a second

    folder = tmp_path_factory.mktemp("opcua")
    with asyncio.Runner() as runner:

        async def start() -> tuple[Any, Any]:
            gateway: Any = Gateway(folder / "jobs.sqlite", capacity=100)
            server = opcua_server(gateway.service, folder)
            await server.start()
            gateway.address = server.address
            return gateway, server

        gateway, server = runner.run(start())
        yield lambda test: runner.run(asyncio.wait_for(test(gateway), 60.0))
        runner.run(server.stop())
