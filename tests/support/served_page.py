"""The gateway's page with a stand-in cell: what needs a person, without nodes."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable, Coroutine, Iterator
from contextlib import asynccontextmanager, contextmanager
from pathlib import Path
from typing import Any

from anyio.from_thread import start_blocking_portal

from skiros2_gateway.agents.server import AgentServer
from skiros2_gateway.core.access import AGENTS, Caller, Role
from skiros2_gateway.core.approvals import Approvals, Ending, Request
from skiros2_gateway.core.bags import Bags
from skiros2_gateway.core.figures import Figures
from skiros2_gateway.core.live import LiveView
from skiros2_gateway.core.other_cells import OtherCell, OtherCells
from skiros2_gateway.http.alarms import alarms_router
from skiros2_gateway.http.cameras import cameras_router
from skiros2_gateway.http.figures import figures_router
from skiros2_gateway.http.live import live_router, page_router
from skiros2_gateway.http.other_cells import other_cells_router
from skiros2_live.core.patch import TASK_MANAGER, Connection, EntriesChanged, TaskProgress
from support.http_gateway import served
from support.pictures import StandInCameras
from support.progress import FAILURE, SUCCESS, pick_and_place
from unit.skiros2_gateway.conftest import TOKENS, Gateway
from unit.skiros2_gateway.test_live_http import _Cell

ROBOTS = (
    {"name": "/arm", "state": "protective_stop", "reason": "light curtain 2", "since": 1.0, "tasks": []},
    {"name": "/mobile_base", "state": "busy", "reason": "", "since": 1.0, "tasks": [{"id": 1, "label": "drive"}]},
)
#: By id: cameras of the scene, the second one without pictures, and a robot with a signal of each robot.
CAMERAS = {"skiros:DepthCamera-1": "Camera above the shelf", "skiros:DepthCamera-2": "Camera at the gripper"}
ELEMENTS = {
    **{
        eid: {"id": eid, "type": "skiros:DepthCamera", "label": label, "relations": [],
              "properties": {"skiros:RgbTopic": [f"/camera_{number}/image"]}}
        for number, (eid, label) in enumerate(CAMERAS.items(), 1)
    },
    "cora:Robot-3": {"id": "cora:Robot-3", "type": "cora:Robot", "label": "arm", "relations": [],
                     "properties": {"skiros:SkillMgr": ["arm"]}},
}  # fmt: skip
SIGNALS = {
    "skiros:Signal-4": {
        "name": "Force at the tool",
        "unit": "N",
        "robot": "/arm",
        "value": 4.2,
        "low": 4.0,
        "high": 5.0,
    },
    "skiros:Signal-5": {
        "name": "Battery",
        "unit": "%",
        "robot": "/mobile_base",
        "value": 81.0,
        "low": 81.0,
        "high": 81.0,
    },
}
#: Changes a gateway and its live view.
Activity = Callable[[Gateway, LiveView], Coroutine[Any, Any, Any]]
COUNTERS = {"succeeded": 12, "failed": 1, "oee": 0.81}


async def fill(gateway: Any) -> None:
    """Has jobs end, run and wait; stops a robot, and loses the task manager, and the world model for a while."""
    gateway.now = 1_795_870_338.0
    for job_id, outcome, message in (
        ("order-1", "succeeded", ""),
        (
            "order-2",
            "failed",
            "The gripper is empty after the pick: Product-2 has slipped.\npick: expected a held part",
        ),
        ("order-3", "cancelled", "Stop by operate"),
    ):
        gateway.now += 60.0
        await gateway.put(job_id, work_master="place", parameters={"Tray": "Tray-1"})
        gateway.cell.run(job_id)
        gateway.cell.end(job_id, outcome, message)
        await gateway.collected(job_id)
    station = Caller("station", Role.OPERATE, "opcua")
    measured = {"id": "m-1", "job": "order-2", "description": "Weighing", "values": {"weight": 0.4}}
    await gateway.service.receive(station, measured)
    await gateway.put("order-4", work_master="place", parameters={"Tray": "Tray-1"})
    gateway.cell.run("order-4")
    await gateway.put("order-5", work_master="place", parameters={"Tray": "Tray-1"}, priority=3)
    await gateway.put("order-6", work_master="place", parameters={"Tray": "Tray-1"}, description="Refill the shelf")
    await gateway.put("order-7", work_master="place", parameters={"Tray": "Tray-1"}, description="Clear the shelf")
    gateway.cell.document.apply(Connection(TASK_MANAGER, "/tm", False, gateway.now, "It has ended with status 1."))
    lost = {"kind": "connection", "source": "world model", "text": "the connection is lost", "since": gateway.now - 300}
    asked = {"kind": "approval", "source": "1", "text": "agent asks for an approval", "since": gateway.now - 300}
    gateway.service.alarms.listed({"connection/world model@1": lost, "approval/1@1": asked})
    gateway.service.alarms.approval_has_ended("1", Ending.EXPIRED, "nobody has approved it within 300 s")
    gateway.cell.document.apply(EntriesChanged("elements", ELEMENTS))
    now = gateway.cell.document.clock()
    signals = {eid: {**signal, "time": now} for eid, signal in SIGNALS.items()}
    gateway.cell.document.apply(EntriesChanged("signals", signals))
    state = {"robots": [{**robot, "counters": COUNTERS} for robot in ROBOTS], "ready": True, "capacity": 1}
    gateway.cell.state = lambda: state


def ask(gateway: Any) -> asyncio.Task[str]:
    """Has an agent ask for an approval."""
    step = {"label": "place", "robot": "/arm", "arguments": {"Product": "Product-2", "Tray": "Tray-1"}}
    runs = {"goal": "(skiros:contain Tray-1 Product-2)", "plan": [step]}
    shown = {"changes": ["Tray-1 contains Product-2", "Shelf-3 no longer contains Product-2"]}
    caller = Caller("agent", Role.OPERATE, AGENTS)
    request = Request(runs, shown, ("/arm",), "The order of the customer is due at noon.")
    return asyncio.get_running_loop().create_task(gateway.service.approvals.request(caller, request))


@contextmanager
def served_page(folder: Path, page: Path, activity: Activity | None = None) -> Iterator[str]:
    """Serves the page in a thread with a loop of its own; yields the address.

    :param page: the folder of the bundle.
    :param activity: runs in the loop meanwhile.
    """

    @asynccontextmanager
    async def serve() -> AsyncIterator[str]:
        gateway = Gateway(folder / "jobs.sqlite", capacity=1, rate=1e9)
        gateway.service.approvals = Approvals(gateway.events, is_needed=True, timeout=300.0)
        await fill(gateway)
        view = LiveView(gateway.cell.document)
        figures = Figures(gateway.store, gateway.cell.document)
        for number in range(5):
            robot, stamp = "/arm", gateway.cell.document.clock()
            gateway.cell.document.apply(TaskProgress(robot, pick_and_place(task_id=number), stamp))
            last = pick_and_place(SUCCESS, SUCCESS, task_id=number, state=SUCCESS if number else FAILURE, code=1)
            gateway.cell.document.apply(TaskProgress(robot, last, stamp + 12.5))
        tasks: list[asyncio.Task[Any]] = [asyncio.create_task(view.follow(gateway.service)), ask(gateway)]
        if activity is not None:
            tasks.append(asyncio.create_task(activity(gateway, view)))
        agents = AgentServer(gateway.service).router()
        routers = [live_router(view, _Cell(), Bags(None)), alarms_router(view), figures_router(figures.write)]
        cells = [OtherCell(name="Line 3", address="http://127.0.0.1:9", token="")]
        routers.append(cameras_router(view, StandInCameras()))
        routers += [agents, page_router(page), other_cells_router(OtherCells(cells))]
        async with served(gateway.service, routers=routers) as address:
            cells.insert(0, OtherCell(name="Line 2", address=address, token=TOKENS["view"]))
            yield address
        for task in tasks:
            task.cancel()

    with start_blocking_portal() as portal, portal.wrap_async_context_manager(serve()) as address:
        yield address
