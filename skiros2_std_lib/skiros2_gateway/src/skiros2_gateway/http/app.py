"""The HTTP interface (OpenAPI at `/openapi.json`, JSON everywhere).

Authentication: `Authorization: Bearer TOKEN`, or the cookie of a page's session, which `POST /api/session` starts.
Roles: view reads, operate commands, approve also answers what agents ask for, maintain also reads the audit log; tokens
of agents are refused. A command with the cookie needs the header `X-Gateway: 1`, which a page of another origin cannot
send.

A command with the header `X-Deadline` (s of the monotonic clock of the gateway's machine, see
`skiros2_gateway.http.live`) is carried out before it or never. Plans need the role operate; a user may ask for two at
once.

A command with the header `Idempotency-Key` (a text of the client's choice) is carried out once: sent again with its
key, it is answered as the first time. A command that was refused may be sent again.

`HEAD` is answered as `GET`, without a body.

Errors are problem details (RFC 9457, `application/problem+json`): `title`, `status`, `code`, `detail`, and for requests
with wrong fields `problems`, a list of {code, where, message, expected, nearest}. A request with an error has changed
nothing. Status: 400 the query or body cannot be read, 401 no credentials, 403 role, 404 unknown, 405 another method
(`Allow` has those that are possible), 409 not in this state, 413 too large, 422 wrong fields, 429 too many requests
(with `Retry-After`), 500 a mistake of the gateway, 503 the cell does not answer.

State and events:

- `GET /api/state`: {event, jobs, counts, viewers, role, user, robots, ready, capacity}. `event` is the id of the last
  event that it includes. `jobs` are the first 100 open jobs in the order of the queue, each as in the event `job`.
- `GET /api/events?after=ID&kinds=job,robot`: server-sent events after that id (also from the header `Last-Event-ID`).
  `data` of each is {id, kind, time, data}, its `id` that to resume after. Kinds: `job` (the whole job), `response` (a
  complete response), `cell` (as in the state), `world` (a change of the world model: {revision, author, added, updated,
  removed, related, unrelated}), and `reset`: events are missing, so read the state again.
- `GET /api/world`: {revision, elements}: the world model as in events `world`; each element is {id, type, label,
  properties: {name: [values]}, relations: [[predicate, object id], ...]}.

Other parts of the gateway add their routes with `create_app(service, routers)`. Their functions take `CallerArg` (the
authenticated caller) and `ServiceArg` (the model).
"""

from __future__ import annotations

import logging
from collections.abc import AsyncIterator, Sequence
from typing import Annotated, Any, Literal

from fastapi import APIRouter, FastAPI, Query, Request, Response
from fastapi.responses import StreamingResponse
from fastapi.routing import APIRoute
from pydantic import BaseModel, ConfigDict, Field

from skiros2_common.core.errors import UnknownName
from skiros2_gateway.core.access import Role
from skiros2_gateway.core.goal_form import GoalEdit
from skiros2_gateway.core.job import Method, Order
from skiros2_gateway.core.json_text import json_text
from skiros2_gateway.core.service import ROBOT_ACTIONS, Service
from skiros2_gateway.core.sessions import MAX_AGE
from skiros2_gateway.core.store import JobFilter
from skiros2_gateway.http import models
from skiros2_gateway.http.ascii_answers import AsciiAnswers
from skiros2_gateway.http.body_limit import MAX_BODY, BodyLimit
from skiros2_gateway.http.callers import COOKIE, CallerArg, ServiceArg, address_of
from skiros2_gateway.http.deadlines import Deadlines
from skiros2_gateway.http.errors import EVENTS, add_error_handlers, answers, describe, on_skiros_error
from skiros2_gateway.http.heads import Heads
from skiros2_gateway.http.once import Once

log = logging.getLogger(__name__)


def create_app(service: Service, routers: Sequence[APIRouter] = (), max_body: int = MAX_BODY) -> FastAPI:
    """Returns the application.

    :param routers: further routes.
    :param max_body: the largest body of a request (bytes).
    """
    app = FastAPI(
        title="SkiROS2 gateway",
        version="1",
        docs_url=None,
        redoc_url=None,
    )
    app.state.service = service
    # `include_router` would prepare all routes again with the first request, and try routers and routes with each one
    for route in (route for router in (_router, *routers) for route in router.routes):
        assert isinstance(route, APIRoute)
        route.operation_id = route.name  # for generators of clients
        app.router.routes.append(route)
    app.openapi = lambda: describe(app)  # type: ignore[method-assign]
    add_error_handlers(app)
    app.add_middleware(Once, on_error=on_skiros_error)
    app.add_middleware(Deadlines, on_error=on_skiros_error)
    app.add_middleware(BodyLimit, max_body=max_body)
    app.add_middleware(AsciiAnswers)
    app.add_middleware(Heads)
    return app


# -- the routes --------------------------------------------------------------------------------------------------------

#: The jobs of the queue in the answer to `/api/state`; `/api/jobs` has all in pages.
_FIRST_JOBS = 100

#: A number of the store: SQLite's integers have 64 bits.
Since = Annotated[int, Query(ge=0, lt=2**63)]

_router = APIRouter(prefix="/api")


class Comment(BaseModel):
    """Why a method is applied; kept in the job's history."""

    model_config = ConfigDict(extra="forbid")
    comment: str = ""


_NO_COMMENT = Comment()


class RobotNames(BaseModel):
    """Node names of robots; empty: all."""

    model_config = ConfigDict(extra="forbid")
    robots: list[str] = []


class PlanRequest(BaseModel):
    """A goal to plan for."""

    model_config = ConfigDict(extra="forbid")
    goal: str
    quality: Literal["", "first", "best", "optimal"] = ""


class SparqlQuery(BaseModel):
    """A query of the world model."""

    model_config = ConfigDict(extra="forbid")
    query: str


class Place(BaseModel):
    """A place in the queue: before another job; empty: at the end."""

    model_config = ConfigDict(extra="forbid")
    before: str = Field("", max_length=200)


class NewJob(Order):
    """An order, and whether it may start."""

    start: bool = True
    comment: str = ""


@_router.get("/health", responses=answers(models.Health), openapi_extra={"security": []})
async def health(service: ServiceArg) -> dict[str, Any]:
    """Whether the gateway runs. Needs no credentials."""
    return {"status": "running", "stream": service.events.name}


class Login(BaseModel):
    """The token of a user, or their name and password."""

    model_config = ConfigDict(extra="forbid")
    token: str = ""
    user: str = Field("", max_length=200)
    password: str = Field("", max_length=1000)


@_router.post("/session", responses=answers(models.LoggedIn), openapi_extra={"security": []})
async def login(request: Request, response: Response, body: Login, service: ServiceArg) -> dict[str, str]:
    """Starts a session of the page for a token, or a name and a password, and sets its cookie."""
    sessions, address = service.sessions, address_of(request)
    if body.user:
        secret, caller = await sessions.start_by_password(body.user, body.password, address)
    else:
        secret, caller = sessions.start(body.token, address)
    is_secure = request.url.scheme == "https"
    response.set_cookie(
        COOKIE, secret, max_age=int(MAX_AGE), httponly=True, samesite="strict", secure=is_secure, path="/"
    )
    return {"user": caller.user, "role": caller.role.name.lower()}


@_router.delete("/session", responses=answers(models.Empty))
async def logout(caller: CallerArg, response: Response, service: ServiceArg) -> dict[str, str]:
    """Ends the page's session, and removes its cookie."""
    if caller.session:
        service.sessions.end(caller, caller.session)
        await service.store.synced()
    response.delete_cookie(COOKIE, path="/")
    return {}


@_router.get("/sessions", responses=answers(models.Sessions))
async def sessions(caller: CallerArg, service: ServiceArg) -> dict[str, Any]:
    """The page's sessions that the caller may end: {sessions: [{id, user, address, created, is_own}]}."""
    service.view(caller)
    return {"sessions": service.sessions.open(caller)}


@_router.delete("/sessions/{session_id}", responses=answers(models.Empty, 404))
async def end_session(caller: CallerArg, service: ServiceArg, session_id: str) -> dict[str, str]:
    """Ends a session of the page: an own one, or with the role maintain any."""
    service.view(caller)
    service.sessions.end(caller, session_id)
    await service.store.synced()
    service.access.record(caller, "end session", session_id, "done")
    return {}


@_router.get("/state", responses=answers(models.CellState))
async def state(caller: CallerArg, service: ServiceArg) -> Response:
    """The state of the cell: robots, queue, counters."""
    return _with_jobs(service.control.jobs.texts(_FIRST_JOBS), service.state(caller))


@_router.get("/events", response_class=StreamingResponse, responses=EVENTS)
async def events(
    request: Request, caller: CallerArg, service: ServiceArg, after: str = "", kinds: str = ""
) -> StreamingResponse:
    """Server-sent events after an id."""
    service.view(caller)
    wanted = frozenset(kind for kind in kinds.split(",") if kind)
    stream = service.events.follow(request.headers.get("last-event-id", after), wanted)

    async def lines() -> AsyncIterator[str]:
        yield "retry: 1000\n\n"
        async for event in stream:
            if not service.is_admitted(caller):
                return
            yield f"id: {event.id}\nevent: {event.kind}\ndata: {event.json}\n\n"

    return StreamingResponse(lines(), media_type="text/event-stream")


@_router.get("/world", responses=answers(models.World))
async def world(caller: CallerArg, service: ServiceArg) -> dict[str, Any]:
    """The world model."""
    service.view(caller)
    return await service.control.cell.world()


@_router.get("/jobs", responses=answers(models.Jobs))
async def jobs(caller: CallerArg, service: ServiceArg, query: Annotated[models.JobQuery, Query()]) -> Response:
    """A page of the jobs, the newest first. `next` is the `after` of the page that follows; null on the last one."""
    service.view(caller)
    found = service.store.pages(JobFilter(**query.model_dump(exclude={"limit"})), query.limit + 1)
    page = found[: query.limit]
    return _with_jobs([text for _, text in page], {"next": page[-1][0] if len(found) > query.limit else None})


def _with_jobs(jobs: list[str], rest: dict[str, Any]) -> Response:
    """Returns an answer with `jobs` and other members: the texts of jobs are kept, as to make them costs the most."""
    text = json_text(rest)
    return Response(f'{{"jobs":[{",".join(jobs)}],{text[1:]}', media_type="application/json")


@_router.post("/jobs", status_code=201, responses=answers(models.JobData, status=201) | answers(models.JobData))
async def put_job(caller: CallerArg, service: ServiceArg, body: NewJob) -> Response:
    """Stores an order, and allows it to start unless `start` is false. 200 if the same order is known."""
    data = body.model_dump(mode="json", exclude={"start", "comment"})
    job, is_new = await service.put(caller, data, body.comment, start=body.start)
    return Response(service.control.jobs.text(job), 201 if is_new else 200, media_type="application/json")


@_router.get("/jobs/{job_id}", responses=answers(models.JobData, 404))
async def get_job(caller: CallerArg, service: ServiceArg, job_id: str) -> dict[str, Any]:
    """A job with its response."""
    service.view(caller)
    return service.control.get(job_id).to_dict()


@_router.put("/jobs/{job_id}", responses=answers(models.JobData, 404, 409))
async def update_job(caller: CallerArg, service: ServiceArg, job_id: str, body: NewJob) -> dict[str, Any]:
    """Replaces the order of a job that has not started."""
    data = body.model_dump(mode="json", exclude={"start", "comment"})
    return (await service.update(caller, {**data, "id": job_id}, body.comment)).to_dict()


@_router.post("/jobs/{job_id}/move", responses=answers(models.JobData, 404, 409))
async def move_job(caller: CallerArg, service: ServiceArg, job_id: str, body: Place) -> dict[str, Any]:
    """Moves a job of the queue to another place. Its priority stays; a PUT of its order ends the move."""
    return (await service.move(caller, job_id, body.before)).to_dict()


@_router.post("/jobs/{job_id}/{method}", responses=answers(models.JobData, 404, 409))
async def apply(
    caller: CallerArg, service: ServiceArg, job_id: str, method: str, body: Comment = _NO_COMMENT
) -> dict[str, Any]:
    """Applies start, revoke_start, pause, resume, stop, abort, cancel or clear."""
    known = {each.name.lower(): each for each in Method}
    if method not in known:
        raise UnknownName(f"there is no method {method!r}; there are: {', '.join(known)}")
    return (await service.apply(caller, known[method], job_id, body.comment)).to_dict()


@_router.get("/jobs/{job_id}/history", responses=answers(models.History, 404))
async def history(caller: CallerArg, service: ServiceArg, job_id: str) -> dict[str, Any]:
    """The changes of a job's state, the oldest first."""
    service.view(caller)
    return {"history": service.store.history(service.control.get(job_id).id)}


@_router.get("/work_masters", responses=answers(models.WorkMasters))
async def work_masters(caller: CallerArg, service: ServiceArg) -> dict[str, Any]:
    """The work masters, each with the JSON Schema of its parameters."""
    service.view(caller)
    masters = service.control.masters.all.values()
    return {"work_masters": [{**m.model_dump(mode="json"), "schema": m.parameters_schema()} for m in masters]}


@_router.post("/robots/{action}", responses=answers(models.TasksByRobot, 404, 409))
async def robots(caller: CallerArg, service: ServiceArg, action: str, body: RobotNames) -> dict[str, Any]:
    """Preempts, pauses or resumes all tasks of robots: actions stop, pause and resume."""
    if action not in ROBOT_ACTIONS:
        raise UnknownName(f"there is no action {action!r}; there are: {', '.join(ROBOT_ACTIONS)}")
    return await service.command_robots(caller, action, body.robots)


@_router.get("/skills", responses=answers(models.Skills))
async def skills(caller: CallerArg, service: ServiceArg) -> dict[str, Any]:
    """The skills of each robot: {robot: [{type, label, parameters}]}."""
    service.view(caller)
    return {"robots": await service.control.cell.skills()}


@_router.post("/plan", responses=answers(models.Plan, 409))
async def plan(caller: CallerArg, service: ServiceArg, body: PlanRequest) -> dict[str, Any]:
    """The plan for a goal, with its purpose and its simulated changes; nothing moves. See the action MakePlan."""
    with service.planning(caller):
        return await service.control.cell.plan(body.goal, body.quality)


@_router.post("/goal/form", responses=answers(models.GoalForm, 409))
async def goal_form(caller: CallerArg, service: ServiceArg, body: GoalEdit) -> dict[str, Any]:
    """The form that builds a goal: its lines, and the choices of each. See `skiros2_gateway.core.goal_form`."""
    service.view(caller, Role.OPERATE, "plan")
    return await service.control.cell.goal_form(body)


@_router.post("/world/query", responses=answers(models.Table, 409))
async def query(caller: CallerArg, service: ServiceArg, body: SparqlQuery) -> dict[str, Any]:
    """Answers a SPARQL query: {columns, rows}."""
    service.view(caller)
    return await service.control.cell.query(body.query, caller.user)


@_router.get("/audit", responses=answers(models.Audit))
async def audit(
    caller: CallerArg, service: ServiceArg, since: Since = 0, limit: Annotated[int, Query(ge=1, le=10_000)] = 1000
) -> dict[str, Any]:
    """The audit log, the oldest first; only entries with a number above `since`."""
    service.view(caller, Role.MAINTAIN, "read the audit log")
    return {"audit": service.access.audit_log(since, limit)}
