"""Approvals under attack: who answers, what runs afterwards, clients that go or repeat themselves, limits."""

from __future__ import annotations

import asyncio
import json
import socket
from collections.abc import Callable
from typing import Any

import httpx2
import pytest
from mcp import Client
from mcp.client.streamable_http import streamable_http_client

from skiros2_common.core.errors import Refused, UnknownName
from skiros2_gateway.agents.server import AgentServer
from skiros2_gateway.core.access import Caller, Role
from skiros2_gateway.core.approvals import MAX_OPEN, MAX_OPEN_OF_USER, Approvals, Request
from skiros2_gateway.core.events import EventStream
from skiros2_gateway.core.job import read_order
from skiros2_gateway.core.users import User
from skiros2_gateway.core.work_masters import WorkMasters
from skiros2_gateway.http.server import Limits
from support.http_gateway import curl, served
from support.stand_in_cell import ROBOT, STEP
from unit.skiros2_gateway.conftest import PERSONS, PLACE, TOKENS
from unit.skiros2_gateway.test_agents import GOAL, answered, connected, waiting

Run = Callable[..., None]
SKILL = {"robot": ROBOT, "skill": "place", "parameters": {"Tray": "Tray-1"}}
ASKED = Request({"goal": "(at robot home)"})
#: Of Linux; not in Python's `socket`.
_TCP_REPAIR = 19


def caller(name: str, role: Role = Role.AGENT, *, person: bool = False) -> Caller:
    return Caller(name, role, "mcp", person)


def test_only_an_account_marked_as_a_person_answers(in_gateway: Run) -> None:
    async def test(gateway: Any) -> None:
        programs = [User(name=name, role=name, token=token) for name, token in TOKENS.items()]
        gateway.access.set_users(programs)
        async with connected(gateway, "agent") as agent:
            execution = asyncio.create_task(agent.call("execute", **GOAL))
            (approval,) = await waiting(gateway)
            for token in TOKENS.values():
                path = f"/api/approvals/{approval.id}/approve"
                assert (await curl(agent.address, path, "-X", "POST", token=token))[0] == 403
            person = User(name="boss", role="approve", token="boss-0123456789abcdef", person=True)
            gateway.access.set_users([*programs, person])
            assert (await curl(agent.address, path, "-X", "POST", token=person.token))[0] == 200
            await execution
            assert gateway.job("a").approved["by"] == "boss"

    in_gateway(test)


def test_approved_plan_is_what_runs(in_gateway: Run) -> None:
    async def test(gateway: Any) -> None:
        async with connected(gateway, "agent") as agent:
            execution = asyncio.create_task(agent.call("execute", **GOAL, reason="the tray is needed"))
            (approval,) = await waiting(gateway)
            shown = (await curl(agent.address, "/api/approvals", token=TOKENS["view"]))[1]["approvals"][0]
            assert (shown["reason"], shown["robots"]) == ("the tray is needed", [ROBOT])
            assert shown["digest"] == approval.request.digest
            path = f"/api/approvals/{shown['id']}/approve"
            token = TOKENS["approve"]
            other = await curl(agent.address, path, token=token, body={"digest": "0" * 64})
            assert (other[0], other[1]["code"]) == (409, "conflict")
            assert (await curl(agent.address, path, token=token, body={"digest": shown["digest"]}))[0] == 200
            await execution
            assert gateway.cell.sent[0].plan == (STEP,)
            gateway.store.close()
            gateway.restart()  # also after a restart
            assert gateway.job("a").approved == {
                "goal": GOAL["goal"], "plan": [STEP], "digest": shown["digest"], "by": "approve",
            }  # fmt: skip

    in_gateway(test)


def test_job_whose_work_master_has_changed_since_its_approval_is_refused(in_gateway: Run) -> None:
    async def test(gateway: Any) -> None:
        async with connected(gateway, "agent") as agent:
            order = {"id": "a", "work_master": "place", "parameters": {"Tray": "Tray-1"}}
            execution = asyncio.create_task(agent.call("execute", **order))
            await waiting(gateway)
            gateway.control.masters = WorkMasters([PLACE.model_copy(update={"goal": "(skiros:at {Tray} {Product})"})])
            await answered(agent, gateway)
            result = await execution
            assert result["code"] == "refused"
            goal = '(skiros:at "Tray-1" "Product-2")'
            assert f"the goal is {goal}, approved is (skiros:contain" in result["detail"]
            approved = {"goal": goal, "plan": [{**STEP, "robot": "/other"}]}
            with pytest.raises(Refused, match="/other is not allowed any more"):
                changed = read_order({**order, "robots": [ROBOT]})
                await gateway.control.put(changed, "agent", start=True, approved=approved)
            assert not list(gateway.store.jobs())

    in_gateway(test)


def test_skill_that_would_start_with_another_element_than_approved_is_refused(in_gateway: Run) -> None:
    async def test(gateway: Any) -> None:
        async with connected(gateway, "agent") as agent:
            gateway.cell.inferred = {"Object": "Product-2"}
            execution = asyncio.create_task(agent.call("execute", **SKILL))
            await waiting(gateway)
            gateway.cell.inferred = {"Object": "Product-3"}
            await answered(agent, gateway)
            result = await execution
            assert result["code"] == "refused"
            assert "Object is Product-3, approved is Product-2" in result["detail"]
            assert not gateway.cell.skill_runs

    in_gateway(test)


def test_skill_that_would_change_something_else_than_approved_is_refused(in_gateway: Run) -> None:
    async def test(gateway: Any) -> None:
        async with connected(gateway, "agent") as agent:
            gateway.cell.inferred = {"Object": "Product-2"}
            execution = asyncio.create_task(agent.call("execute", **SKILL))
            (approval,) = await waiting(gateway)
            gateway.cell.place = "Tray-1"
            await answered(agent, gateway)
            result = await execution
            assert result["code"] == "refused"
            assert "+ Product-2 skiros:at Tray-1: not approved" in result["detail"]
            assert f"+ Product-2 skiros:at {ROBOT}: approved, not expected any more" in result["detail"]
            assert not gateway.cell.skill_runs
            other = asyncio.create_task(agent.call("execute", **SKILL))
            (changed,) = await waiting(gateway)
            assert changed.request.digest != approval.request.digest
            await answered(agent, gateway)
            assert (await other)["task"] == 0

    in_gateway(test)


def test_approval_of_a_skill_shows_values_and_changes_and_starts_with_exactly_these(in_gateway: Run) -> None:
    async def test(gateway: Any) -> None:
        async with connected(gateway, "agent") as agent:
            gateway.cell.inferred = {"Object": "Product-2"}
            execution = asyncio.create_task(agent.call("execute", **SKILL))
            await waiting(gateway)
            (shown,) = (await curl(agent.address, "/api/approvals", token=TOKENS["view"]))[1]["approvals"]
            values = {"Tray": "Tray-1", "Object": "Product-2", "Speed": 1.0}
            assert shown["what"]["values"] == values
            assert shown["what"]["changes"] == [f"+ Product-2 skiros:at {ROBOT}"]
            await answered(agent, gateway)
            await execution
            assert gateway.cell.started == [values]
            run = await agent.call("explain", robot=ROBOT, task=0)
            assert run["parameters"] == SKILL["parameters"]  # a retry finds the others again

    in_gateway(test)


def test_request_whose_client_was_killed_is_withdrawn(in_gateway: Run) -> None:
    async def test(gateway: Any) -> None:
        async with connected(gateway, "agent") as agent:
            call = {"name": "execute", "arguments": GOAL}
            body = json.dumps({"jsonrpc": "2.0", "id": 1, "method": "tools/call", "params": call})
            headers = ["Accept: application/json, text/event-stream", f"Authorization: Bearer {TOKENS['agent']}"]
            options = [part for header in (*headers, "Content-Type: application/json") for part in ("-H", header)]
            client = await asyncio.create_subprocess_exec(
                "curl", "-s", *options, "-d", body, f"{agent.address}/mcp", stdout=asyncio.subprocess.DEVNULL
            )
            (approval,) = await waiting(gateway)
            client.kill()
            await client.wait()
            await waiting(gateway, 0)
            path = f"/api/approvals/{approval.id}/approve"
            assert (await curl(agent.address, path, "-X", "POST", token=TOKENS["approve"]))[0] == 404
            assert not list(gateway.store.jobs())
            assert not gateway.cell.sent

    in_gateway(test)


@pytest.mark.parametrize("change", ["removed", "token", "role"])
def test_request_of_a_revoked_agent_is_withdrawn(in_gateway: Run, change: str) -> None:
    async def test(gateway: Any) -> None:
        async with connected(gateway, "agent") as agent:
            users = {n: User(name=n, role=n, token=t, person=n in PERSONS) for n, t in TOKENS.items()}
            if change == "removed":
                del users["agent"]
            else:
                new = {"token": "another-0123456789"} if change == "token" else {"role": "view"}
                users["agent"] = users["agent"].model_copy(update=new)
            call = asyncio.create_task(agent.call("execute", **GOAL))
            (approval,) = await waiting(gateway)
            gateway.service.set_users(list(users.values()))
            assert "may not ask for it any more" in (await call)["detail"]
            path = f"/api/approvals/{approval.id}/approve"
            assert (await curl(agent.address, path, "-X", "POST", token=TOKENS["approve"]))[0] == 404
            assert not gateway.cell.sent

    in_gateway(test)


def test_agent_that_is_revoked_while_its_plan_is_made_asks_for_nothing(in_gateway: Run) -> None:
    async def test(gateway: Any) -> None:
        is_planning, may_end, plan = asyncio.Event(), asyncio.Event(), gateway.cell.plan

        async def slow_plan(goal: str, quality: str = "") -> dict[str, Any]:
            is_planning.set()
            await may_end.wait()
            return dict(await plan(goal, quality))

        gateway.cell.plan = slow_plan
        async with connected(gateway, "agent", is_needed=False) as agent:
            call = asyncio.create_task(agent.call("execute", **GOAL))
            await is_planning.wait()
            gateway.service.set_users([User(name="boss", role="maintain", token="boss-0123456789abcdef")])
            may_end.set()
            assert (await call)["code"] == "unauthenticated"
            assert not gateway.cell.sent

    in_gateway(test)


def test_request_of_a_client_without_power_is_withdrawn(in_gateway: Run) -> None:
    async def test(gateway: Any) -> None:
        gateway.service.approvals = Approvals(gateway.events)
        server = AgentServer(gateway.service)
        limits = Limits(silence=4)
        async with server.running(), served(gateway.service, routers=[server.router()], limits=limits) as address:
            call = {"name": "execute", "arguments": GOAL}
            body = json.dumps({"jsonrpc": "2.0", "id": 1, "method": "tools/call", "params": call})
            head = [
                "POST /mcp HTTP/1.1", f"Host: {address[7:]}", "Accept: application/json, text/event-stream",
                f"Authorization: Bearer {TOKENS['agent']}", "Content-Type: application/json",
                f"Content-Length: {len(body)}",
            ]  # fmt: skip
            host, port = address[7:].split(":")
            client = socket.create_connection((host, int(port)))
            await asyncio.to_thread(client.sendall, ("\r\n".join([*head, "", body])).encode())
            await waiting(gateway)
            try:
                client.setsockopt(socket.IPPROTO_TCP, _TCP_REPAIR, 1)  # it is closed without a word to the server
            except PermissionError:
                pytest.skip("needs CAP_NET_ADMIN")
            client.close()
            await waiting(gateway, 0)
            assert not gateway.cell.sent

    in_gateway(test)


@pytest.mark.parametrize("mode", ["auto", "legacy"])
def test_request_whose_client_has_timed_out_is_withdrawn(in_gateway: Run, mode: str) -> None:
    async def test(gateway: Any) -> None:
        async with connected(gateway, "agent") as agent:
            headers = {"Authorization": f"Bearer {TOKENS['agent']}"}
            async with (
                httpx2.AsyncClient(headers=headers, timeout=60.0) as http,
                Client(streamable_http_client(f"{agent.address}/mcp", http_client=http), mode=mode) as client,
            ):
                call = asyncio.create_task(client.call_tool("execute", GOAL, read_timeout_seconds=1.0))
                await waiting(gateway)
                with pytest.raises(Exception, match=r"(?i)time"):
                    await call
                await waiting(gateway, 0)  # although the client is still connected
                assert not gateway.cell.sent
                await client.call_tool("history", {})  # the answer to the first call has come, too

    in_gateway(test)


def test_repeated_call_shares_approval_and_job(in_gateway: Run) -> None:
    async def test(gateway: Any) -> None:
        async with connected(gateway, "agent") as agent:
            calls = [asyncio.create_task(agent.call("execute", **GOAL)) for _ in range(3)]
            await waiting(gateway)
            await asyncio.sleep(0.1)
            await answered(agent, gateway)
            assert [(await call)["job"] for call in calls] == ["a"] * 3
            assert (await agent.call("execute", **GOAL))["job"] == "a"  # without another approval
            assert [goal.id for goal in gateway.cell.sent] == ["a"]

    in_gateway(test)


def test_skill_with_a_key_starts_once(in_gateway: Run) -> None:
    async def test(gateway: Any) -> None:
        async with connected(gateway, "agent") as agent:
            calls = [asyncio.create_task(agent.call("execute", **SKILL, key="k")) for _ in range(2)]
            await answered(agent, gateway)
            assert [(await call)["task"] for call in calls] == [0, 0]
            assert (await agent.call("execute", **SKILL, key="k"))["task"] == 0
            other = await agent.call("execute", **{**SKILL, "parameters": {}}, key="k")
            assert other["code"] == "conflict"
            assert len(gateway.cell.skill_runs) == 1

    in_gateway(test)


def test_one_client_that_goes_does_not_withdraw_the_request_of_another(in_gateway: Run) -> None:
    async def test(gateway: Any) -> None:
        async with connected(gateway, "agent") as agent:
            keys = gateway.service.keys

            async def ask() -> str:
                return await gateway.service.approvals.request(caller("agent"), ASKED)

            calls = [asyncio.create_task(keys.once("agent", "k", [], ask)) for _ in range(2)]
            await waiting(gateway)
            calls[0].cancel()
            await asyncio.sleep(0)
            await answered(agent, gateway)
            assert await calls[1] == "approve"

    in_gateway(test)


def test_open_requests_are_limited() -> None:
    async def test() -> None:
        approvals = Approvals(EventStream())
        names = [f"agent-{i}" for i in range(MAX_OPEN // MAX_OPEN_OF_USER + 1)]
        asking = [asyncio.create_task(approvals.request(caller(name), ASKED)) for name in names for _ in range(20)]
        refused = [task for task in asking if not await is_waiting(task)]
        assert len(approvals.open) == MAX_OPEN
        assert len(refused) == len(asking) - MAX_OPEN
        of_first = [approval for approval in approvals.open if approval.user == "agent-0"]
        assert len(of_first) == MAX_OPEN_OF_USER
        for task in refused:
            with pytest.raises(Refused, match="wait for an answer already"):
                await task
        for task in asking:
            task.cancel()
        await asyncio.gather(*asking, return_exceptions=True)
        assert not approvals.open

    async def is_waiting(task: asyncio.Task[str]) -> bool:
        await asyncio.sleep(0)
        return not task.done()

    asyncio.run(test())


def test_ids_are_random_and_answers_count_once() -> None:
    async def test() -> None:
        person, ids = caller("boss", Role.APPROVE, person=True), []
        for _ in range(2):  # as after a restart
            approvals = Approvals(EventStream())
            asking = asyncio.create_task(approvals.request(caller("agent"), ASKED))
            await asyncio.sleep(0)
            ids.append(approvals.open[0].id)
            approvals.answer(person, ids[-1], False)
            with pytest.raises(UnknownName):
                approvals.answer(person, ids[-1], True)
            with pytest.raises(Refused, match="boss has rejected it"):
                await asking
        assert ids[0] != ids[1]
        assert len(ids[0]) >= 16

    asyncio.run(test())
