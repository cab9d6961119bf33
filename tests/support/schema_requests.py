"""Requests generated from the gateway's OpenAPI document (schemathesis), against a gateway with a stand-in cell."""

from __future__ import annotations

from collections import Counter
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager, contextmanager, suppress
from pathlib import Path
from typing import Any

import requests
import schemathesis
from anyio.from_thread import start_blocking_portal
from hypothesis import HealthCheck, Phase, given, seed, settings
from hypothesis import strategies as st
from hypothesis.errors import Unsatisfiable
from schemathesis import GenerationMode, checks

from skiros2_gateway.agents.server import AgentServer
from skiros2_gateway.core.bags import Bags
from skiros2_gateway.core.figures import Figures
from skiros2_gateway.core.live import LiveView
from skiros2_gateway.http.alarms import alarms_router
from skiros2_gateway.http.figures import figures_router
from skiros2_gateway.http.live import live_router
from skiros2_live.core.cell import CellDocument
from skiros2_live.core.patch import TaskProgress
from support.http_gateway import served
from unit.skiros2_gateway.conftest import TOKENS, Gateway
from unit.skiros2_gateway.test_live_http import _Cell, _nodes

#: Paths whose answers do not end.
_STREAMS = ("/api/events", "/api/live/patches")
#: Failed logins are soon answered with 429, so most requests have a token.
_USERS = ("maintain", "operate", "maintain", "operate", "view", "agent", "")
_CHECKS = [
    checks.not_a_server_error,
    checks.status_code_conformance,
    checks.content_type_conformance,
    checks.response_schema_conformance,
]


@contextmanager
def served_gateway(folder: Path) -> Iterator[str]:
    """Serves all routes in a thread with a loop of its own; yields the address."""

    @asynccontextmanager
    async def serve() -> AsyncIterator[str]:
        gateway = Gateway(folder / "jobs.sqlite", capacity=10, rate=1e9)
        await gateway.put("a")
        gateway.cell.run("a")
        view = LiveView(CellDocument())
        view.cell.apply(TaskProgress("/robot", _nodes(3, 3), view.cell.clock()))
        figures = Figures(gateway.store, view.cell)
        agents = AgentServer(gateway.service)
        routers = [
            live_router(view, _Cell(), Bags(None)),
            alarms_router(view),
            figures_router(figures.write),
            agents.router(),
        ]
        async with served(gateway.service, routers=routers) as address:
            yield address

    with start_blocking_portal() as portal, portal.wrap_async_context_manager(serve()) as address:
        yield address


def operations_of(address: str) -> list[Any]:
    """Returns the operations of a gateway whose answers end."""
    schema = schemathesis.openapi.from_url(f"{address}/openapi.json")
    found = [result.ok() for result in schema.get_all_operations()]
    return [operation for operation in found if operation.path not in _STREAMS]


def send_generated(address: str, count: int, number: int = 0) -> Counter[int]:
    """Sends requests to each operation, valid ones and others. Returns the number of answers by status.

    :param count: requests for each operation and kind.
    :param number: the random seed.
    :raises AssertionError: the server fails, a status is not documented, or an answer does not match its schema.
    """
    found: Counter[int] = Counter()
    with requests.Session() as session:
        for operation in operations_of(address):
            for mode in (GenerationMode.POSITIVE, GenerationMode.NEGATIVE):
                _send(operation, mode, session, found, count, number)
    return found


def send_valid(address: str) -> None:
    """Sends a request with success to each operation.

    :raises AssertionError: an answer is an error, or does not match its schema.
    """
    schema = schemathesis.openapi.from_url(f"{address}/openapi.json")
    order = {"id": "valid", "goal": "(at robot home)", "start": False}
    key, node = {"key": "run-1"}, {"key": "run-1", "node": 1}
    requests_: list[tuple[str, str, dict[str, Any]]] = [
        ("POST", "/api/jobs", {"body": order}), ("POST", "/api/jobs", {"body": order}),
        ("PUT", "/api/jobs/{job_id}", {"body": {**order, "priority": 3}, "path_parameters": {"job_id": "valid"}}),
        ("POST", "/api/jobs/{job_id}/{method}", {"path_parameters": {"job_id": "valid", "method": "cancel"}}),
        ("GET", "/api/jobs/{job_id}", {"path_parameters": {"job_id": "valid"}}),
        ("GET", "/api/jobs/{job_id}/history", {"path_parameters": {"job_id": "valid"}}),
        ("POST", "/api/session", {"body": {"token": TOKENS["view"]}}),
        ("POST", "/api/robots/{action}", {"body": {"robots": []}, "path_parameters": {"action": "stop"}}),
        ("POST", "/api/plan", {"body": {"goal": "(at robot home)"}}),
        ("POST", "/api/goal/form", {"body": {"goal": "(at robot home)"}}),
        ("POST", "/api/world/query", {"body": {"query": "SELECT ?s {?s ?p ?o}"}}),
        ("GET", "/api/live/runs/{key}", {"path_parameters": key}),
        ("GET", "/api/live/runs/{key}/why", {"path_parameters": key}),
        ("GET", "/api/live/runs/{key}/scene", {"path_parameters": key, "query": {"time": 1.0}}),
        ("GET", "/api/live/runs/{key}/nodes/{node}", {"path_parameters": node}),
        ("POST", "/api/live/runs/{key}/{action}", {"path_parameters": {"key": "run-1", "action": "stop"}}),
        *(("GET", f"/api/{path}", {}) for path in ("health", "sessions", "state", "world", "jobs", "work_masters")),
        *(("GET", f"/api/{path}", {}) for path in ("skills", "audit", "approvals", "alarms", "figures", "live")),
        ("GET", "/api/live/bags", {}),
        ("GET", "/api/figures/{table}.csv", {"path_parameters": {"table": "robots"}}),
        ("POST", "/api/alarms/acknowledge", {"body": {"alarms": []}}),
    ]  # fmt: skip
    for method, path, arguments in requests_:
        case = schema[path][method].Case(**arguments)
        response = case.call(headers={"Authorization": f"Bearer {TOKENS['maintain']}"}, timeout=20.0)
        assert response.status_code in (200, 201), f"{method} {path}: {response.text}"
        case.validate_response(response, checks=_CHECKS)


def _send(operation: Any, mode: Any, session: Any, found: Counter[int], count: int, number: int) -> None:
    @seed(number)
    @settings(
        max_examples=count, database=None, deadline=None, derandomize=False,
        suppress_health_check=list(HealthCheck), phases=[Phase.generate],
    )  # fmt: skip
    @given(case=operation.as_strategy(generation_mode=mode), user=st.sampled_from(_USERS))
    def send(case: Any, user: str) -> None:
        headers = {"Authorization": f"Bearer {TOKENS[user]}"} if user else {}
        response = case.call(session=session, headers=headers, timeout=20.0)
        found[response.status_code] += 1
        case.validate_response(response, checks=_CHECKS)

    with suppress(Unsatisfiable):  # no wrong request is possible: the operation has no arguments
        send()
