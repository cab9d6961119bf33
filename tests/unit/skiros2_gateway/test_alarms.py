"""Alarms of the live view: made of its document, acknowledged by persons."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from contextlib import asynccontextmanager
from typing import Any

import pytest

from skiros2_common.core.errors import Refused
from skiros2_gateway.core.access import Caller, Role
from skiros2_gateway.core.alarms import MAX_UNANSWERED
from skiros2_gateway.core.approvals import Approvals, Request
from skiros2_gateway.core.job import Method
from skiros2_gateway.core.live import LiveView
from skiros2_gateway.http.alarms import alarms_router
from skiros2_live.core.patch import TASK_MANAGER, Connection
from support.http_gateway import curl, served
from unit.skiros2_gateway.conftest import OPERATOR, TOKENS

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


def test_alarm_latches_until_its_cause_is_over_and_it_is_acknowledged(in_gateway: Run) -> None:
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
            stopped = next(alarm_id for alarm_id, alarm in view.alarms.items() if alarm["kind"] == "robot")
            await gateway.service.acknowledge(OPERATOR, [stopped], view.alarms)
            gateway.cell.document.apply(down.updated(True))
            gateway.events.publish("cell", {"robots": [{**robot, "state": "idle"}]})
            assert await kinds(view, 2) == {"bad": "job", TASK_MANAGER: "connection"}
            gateway.service.control.apply(Method.CLEAR, "bad", "test")
            await cleared(view, 2)
            await gateway.service.acknowledge(OPERATOR, list(view.alarms), view.alarms)
            assert await kinds(view, 0) == {}

    in_gateway(test)


async def cleared(view: LiveView, count: int) -> None:
    """Waits until the causes of `count` alarms, of all that there are, have gone away."""
    while ["cleared" in alarm for alarm in view.alarms.values()] != count * [True]:
        await asyncio.sleep(0.01)


def test_latched_alarm_survives_restarts_and_is_one_with_the_next_of_its_source(in_gateway: Run) -> None:
    async def test(gateway: Any) -> None:
        robot = {"name": "/robot", "state": "protective_stop", "reason": "light curtain", "since": 7.0}
        async with followed(gateway) as view:
            gateway.events.publish("cell", {"robots": [robot]})
            await kinds(view, 1)
        gateway.restart()
        async with followed(gateway) as view:  # the robot went on while there was no gateway
            gateway.events.publish("cell", {"robots": [{**robot, "state": "idle"}]})
            await cleared(view, 1)
            first = dict(view.alarms)
        gateway.restart()
        async with followed(gateway) as view:
            await cleared(view, 1)
            assert view.alarms == first
            gateway.events.publish("cell", {"robots": [{**robot, "since": 9.0}]})
            while "robot/robot@9.00" not in view.alarms:
                await asyncio.sleep(0.01)
            assert list(view.alarms) == ["robot/robot@9.00"]
            assert "cleared" not in view.alarms["robot/robot@9.00"]

    in_gateway(test)


AGENT, PERSON = Caller("agent", Role.AGENT, "mcp"), Caller("approve", Role.APPROVE, "rest", person=True)
ASKED = Request({"goal": "(at robot home)"})


def ask(gateway: Any) -> asyncio.Task[str]:
    return asyncio.get_running_loop().create_task(gateway.service.approvals.request(AGENT, ASKED))


@pytest.mark.parametrize("is_approved", [True, False])
def test_answered_request_is_no_alarm_any_more(in_gateway: Run, is_approved: bool) -> None:
    async def test(gateway: Any) -> None:
        async with followed(gateway) as view:
            asked = ask(gateway)
            [approval] = await kinds(view, 1)
            gateway.service.approvals.answer(PERSON, approval, is_approved)
            assert await kinds(view, 0) == {}
            await asyncio.gather(asked, return_exceptions=True)
        gateway.restart()
        async with followed(gateway) as view:
            assert await kinds(view, 0) == {}

    in_gateway(test)


def test_request_without_an_answer_is_an_alarm_until_it_is_acknowledged_also_after_restarts(in_gateway: Run) -> None:
    async def test(gateway: Any) -> None:
        async with followed(gateway) as view:
            with pytest.raises(Refused):
                await Approvals(gateway.events, timeout=0.05).request(AGENT, ASKED)
            await cleared(view, 1)
            gone = ask(gateway)
            await kinds(view, 2)
            gone.cancel()
            await cleared(view, 2)
            revoked = ask(gateway)
            await asyncio.sleep(0)
            gateway.service.approvals.withdraw(lambda caller: True)
            await cleared(view, 3)
            await asyncio.gather(revoked, return_exceptions=True)
            texts = [alarm["text"] for alarm in view.alarms.values()]
            for text in ("within 0.05 s", "the client has gone", "may not ask for it any more"):
                assert sum(text in each for each in texts) == 1
            waits = ask(gateway)
            await kinds(view, 4)
        gateway.restart()  # nobody can answer it any more
        async with followed(gateway) as view:
            await cleared(view, 4)
            await gateway.service.acknowledge(OPERATOR, list(view.alarms), view.alarms)
            assert await kinds(view, 0) == {}
        waits.cancel()

    in_gateway(test)


def test_requests_without_an_answer_push_out_no_other_alarm(in_gateway: Run) -> None:
    async def test(gateway: Any) -> None:
        async with followed(gateway) as view:
            robot = {"name": "/robot", "state": "protective_stop", "reason": "light curtain", "since": 7.0}
            gateway.events.publish("cell", {"robots": [robot]})
            await kinds(view, 1)
            gateway.events.publish("cell", {"robots": [{**robot, "state": "idle"}]})
            for _ in range(250):
                gone = ask(gateway)
                await asyncio.sleep(0)
                gone.cancel()
                await asyncio.gather(gone, return_exceptions=True)
            await cleared(view, MAX_UNANSWERED + 1)
            assert "robot/robot@7.00" in view.alarms

    in_gateway(test)


def test_part_that_has_not_answered_yet_is_no_alarm_once_it_answers(in_gateway: Run) -> None:
    async def test(gateway: Any) -> None:
        async with followed(gateway) as view:
            part = Connection(TASK_MANAGER, "/tm", False, 0.0)
            gateway.cell.document.apply(part)
            await kinds(view, 1)
            gateway.cell.document.apply(part.updated(True))
            assert await kinds(view, 0) == {}

    in_gateway(test)


def test_alarms_of_jobs_stay_when_newer_jobs_take_their_place_in_the_page(in_gateway: Run) -> None:
    async def test(gateway: Any) -> None:
        async with followed(gateway) as view:
            for number in range(60):  # more than the page has
                await gateway.put(f"bad-{number}")
                gateway.cell.run(f"bad-{number}")
                gateway.cell.end(f"bad-{number}", "failed", "slipped")
                await gateway.collected(f"bad-{number}")
                await asyncio.sleep(0)
            assert len(await kinds(view, 60)) == 60
            assert not [alarm for alarm in view.alarms.values() if "cleared" in alarm]

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
