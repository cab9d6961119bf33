"""The stop port's application, deadlines of requests, and limits of plans."""

from __future__ import annotations

import asyncio
import hashlib
import shutil
import time
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import asynccontextmanager
from typing import Any
from urllib.parse import urlsplit

import pytest

from skiros2_common.core.errors import TimedOut, UnknownName
from skiros2_gateway.core.job import Method
from skiros2_gateway.core.problems import Denied, TooMany
from skiros2_gateway.http.callers import COOKIE
from skiros2_gateway.stop.app import Users, create_stop_app
from support.http_gateway import curl, served, served_app
from unit.skiros2_gateway.conftest import OPERATOR, TOKENS, VIEWER

Run = Callable[..., None]

pytestmark = pytest.mark.skipif(shutil.which("curl") is None, reason="needs Debian's curl")


class _Stops:
    """Stands in for `RobotStops`."""

    robots = ("/robot",)

    def __init__(self) -> None:
        self.commands: list[tuple[str, list[str], str, int]] = []
        self.limits: list[float] = []

    async def command(self, action: str, robots: Sequence[str], author: str, task: int, limit: float) -> dict[str, int]:
        if "/gone" in robots:
            raise UnknownName("no robot '/gone' is connected")
        if "/silent" in robots:
            raise TimedOut("/silent has not answered")
        self.commands.append((action, list(robots), author, task))
        self.limits.append(limit)
        return {"/robot": 2}


class _Port:
    def __init__(self, address: str, stops: _Stops, users: Users, entries: list[dict[str, str]]) -> None:
        self.address, self.stops, self.users, self.entries = address, stops, users, entries

    async def send(self, *options: str, action: str = "stop", token: str = "", **body: Any) -> tuple[int, Any]:
        return await curl(self.address, f"/api/robots/{action}", *options, token=token, body=body)


@asynccontextmanager
async def _port(gateway: Any) -> AsyncIterator[_Port]:
    stops, entries = _Stops(), []
    users = Users(entries.append)
    users.by_digest = gateway.service.stop_digests()
    async with served_app(create_stop_app(stops, users, entries.append)) as address:  # type: ignore[arg-type]
        yield _Port(address, stops, users, entries)


def test_operator_stops_robots_and_it_is_audited(in_gateway: Run) -> None:
    async def test(gateway: Any) -> None:
        async with _port(gateway) as port:
            assert await port.send(token=TOKENS["operate"], robots=["/robot"], task=7) == (200, {"/robot": 2})
            assert port.stops.commands == [("stop", ["/robot"], "operate", 7)]
            [entry] = port.entries
            assert (entry["user"], entry["action"], entry["outcome"]) == ("operate", "stop robots", "done")
            assert (await port.send(token=TOKENS["operate"], action="hop"))[0] == 404
            assert (await port.send(token=TOKENS["operate"], robots=["/gone"]))[0] == 404
            assert (await port.send(token=TOKENS["operate"], robots=["/silent"]))[0] == 503
            outcomes = [entry["outcome"].partition(":")[0] for entry in port.entries]
            assert outcomes == ["done", "unknown_name", "timed_out"]

    in_gateway(test)


def test_resumption_with_a_key_is_carried_out_once_and_a_stop_each_time(in_gateway: Run) -> None:
    async def test(gateway: Any) -> None:
        async with _port(gateway) as port:
            key, token = ("-H", "Idempotency-Key: k"), TOKENS["operate"]
            assert (await port.send(*key, action="resume", token=token, robots=["/silent"]))[0] == 503
            unknown = await port.send(*key, action="resume", token=token, robots=["/silent"])
            assert (unknown[0], unknown[1]["code"]) == (409, "conflict")  # it may have been carried out
            for _ in range(2):
                assert await port.send("-H", "Idempotency-Key: r", action="resume", token=token) == (200, {"/robot": 2})
                assert await port.send("-H", "Idempotency-Key: s", action="stop", token=token) == (200, {"/robot": 2})
            assert [command[0] for command in port.stops.commands] == ["resume", "stop", "stop"]

    in_gateway(test)


@pytest.mark.parametrize("role", ["", "view", "agent", "unknown"])
def test_others_stop_nothing(in_gateway: Run, role: str) -> None:
    async def test(gateway: Any) -> None:
        async with _port(gateway) as port:
            assert (await port.send(token=TOKENS.get(role, role)))[0] == 401
            assert port.stops.commands == []

    in_gateway(test)


def test_guesses_of_tokens_are_limited_and_the_operator_is_not(in_gateway: Run) -> None:
    async def test(gateway: Any) -> None:
        async with _port(gateway) as port:
            guesses = [port.send(token=f"a guess {number}") for number in range(60)]
            codes = {status for status, _ in await asyncio.gather(*guesses)}
            assert codes == {401, 429}
            assert (await port.send(token=TOKENS["operate"]))[0] == 200

    in_gateway(test)


def test_session_of_the_page_stops_until_it_ends(in_gateway: Run) -> None:
    async def test(gateway: Any) -> None:
        secret, _ = gateway.service.sessions.start(TOKENS["operate"], "127.0.0.1")
        viewers, _ = gateway.service.sessions.start(TOKENS["view"], "127.0.0.1")
        async with _port(gateway) as port:
            cookie = ["-H", f"Cookie: {COOKIE}={secret}"]
            assert (await port.send(*cookie))[0] == 401, "another page could send it"
            cookie += ["-H", "X-Gateway: 1"]
            assert (await port.send(*cookie))[0] == 200
            assert (await port.send("-H", f"Cookie: {COOKIE}={viewers}", "-H", "X-Gateway: 1"))[0] == 401
            gateway.access.set_users([])
            port.users.by_digest = gateway.service.stop_digests()
            assert port.users.by_digest == {}
            assert (await port.send(*cookie))[0] == 401

    in_gateway(test)


def test_page_of_the_same_host_is_admitted_and_others_are_not(in_gateway: Run) -> None:
    async def test(gateway: Any) -> None:
        async with _port(gateway) as port:
            own, other = "Origin: http://127.0.0.1:1234", "Origin: http://evil.example"
            assert (await port.send("-H", other, token=TOKENS["operate"]))[0] == 403
            assert (await port.send("-H", own, token=TOKENS["operate"]))[0] == 200
            for origin, status in ((own, 204), (other, 403)):
                options = ["-X", "OPTIONS", "-i", "-H", origin]
                found, text = await curl(port.address, "/api/robots/stop", *options)
                assert found == status
                assert ("access-control-allow-credentials: true" in text) == (origin == own)

    in_gateway(test)


@pytest.mark.parametrize(("late", "status"), [(-5.0, 200), (0.001, 503), (3600.0, 503)])
def test_late_command_is_refused(in_gateway: Run, late: float, status: int) -> None:
    async def test(gateway: Any) -> None:
        async with _port(gateway) as port, served(gateway.service) as address:
            header = ["-H", f"X-Deadline: {time.monotonic() - late:.3f}"]
            assert (await port.send(*header, token=TOKENS["operate"]))[0] == status
            assert len(port.stops.commands) == (status == 200)
            assert all(0.0 < limit < -late for limit in port.stops.limits), "the robot gets the deadline"
            body = {"robots": []}
            found = await curl(address, "/api/robots/stop", *header, token=TOKENS["operate"], body=body)
            assert found[0] == status
            assert len(gateway.cell.commands) == (status == 200)

    in_gateway(test)


@pytest.mark.parametrize("text", ["nan", "soon", "", "1e999999x"])
def test_deadline_that_is_no_number_is_refused(in_gateway: Run, text: str) -> None:
    async def test(gateway: Any) -> None:
        async with _port(gateway) as port:
            header = ["-H", f"X-Deadline: {text}" if text else "X-Deadline;"]
            assert (await port.send(*header, token=TOKENS["operate"]))[0] == 422
            assert port.stops.commands == []

    in_gateway(test)


def test_job_that_is_checked_until_after_its_deadline_is_not_stored(in_gateway: Run) -> None:
    async def test(gateway: Any) -> None:
        async def slow(*_: Any) -> list[Any]:
            await asyncio.sleep(0.3)
            return []

        gateway.cell.problems = slow
        async with served(gateway.service) as address:
            header = ["-H", f"X-Deadline: {time.monotonic() + 0.2:.3f}"]
            order = {"id": "a", "goal": "(at robot home)"}
            assert (await curl(address, "/api/jobs", *header, token=TOKENS["operate"], body=order))[0] == 503
            assert gateway.control.open_jobs == [] and gateway.cell.sent == []

    in_gateway(test)


def test_running_job_is_stopped_before_the_disk_has_it(in_gateway: Run) -> None:
    async def test(gateway: Any) -> None:
        await gateway.put("a")
        gateway.cell.run("a")
        stopped_at_save: list[list[str]] = []
        save = gateway.store.save

        def slow_save(*arguments: Any, **options: Any) -> None:
            stopped_at_save.append(list(gateway.cell.stopped))
            save(*arguments, **options)

        gateway.store.save = slow_save
        await gateway.service.apply(OPERATOR, Method.STOP, "a")
        assert stopped_at_save == [["a"]]

    in_gateway(test)


def test_plans_are_limited_for_each_user_and_need_the_role_operate(in_gateway: Run) -> None:
    async def test(gateway: Any) -> None:
        service = gateway.service
        with pytest.raises(Denied), service.planning(VIEWER):
            pass
        two = [service.planning(OPERATOR) for _ in range(2)]
        for planning in two:
            planning.__enter__()
        with pytest.raises(TooMany), service.planning(OPERATOR):
            pass
        for planning in two:
            planning.__exit__(None, None, None)
        with service.planning(OPERATOR):
            pass
        async with served(service) as address:
            goal = {"goal": "(at robot home)"}
            assert (await curl(address, "/api/plan", token=TOKENS["view"], body=goal))[0] == 403
            assert (await curl(address, "/api/plan", token=TOKENS["operate"], body=goal))[0] == 200

    in_gateway(test)


def test_digests_are_those_of_tokens_that_may_command(in_gateway: Run) -> None:
    async def test(gateway: Any) -> None:
        digests = {hashlib.sha256(TOKENS[name].encode()).hexdigest() for name in ("operate", "approve", "maintain")}
        assert gateway.service.stop_digests().keys() == digests

    in_gateway(test)


def test_large_body_is_refused_before_it_has_arrived(in_gateway: Run) -> None:
    async def test(gateway: Any) -> None:
        async with _port(gateway) as port:
            url = urlsplit(port.address)
            reader, writer = await asyncio.open_connection(url.hostname, url.port)
            head = "POST /api/robots/stop HTTP/1.1\r\nHost: a\r\nContent-Type: application/json\r\n"
            writer.write(f"{head}Content-Length: 100000000\r\n\r\n".encode() + b"[" * 1_000_000)
            assert b" 413 " in await asyncio.wait_for(reader.readline(), 10.0)
            writer.close()
            assert (await port.send(token=TOKENS["operate"]))[0] == 200

    in_gateway(test)


def test_failed_logins_are_audited_in_few_entries(in_gateway: Run) -> None:
    async def test(gateway: Any) -> None:
        async with _port(gateway) as port:
            for _ in range(5):
                assert (await port.send(token="guess"))[0] == 401
            [entry] = port.entries
            assert (entry["user"], entry["action"], entry["object"]) == ("", "log in", "127.0.0.1")
            port.users.close()
            assert "4 more" in port.entries[1]["outcome"]

    in_gateway(test)
