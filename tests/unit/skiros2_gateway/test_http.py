"""REST: curl against the served application, with a stand-in for the cell."""

from __future__ import annotations

import asyncio
import json
import shutil
from collections.abc import Callable
from typing import Any

import pytest

from skiros2_gateway.core.events import EventStream
from skiros2_gateway.core.job import Method
from skiros2_gateway.core.problems import Problem, WrongQuery
from skiros2_world_model.core.wm_errors import WmException
from support.http_gateway import curl, served
from unit.skiros2_gateway.conftest import TOKENS

Run = Callable[..., None]
ORDER = {"id": "a", "goal": "(at robot home)"}

pytestmark = pytest.mark.skipif(shutil.which("curl") is None, reason="needs Debian's curl")


def test_job_is_sent_queried_and_stopped(in_gateway: Run) -> None:
    async def test(gateway: Any) -> None:
        async with served(gateway.service) as address:
            token = TOKENS["operate"]
            status, job = await curl(address, "/api/jobs", token=token, body=ORDER)
            assert (status, job["state"]) == (201, "AllowedToStart")
            assert (await curl(address, "/api/jobs", token=token, body=ORDER))[0] == 200
            gateway.cell.run("a")
            assert (await curl(address, "/api/jobs/a", token=token))[1]["response"]["steps"][0]["robot"] == "/robot"
            assert (await curl(address, "/api/jobs/a/stop", "-X", "POST", token=token))[0] == 200
            gateway.cell.end("a", "cancelled")
            state = (await curl(address, "/api/state", token=token))[1]
            assert (state["jobs"], state["counts"], state["role"]) == ([], {"cancelled": 1}, "operate")
            listed = (await curl(address, "/api/jobs?state=Ended", token=token))[1]["jobs"]
            assert [each["id"] for each in listed] == ["a"]
            status, answer = await curl(address, "/api/jobs/a/stop", "-X", "POST", token=token)
            assert (status, answer["code"]) == (409, "refused")

    in_gateway(test)


def test_only_roles_may_command(in_gateway: Run) -> None:
    async def test(gateway: Any) -> None:
        async with served(gateway.service) as address:
            assert (await curl(address, "/api/health"))[0] == 200
            assert (await curl(address, "/api/state"))[0] == 401
            assert (await curl(address, "/api/jobs", token="guess", body=ORDER))[0] == 401
            assert (await curl(address, "/api/jobs", token=TOKENS["view"], body=ORDER))[0] == 403
            assert (await curl(address, "/api/audit", token=TOKENS["operate"]))[0] == 403
            status, answer = await curl(address, "/api/audit", token=TOKENS["maintain"])
            denied = [(entry["user"], entry["action"], entry["object"]) for entry in answer["audit"] if entry["user"]]
            assert (status, denied) == (200, [("view", "StoreAndStart", "a"), ("operate", "read the audit log", "")])
            assert not gateway.cell.sent

    in_gateway(test)


def test_cookie_commands_only_with_the_header(in_gateway: Run) -> None:
    async def test(gateway: Any) -> None:
        jar = str(gateway.path.parent / "cookies")
        async with served(gateway.service) as address:
            login = {"token": TOKENS["operate"]}
            assert (await curl(address, "/api/session", "-c", jar, body=login))[1]["role"] == "operate"
            assert (await curl(address, "/api/state", "-b", jar))[0] == 200
            assert (await curl(address, "/api/jobs", "-b", jar, body=ORDER))[0] == 401
            assert (await curl(address, "/api/jobs", "-b", jar, "-H", "X-Gateway: 1", body=ORDER))[0] == 201

    in_gateway(test)


@pytest.mark.parametrize(
    ("path", "body", "status", "code"),
    [
        ("/api/jobs", {"id": "", "goal": 3, "x": 1}, 422, "rejected"),
        ("/api/jobs", "{", 400, "rejected"),
        ("/api/jobs", {**ORDER, "description": "x" * 20_000}, 413, "too_large"),
        ("/api/jobs/b/start", {}, 404, "unknown_name"),
        ("/api/jobs/b/jump", {}, 404, "unknown_name"),
        ("/api/robots/stop", {"robots": ["/other"]}, 404, "unknown_name"),
        ("/api/nothing", {}, 404, "http_error"),
    ],
)
def test_wrong_request_is_answered_with_problem_details(
    in_gateway: Run, path: str, body: Any, status: int, code: str
) -> None:
    async def test(gateway: Any) -> None:
        async with served(gateway.service) as address:
            answer = await curl(address, path, token=TOKENS["operate"], body=body)
            assert (answer[0], answer[1]["code"]) == (status, code)
            assert not gateway.cell.sent

    in_gateway(test)


@pytest.mark.parametrize("key", ["Idempotency-Key;", "Idempotency-Key: ä", f"Idempotency-Key: {'k' * 201}"])
def test_key_that_the_document_does_not_allow_is_refused(in_gateway: Run, key: str) -> None:
    async def test(gateway: Any) -> None:
        async with served(gateway.service) as address:
            answer = await curl(address, "/api/jobs", "-H", key, token=TOKENS["operate"], body=ORDER)
            assert (answer[0], answer[1]["problems"][0]["where"]) == (422, "key")
            assert not gateway.cell.sent

    in_gateway(test)


@pytest.mark.parametrize(
    ("method", "path", "allowed"),
    [
        ("DELETE", "/api/jobs", "GET, HEAD, POST"),
        ("POST", "/api/jobs/a", "GET, HEAD, PUT"),
        ("PUT", "/api/session", "DELETE, POST"),
        ("GET", "/api/jobs/a/stop", "POST"),
    ],
)
def test_other_method_is_answered_with_those_that_are_possible(
    in_gateway: Run, method: str, path: str, allowed: str
) -> None:
    async def test(gateway: Any) -> None:
        async with served(gateway.service) as address:
            status, answer = await curl(address, path, "-X", method, "-D", "-", "-o", "/dev/null")
            headers = dict(line.lower().split(": ", 1) for line in answer.splitlines() if ": " in line)
            assert (status, headers["allow"]) == (405, allowed.lower())
            assert headers["content-type"] == "application/problem+json"

    in_gateway(test)


@pytest.mark.parametrize("path", ["/api/jobs", "/api/jobs/unknown", "/openapi.json", "/api/session"])
def test_head_is_answered_as_get_without_a_body(in_gateway: Run, path: str) -> None:
    async def test(gateway: Any) -> None:
        async with served(gateway.service) as address:
            token = TOKENS["view"]
            _, get = await curl(address, path, "-D", "-", "-o", "/dev/null", token=token)
            _, head = await curl(address, path, "--head", token=token)
            heads = [[line for line in text.splitlines() if line[:5] != "date:"] for text in (head, get)]
            assert heads[0] == heads[1]

    in_gateway(test)


def test_head_of_a_stream_ends(in_gateway: Run) -> None:
    async def test(gateway: Any) -> None:
        async with served(gateway.service) as address:
            status, head = await curl(address, "/api/events", "--head", token=TOKENS["view"])
            assert status == 200 and "text/event-stream" in head

    in_gateway(test)


def test_mistake_of_the_gateway_is_answered_with_problem_details(in_gateway: Run) -> None:
    async def test(gateway: Any) -> None:
        async with served(gateway.service) as address:
            gateway.service.state = None
            status, answer = await curl(address, "/api/state", token=TOKENS["view"])
            assert (status, answer["code"]) == (500, "internal_error")

    in_gateway(test)


def test_wrong_query_is_a_bad_request(in_gateway: Run) -> None:
    async def test(gateway: Any) -> None:
        async def query(*_: str) -> None:
            raise WrongQuery([Problem("query_error", "query", "expected SELECT")])

        gateway.cell.query = query
        async with served(gateway.service) as address:
            status, answer = await curl(address, "/api/world/query", token=TOKENS["view"], body={"query": "?"})
            assert (status, answer["code"], answer["problems"][0]["where"]) == (400, "wrong_query", "query")

    in_gateway(test)


@pytest.mark.parametrize(
    ("code", "status"), [("conflict", 409), ("wrong_value", 422), ("unknown_name", 404), ("error", 503)]
)
def test_status_of_an_error_of_a_service_follows_from_its_code(in_gateway: Run, code: str, status: int) -> None:
    async def test(gateway: Any) -> None:
        async def query(*_: str) -> None:
            raise WmException("the reason", code)

        gateway.cell.query = query
        async with served(gateway.service) as address:
            answer = await curl(address, "/api/world/query", token=TOKENS["view"], body={"query": "?"})
            assert (answer[0], answer[1]["code"]) == (status, code)

    in_gateway(test)


def test_jobs_are_listed_in_pages(in_gateway: Run) -> None:
    async def test(gateway: Any) -> None:
        for number in range(5):
            gateway.now += 1.0
            await gateway.put(f"job-{number}", description="Left" if number % 2 else "right")
        gateway.control.apply(Method.ABORT, "job-2", "test")

        async with served(gateway.service) as address:

            async def page(query: str) -> tuple[list[str], Any]:
                status, answer = await curl(address, f"/api/jobs?{query}", token=TOKENS["view"])
                assert status == 200, answer
                return [job["id"] for job in answer["jobs"]], answer["next"]

            first, after = await page("limit=2")
            second, last = await page(f"limit=3&after={after}")
            assert (first, second, last) == (["job-4", "job-3"], ["job-2", "job-1", "job-0"], None)
            assert (await page("state=Aborted&state=Ended"))[0] == ["job-2"]
            assert (await page("outcome=cancelled&limit=1")) == (["job-2"], None)
            assert (await page("text=left"))[0] == ["job-3", "job-1"]
            assert (await page("begin=1002&end=1004"))[0] == ["job-2", "job-1"]
            assert (await curl(address, "/api/jobs?state=Finished", token=TOKENS["view"]))[0] == 422
            assert (await curl(address, "/api/jobs?stat=Ended", token=TOKENS["view"]))[0] == 422

    in_gateway(test)


def test_too_many_requests_are_refused(in_gateway: Run) -> None:
    async def test(gateway: Any) -> None:
        async with served(gateway.service) as address:
            answers = [await curl(address, "/api/state", token=TOKENS["view"]) for _ in range(4)]
            assert [status for status, _ in answers][-1] == 429

    in_gateway(test, rate=0.1)


def test_events_are_resumed_after_a_lost_connection(in_gateway: Run) -> None:
    async def test(gateway: Any) -> None:
        async with served(gateway.service) as address:
            await gateway.put("a")
            before = gateway.events.last_id
            gateway.cell.accept("a")
            await gateway.put("b")
            options = ("-N", "-m", "30", "-H", f"Authorization: Bearer {TOKENS['view']}")
            process = await asyncio.create_subprocess_exec(
                "curl", "-s", *options, f"{address}/api/events?after={before}&kinds=job", stdout=asyncio.subprocess.PIPE
            )
            assert process.stdout is not None
            seen = []
            while len(seen) < 3:
                line = (await process.stdout.readline()).decode()
                assert line, f"the stream has ended after {seen}"
                if line.startswith("data: "):
                    event = json.loads(line.removeprefix("data: "))
                    seen.append((event["data"]["id"], event["data"]["state"]))
                    if len(seen) == 2:
                        gateway.cell.end("a")
            process.kill()
            await process.wait()
            assert seen == [("a", "Running"), ("b", "AllowedToStart"), ("a", "Ended")]

    in_gateway(test)


def test_viewer_that_missed_events_is_told_to_read_the_state() -> None:
    async def first_kind(after: str) -> str:
        events = EventStream()
        events.publish("job", {})
        async for event in events.follow(after or events.last_id):
            return event.kind
        raise AssertionError

    assert asyncio.run(first_kind("other-12")) == "reset"


def test_interface_is_described_by_openapi(in_gateway: Run) -> None:
    async def test(gateway: Any) -> None:
        async with served(gateway.service) as address:
            document = (await curl(address, "/openapi.json"))[1]
            assert {"/api/jobs", "/api/jobs/{job_id}/{method}", "/api/state", "/api/events"} <= document["paths"].keys()
            assert set(document["components"]["securitySchemes"]) == {"token", "session"}
            for path, operations in document["paths"].items():
                for method, operation in operations.items():
                    for status, answer in operation["responses"].items():
                        kinds = set(answer.get("content", {}))
                        assert kinds == {"application/problem+json"} if status >= "400" else kinds, (path, status)
                    assert {"400", "401", "403", "405", "422", "429", "500"} <= operation["responses"].keys()
                    keys = [each["name"] for each in operation.get("parameters", []) if each["in"] == "header"]
                    assert (keys == ["Idempotency-Key"]) == (method != "get" and path != "/api/session"), (method, path)

    in_gateway(test)
