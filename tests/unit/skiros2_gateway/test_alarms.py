"""Alarms of the live view: made of its document, acknowledged by persons."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from contextlib import asynccontextmanager
from typing import Any

from skiros2_gateway.core.live import LiveView
from skiros2_gateway.http.alarms import alarms_router
from skiros2_live.core.patch import TASK_MANAGER, Connection
from support.http_gateway import curl, served
from unit.skiros2_gateway.conftest import TOKENS

Run = Callable[..., None]


@asynccontextmanager
async def followed(gateway: Any) -> Any:
    """A live view that follows the gateway."""
    view = LiveView(gateway.cell.document)
    task = asyncio.get_running_loop().create_task(view.follow(gateway.service))
    try:
        await asyncio.sleep(0)
        yield view
    finally:
        task.cancel()


async def kinds(view: LiveView, count: int) -> dict[str, str]:
    """Returns the kinds of alarms by their sources, once there are `count`."""
    while len(view.alarms) != count:
        await asyncio.sleep(0.01)
    return {alarm["source"]: alarm["kind"] for alarm in view.alarms.values()}


def test_what_needs_a_person_is_an_alarm_until_it_is_over(in_gateway: Run) -> None:
    async def test(gateway: Any) -> None:
        async with followed(gateway) as view:
            for job_id, outcome in (("good", "succeeded"), ("bad", "failed"), ("unwanted", "cancelled")):
                await gateway.put(job_id)
                gateway.cell.run(job_id)
                gateway.cell.end(job_id, outcome, "the gripper is empty")
                await gateway.collected(job_id)
            down = Connection(TASK_MANAGER, "/tm", False, 5.0)
            gateway.cell.document.apply(down)
            robot = {"name": "/robot", "state": "protective_stop", "reason": "light curtain", "since": 7.0}
            gateway.events.publish("cell", {"robots": [robot]})
            assert await kinds(view, 3) == {"bad": "job", TASK_MANAGER: "connection", "/robot": "robot"}
            texts = {alarm["text"] for alarm in view.alarms.values()}
            assert {"the gripper is empty", "protective stop: light curtain"} <= texts
            gateway.cell.document.apply(down.updated(True))
            gateway.events.publish("cell", {"robots": [{**robot, "state": "idle"}]})
            assert await kinds(view, 1) == {"bad": "job"}
            gateway.service.control.apply("Clear", "bad", "test")
            assert await kinds(view, 0) == {}

    in_gateway(test)


def test_acknowledged_alarm_has_the_user_also_after_a_restart(in_gateway: Run) -> None:
    async def test(gateway: Any) -> None:
        await gateway.put("bad")
        gateway.cell.run("bad")
        gateway.cell.end("bad", "failed")
        await gateway.collected("bad")
        async with followed(gateway) as view, served(gateway.service, routers=[alarms_router(view)]) as address:
            await kinds(view, 1)

            async def acknowledge(alarm: str, user: str) -> int:
                body = {"alarms": [alarm]}
                return (await curl(address, "/api/alarms/acknowledge", token=TOKENS[user], body=body))[0]

            [alarm] = (await curl(address, "/api/alarms", token=TOKENS["view"]))[1]["alarms"]
            assert (alarm["source"], "acknowledged" in alarm) == ("bad", False)
            assert await acknowledge(alarm["id"], "view") == 403
            assert await acknowledge("job/other@1", "operate") == 404
            assert await acknowledge(alarm["id"], "operate") == 200
            while "acknowledged" not in view.alarms[alarm["id"]]:
                await asyncio.sleep(0.01)
        gateway.restart()
        async with followed(gateway) as view:
            await kinds(view, 1)
            assert view.alarms[alarm["id"]]["acknowledged"]["user"] == "operate"

    in_gateway(test)
