"""Agents: the client of the package `mcp` against the served application, with a stand-in for the cell."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from typing import Any

import httpx2
import jsonschema
import pytest
from mcp import Client
from mcp.client.streamable_http import streamable_http_client

from skiros2_gateway.agents.arguments import schema_of
from skiros2_gateway.agents.server import AgentServer
from skiros2_gateway.core.approvals import Approval, Approvals
from support.http_gateway import curl, served
from support.stand_in_cell import ROBOT
from unit.skiros2_gateway.conftest import TOKENS

Run = Callable[..., None]
GOAL = {"id": "a", "goal": "(at robot home)"}


class Agent:
    """A client with a token, and the address of the gateway."""

    def __init__(self, client: Client, address: str) -> None:
        self.client = client
        self.address = address
        self.schemas: dict[str, Any] = {}

    async def call(self, tool: str, **arguments: Any) -> Any:
        """Calls a tool; returns its data, which are an error's if it has a `code`."""
        result = await self.client.call_tool(tool, arguments)
        assert result.is_error == ("code" in result.structured_content)
        if not result.is_error:  # an agent whose access has ended sees no tools
            if not self.schemas:
                self.schemas = {each.name: each.output_schema for each in (await self.client.list_tools()).tools}
            schema = self.schemas[tool]
            assert schema["type"] == "object"
            jsonschema.validate(result.structured_content, schema)
        return result.structured_content


@asynccontextmanager
async def connected(gateway: Any, user: str, **approval: Any) -> AsyncIterator[Agent]:
    gateway.service.approvals = Approvals(gateway.events, **approval)
    server = AgentServer(gateway.service, hosts=["cell.factory"])
    async with server.running(), served(gateway.service, routers=[server.router()]) as address:
        headers = {"Authorization": f"Bearer {TOKENS[user]}"}
        async with (
            httpx2.AsyncClient(headers=headers, timeout=60.0) as http,
            Client(streamable_http_client(f"{address}/mcp", http_client=http)) as client,
        ):
            yield Agent(client, address)


async def waiting(gateway: Any, number: int = 1) -> list[Approval]:
    """Waits until a number of requests wait for approval, and returns them."""
    while len(gateway.service.approvals.open) != number:
        await asyncio.sleep(0.01)
    return list(gateway.service.approvals.open)


async def answered(agent: Agent, gateway: Any, word: str = "approve") -> Any:
    """Answers the only request for approval as a person, once it is open; returns what is approved."""
    (approval,) = await waiting(gateway)
    path = f"/api/approvals/{approval.id}/{word}"
    assert (await curl(agent.address, path, "-X", "POST", token=TOKENS["approve"]))[0] == 200
    return approval.to_dict()["what"]


def test_agent_reads_skills_world_and_plans(in_gateway: Run) -> None:
    async def test(gateway: Any) -> None:
        async with connected(gateway, "agent") as agent:
            tools = {tool.name: tool for tool in (await agent.client.list_tools()).tools}
            assert set(tools) == {
                "list_skills", "query_world", "check_start", "plan", "preview", "execute", "stop", "explain", "propose",
                "history",
            }  # fmt: skip
            moving = [name for name, tool in tools.items() if not tool.annotations.read_only_hint]
            assert moving == ["execute", "stop", "propose"]
            jsonschema.validate(GOAL, tools["execute"].input_schema)
            assert (await agent.call("list_skills"))["skills"][0]["robot"] == ROBOT
            found = await agent.call("query_world", type="demo:Tray")
            assert [element["id"] for element in found["elements"]] == ["Tray-1"]
            assert (await agent.call("query_world", sparql="SELECT ?x WHERE {}"))["columns"] == ["x"]
            query = {"query": "SELECT ?x WHERE {}"}
            assert (await curl(agent.address, "/api/world/query", token=TOKENS["view"], body=query))[0] == 200
            assert gateway.cell.asked == ["agent", "view"]  # each has a budget of their own
            assert (await agent.call("check_start", robot=ROBOT, skill="place"))["ok"]
            assert (await agent.call("plan", goal="(at robot home)"))["state"] == "planned"
            place = {"work_master": "place", "parameters": {"Tray": "Tray-1"}}
            assert (await agent.call("preview", **place))["state"] == "planned"
            assert (await agent.call("preview", robot=ROBOT, skill="place"))["implementation"] == "place"
            assert not gateway.cell.sent

    in_gateway(test)


def test_text_shows_invisible_characters_as_codes_and_ids_in_data_are_exact(in_gateway: Run) -> None:
    async def test(gateway: Any) -> None:
        tray = "Tray\u202e-7\u200b\x1b[2J"
        gateway.cell.elements[tray] = "demo:Tray"
        shown = gateway.path.parent / "shown"
        async with connected(gateway, "agent") as agent:
            found = (await agent.call("query_world", type="demo:Tray"))["elements"]
            assert [element["id"] for element in found] == ["Tray-1", tray]
            result = await agent.client.call_tool("query_world", {"id": tray})  # as an id it is usable
            assert [element["id"] for element in result.structured_content["elements"]] == [tray]
            texts = [content.text for content in result.content]
            wrong = await agent.client.call_tool("query_world", {"id": f"{tray}x"})
            texts += [content.text for content in wrong.content]
            skill = {"robot": ROBOT, "skill": "place", "parameters": {"Tray": tray}}
            execution = asyncio.create_task(agent.call("execute", **skill))
            await waiting(gateway)
            for path in ("/api/world", "/api/approvals", "/api/jobs"):  # people read them in terminals
                assert (await curl(agent.address, path, "-o", str(shown), token=TOKENS["view"]))[0] == 200
                texts.append(shown.read_text())
            await answered(agent, gateway)
            await execution
            assert gateway.cell.started[0]["Tray"] == tray
        assert all(text.isprintable() for text in texts), texts
        assert ["\\u202e-7\\u200b\\u001b[2J" in text for text in texts] == [True, True, True, True, False]

    in_gateway(test)


def test_job_of_an_agent_starts_when_another_user_approves(in_gateway: Run) -> None:
    async def test(gateway: Any) -> None:
        async with connected(gateway, "agent") as agent:
            execution = asyncio.create_task(agent.call("execute", **GOAL))
            maintainer, agent_token, viewer = (TOKENS[user] for user in ("maintain", "agent", "view"))
            while not (found := (await curl(agent.address, "/api/approvals", token=viewer))[1]["approvals"]):
                await asyncio.sleep(0.01)
            assert not gateway.cell.sent
            assert (found[0]["user"], found[0]["what"]["plan"][0]["label"]) == ("agent", "place")
            path = f"/api/approvals/{found[0]['id']}/approve"
            refused = ((agent_token, 403), (TOKENS["operate"], 403), (viewer, 403), ("", 401))
            for token, status in (*refused, (maintainer, 200)):
                assert (await curl(agent.address, path, "-X", "POST", token=token))[0] == status
            assert (await execution)["state"] == "AllowedToStart"
            assert [goal.id for goal in gateway.cell.sent] == ["a"]
            assert gateway.store.history("a")[0]["comment"] == "approved by maintain"
            gateway.cell.end("a", "failed", "the gripper is empty")
            await gateway.collected("a")
            assert (await agent.call("explain", job="a"))["message"] == "the gripper is empty"
            assert [job["job"] for job in (await agent.call("history"))["jobs"]] == ["a"]
            assert (await agent.call("history", job="a"))["history"][-1]["method"] == "collected"

    in_gateway(test)


@pytest.mark.parametrize(("approval", "answer"), [({}, "reject"), ({"timeout": 0.05}, "")])
def test_job_that_nobody_approves_does_not_start(in_gateway: Run, approval: dict[str, Any], answer: str) -> None:
    async def test(gateway: Any) -> None:
        async with connected(gateway, "agent", **approval) as agent:
            execution = asyncio.create_task(agent.call("execute", **GOAL))
            if answer:
                await answered(agent, gateway, answer)
            assert (await execution)["code"] == "refused"
            assert not list(gateway.store.jobs())

    in_gateway(test)


def test_agent_without_role_valid_plan_or_right_arguments_is_refused(in_gateway: Run) -> None:
    async def test(gateway: Any) -> None:
        async with connected(gateway, "view", is_needed=False) as agent:
            assert (await agent.call("execute", **GOAL))["code"] == "denied"
            assert (await agent.call("stop"))["code"] == "denied"
        async with connected(gateway, "agent", is_needed=False) as agent:
            assert "nobody goes there" in (await agent.call("execute", id="a", goal="(at nowhere)"))["detail"]
            wrong = await agent.call("execute", id="a b", goal="(at robot home)", robots=["/other"], colour="red")
            assert {problem["where"] for problem in wrong["problems"]} == {"colour"}
            assert (await agent.call("move"))["code"] == "unknown_name"
            assert not list(gateway.store.jobs())
            assert (await agent.call("execute", **GOAL))["state"] == "AllowedToStart"
            gateway.cell.accept("a")
            assert (await agent.call("stop", job="a"))["job"] == "a"
            assert gateway.cell.stopped == ["a"]

    in_gateway(test)


def test_single_skill_runs_after_start_check_and_approval_and_is_stopped(in_gateway: Run) -> None:
    async def test(gateway: Any) -> None:
        async with connected(gateway, "agent") as agent:
            skill = {"robot": ROBOT, "skill": "place", "parameters": {"Tray": "Tray-1"}}
            execution = asyncio.create_task(agent.call("execute", **skill))
            what = await answered(agent, gateway)
            assert (what["skill"], what["preview"]["ok"]) == ("place", True)
            assert await execution == {"robot": ROBOT, "task": 0}
            assert (await agent.call("explain", robot=ROBOT, task=0))["state"] == "running"
            assert await agent.call("stop", robots=[ROBOT], task=0) == {"tasks": {ROBOT: 1}}
            assert gateway.cell.commands == [("stop", [ROBOT, "0"])]
            refused = await agent.call("execute", robot=ROBOT, skill="pick")
            assert refused["code"] == "refused" and "the tray is unknown" in refused["detail"]
            mixed = await agent.call("execute", skill="place", goal="(at robot home)", id="a")
            assert {problem["where"] for problem in mixed["problems"]} == {"goal", "id", "robot"}
            assert len(gateway.cell.skill_runs) == 1 and not gateway.cell.sent
            outcomes = {entry["action"] for entry in gateway.store.audit_log() if entry["outcome"] == "done"}
            assert outcomes == {"execute", "stop", "approve"}

    in_gateway(test)


def test_proposal_for_a_failed_skill_is_applied_and_retried_after_approval(in_gateway: Run) -> None:
    async def test(gateway: Any) -> None:
        async with connected(gateway, "agent", is_needed=False) as agent:
            cell = gateway.cell
            run = {"robot": ROBOT, "task": await cell.run_skill(ROBOT, "pick", {}, {})}
            edit = {"element": "Tray-1", "property": "skiros:ContainerState", "values": ["Empty"]}
            proposal = {**run, "reason": "the tray was not seen", "properties": [edit], "retry": True}
            proposal["parameters"] = {"Tray": "Tray-1"}
            assert "has not failed: it is running" in (await agent.call("propose", **proposal))["detail"]
            cell.skill_runs[ROBOT, 0]["state"] = "failed"
            for word in ("reject", "approve"):
                assert not cell.edits
                proposing = asyncio.create_task(agent.call("propose", **proposal))
                what = await answered(agent, gateway, word)  # although the configuration approves what has a valid plan
                result = await proposing
            assert what["failure"]["state"] == "failed"
            assert what["changes"] == result["changes"] == ["~ Tray-1 skiros:ContainerState"]
            assert what["retry"] == {"robot": ROBOT, "skill": "pick", "parameters": {"Tray": "Tray-1"}}
            assert (result["retried"], result["why"]) == ({"robot": ROBOT, "task": 1}, "")
            assert [edit.element for edit in cell.edits[0].properties] == ["Tray-1"]

    in_gateway(test)


def test_proposal_for_a_failed_job_is_a_new_job_with_other_values(in_gateway: Run) -> None:
    async def test(gateway: Any) -> None:
        async with connected(gateway, "agent") as agent:
            await gateway.put("j", work_master="place", parameters={"Tray": "Tray-1"})
            gateway.cell.end("j", "failed", "the product is too fast")
            await gateway.collected("j")
            proposal = {"job": "j", "reason": "slower", "parameters": {"Speed": 0.5}, "retry": True}
            proposing = asyncio.create_task(agent.call("propose", **proposal))
            what = await answered(agent, gateway)
            assert (what["failure"]["message"], what["changes"]) == ("the product is too fast", [])
            assert what["retry"]["parameters"] == {"Tray": "Tray-1", "Speed": 0.5}
            result = await proposing
            assert result["retried"]["job"] == "j.2"
            assert [goal.id for goal in gateway.cell.sent] == ["j", "j.2"]
            assert gateway.store.history("j.2")[0]["comment"] == "proposed by agent, approved by approve"

    in_gateway(test)


def test_wrong_proposal_is_rejected_with_all_problems_and_never_shown(in_gateway: Run) -> None:
    async def test(gateway: Any) -> None:
        async with connected(gateway, "agent") as agent:
            await gateway.put("j", work_master="place", parameters={"Tray": "Tray-1"})
            gateway.cell.end("j", "failed", "why")
            await gateway.collected("j")
            edit = {"element": "Tray-7", "property": "skiros:ContainerState", "values": ["Empty"]}
            values = {"Speed": 9.0, "Sped": 1.0}
            proposal = {"job": "j", "reason": "r", "properties": [edit], "parameters": values, "retry": True}
            wrong = await agent.call("propose", **proposal)
            places = {problem["where"] for problem in wrong["problems"]}
            assert places == {"properties.0.element", "parameters.Speed", "parameters.Sped"}
            empty = await agent.call("propose", job="j", robot=ROBOT, reason="r", parameters={"Speed": 1.0})
            assert {problem["where"] for problem in empty["problems"]} == {"job", "parameters"}
            assert not (await curl(agent.address, "/api/approvals", token=TOKENS["view"]))[1]["approvals"]
            assert (await agent.call("propose", job="k", reason="r", properties=[edit]))["code"] == "unknown_name"
        async with connected(gateway, "view") as agent:
            assert (await agent.call("propose", **proposal))["code"] == "denied"

    in_gateway(test)


def test_request_without_a_token_is_refused(in_gateway: Run) -> None:
    async def test(gateway: Any) -> None:
        async with connected(gateway, "view") as agent:
            request = {"jsonrpc": "2.0", "id": 1, "method": "tools/list"}
            assert (await curl(agent.address, "/mcp", body=request))[0] == 401

    in_gateway(test)


@pytest.mark.parametrize(
    ("header", "status"),
    [
        ("Host: attacker.example:8765", 403),
        ("Host: 127.0.0.1.attacker.example", 403),
        ("Host: [", 403),
        ("Origin: http://attacker.example", 403),
        ("Origin: null", 403),
        ("Host: localhost:1", 200),
        ("Host: cell.factory", 200),
    ],
)
def test_request_of_a_page_of_another_origin_is_refused(in_gateway: Run, header: str, status: int) -> None:
    async def test(gateway: Any) -> None:
        async with connected(gateway, "agent") as agent:
            request = {"jsonrpc": "2.0", "id": 1, "method": "tools/list"}
            accepted = ("-H", "Accept: application/json, text/event-stream", "-H", header)
            answer = await curl(agent.address, "/mcp", *accepted, token=TOKENS["agent"], body=request)
            assert answer[0] == status

    in_gateway(test)


def test_agents_tools_do_not_take_the_cookie_of_a_page(in_gateway: Run) -> None:
    async def test(gateway: Any) -> None:
        jar = str(gateway.path.parent / "cookies")
        async with connected(gateway, "agent") as agent:
            await curl(agent.address, "/api/session", "-c", jar, body={"token": TOKENS["operate"]})
            request = {"jsonrpc": "2.0", "id": 1, "method": "tools/list"}
            assert (await curl(agent.address, "/mcp", "-b", jar, "-H", "X-Gateway: 1", body=request))[0] == 401

    in_gateway(test)


def test_schema_of_parameters_has_types_limits_and_required_ones() -> None:
    parameters = [
        {"key": "Object", "kind": "required", "type": "skiros:Product", "default": [], "description": "what"},
        {"key": "Speed", "kind": "optional", "type": "float", "default": [1.0], "unit": "m/s", "maximum": 2.0},
    ]
    schema = schema_of(parameters)
    jsonschema.validate({"Object": "Product-1", "Speed": 2.0}, schema)
    for wrong in ({}, {"Object": 1}, {"Object": "x", "Speed": 3.0}, {"Object": "x", "Other": 1}):
        with pytest.raises(jsonschema.ValidationError):
            jsonschema.validate(wrong, schema)
