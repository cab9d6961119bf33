"""The routes of the live view, and of the page.

- `GET /api/live`: {event, time, clock, document, styles, role, user, person, stop_port}: the document of
  `skiros2_gateway.core.live`, the id of the last patch, and {symbol, word, role} of the states: `styles.node` by
  number, `styles.task` by name. `clock` is the monotonic clock (s) of the header `X-Deadline`; `stop_port` is the port
  of `skiros2_gateway.stop`, -1 without one.
- `GET /api/live/patches?after=ID`: server-sent events `patch` after that id (also from the header `Last-Event-ID`);
  `data` is {id, kind, time, data} with a JSON Merge Patch of the document as `data`. An event `reset` means: patches
  are missing, so read the document again. With `beats=true` an event `beat` with the clock comes once a second.
- `GET /api/live/runs/KEY?time=T`: a run at a time, see `run_view.history_data`; also of a bag.
- `GET /api/live/runs/KEY/scene?time=T`: `elements`, `frames` and `bodies` of the document at that time.
- `GET /api/live/runs/KEY/why`: why it failed. `GET /api/live/runs/KEY/nodes/ID?time=T`: parameters and conditions of a
  node, of a task that has ended as they were last read.
- `POST /api/live/runs/KEY/ACTION`: stop, pause, resume or step (one tick) of a task; of a goal: its running tasks.
- `GET /api/live/mesh?url=URL`: a mesh of an element or robot in the document, or a file beside it.
- `GET /api/live/bags`, `GET /api/live/bags/NAME`: the recorded runs, and the runs, goals and signals in one.
"""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from pathlib import Path
from time import monotonic
from typing import Annotated, Any

from fastapi import APIRouter, Request, Response
from fastapi import Path as PathParam
from fastapi.responses import FileResponse, StreamingResponse
from pydantic import FiniteFloat

from skiros2_common.core.errors import Refused, UnknownName
from skiros2_gateway.core.bags import Bags
from skiros2_gateway.core.events import Event
from skiros2_gateway.core.json_text import json_text
from skiros2_gateway.core.live import TASK_ACTIONS, LiveCell, LiveView
from skiros2_gateway.core.run_view import history_data
from skiros2_gateway.http import models
from skiros2_gateway.http.callers import CallerArg, ServiceArg
from skiros2_gateway.http.errors import EVENTS, answers, errors_of
from skiros2_runs.core.goal_runs import GOALS
from skiros2_runs.core.states import ROLE_COLOURS, NodeState, StateStyle, TaskState, style_of
from skiros2_runs.core.task_run import TaskRun

#: The number of a node: 32 bits in messages.
NodeId = Annotated[int, PathParam(ge=0, lt=2**31)]

_FILE = {**errors_of(404), 200: {"content": {"*/*": {}}}}

#: The page may load its own files only, and pictures that it draws itself.
_POLICY = (
    "default-src 'self'; connect-src 'self'{}; img-src 'self' data: blob:; style-src 'self' 'unsafe-inline';"
    " frame-ancestors 'none'"
)
#: The period of beats (s).
BEAT = 1.0


def live_router(view: LiveView, cell: LiveCell, bags: Bags, stop_port: int = -1) -> APIRouter:
    """Returns the routes of the live view."""
    router = APIRouter(prefix="/api/live")

    def find(key: str) -> TaskRun:
        return bags.find_run(key) if key.startswith("bag/") else view.find_run(key)

    def live_run(key: str) -> TaskRun:
        run = find(key)
        if key.startswith("bag/") or run.is_finished:
            raise Refused(f"{key} has ended")
        return run

    @router.get("", responses=answers(models.Document))
    async def document(caller: CallerArg, service: ServiceArg) -> Response:
        """The document, and the id of the last patch."""
        service.view(caller)
        user = {"role": caller.role.name.lower(), "user": caller.user, "person": caller.person}
        text = view.snapshot_text({"styles": _styles(), "stop_port": stop_port, "clock": monotonic(), **user})
        return Response(text, media_type="application/json")

    @router.get("/patches", response_class=StreamingResponse, responses=EVENTS)
    async def patches(
        request: Request, caller: CallerArg, service: ServiceArg, after: str = "", beats: bool = False
    ) -> StreamingResponse:
        """Server-sent patches after an id."""
        service.view(caller)
        stream = view.stream.follow(request.headers.get("last-event-id", after))

        async def lines() -> AsyncIterator[bytes]:
            yield b"retry: 500\n\n"
            async for message in _with_beats(stream) if beats else (event.message async for event in stream):
                if not service.is_admitted(caller):
                    return
                yield message

        return StreamingResponse(lines(), media_type="text/event-stream")

    @router.get("/mesh", response_class=FileResponse, responses=_FILE)
    async def mesh(caller: CallerArg, service: ServiceArg, url: str) -> FileResponse:
        """A mesh of the document."""
        service.view(caller)
        path = cell.mesh_file(url)
        if not path.is_file():
            raise UnknownName(f"{url}: there is no file {path}")
        return FileResponse(path)

    @router.get("/bags", responses=answers(models.Bags))
    async def list_bags(caller: CallerArg, service: ServiceArg) -> dict[str, Any]:
        """The recorded runs: {bags: [{name, size, time}]}, the newest first."""
        service.view(caller)
        return {"bags": await asyncio.to_thread(bags.list)}

    @router.get("/bags/{name}", responses=answers(models.BagContent, 404, 409))
    async def open_bag(caller: CallerArg, service: ServiceArg, name: str) -> Response:
        """Runs of trees in a bag by key, see `run_view.summary_data`, goals, signals, and the damage of the file."""
        with service.reading_bag(caller):
            return _json(await asyncio.to_thread(bags.open, name))

    @router.get("/runs/{key:path}/why", responses=answers(models.Why, 404, 409))
    async def why(caller: CallerArg, service: ServiceArg, key: str) -> dict[str, Any]:
        """Why a run failed: {text, explanations}."""
        service.view(caller)
        run = view.find_run(key)
        if run.robot != GOALS:
            return await cell.why(run.robot, run.task_id)
        failed = [task for task in view.cell.goal_runs.tasks(run) if task.state is TaskState.FAILED]
        why = await cell.why(failed[-1].robot, failed[-1].task_id) if failed else {"text": "", "explanations": []}
        return {**why, "text": "\n".join(filter(None, (run.latest.message(0), why["text"])))}

    @router.get("/runs/{key:path}/nodes/{node}", responses=answers(models.NodeValues, 404, 409))
    async def node(
        caller: CallerArg, service: ServiceArg, key: str, node: NodeId, time: FiniteFloat | None = None
    ) -> dict[str, Any]:
        """The parameters and conditions of a node."""
        service.view(caller)
        run = find(key)
        if not key.startswith("bag/"):
            origin = view.cell.goal_runs.origin(run, node)
            if origin is None:
                raise UnknownName(f"node {node} of {key} is in no task")
            run, node = origin
        if time is None and not run.is_finished and not key.startswith("bag/"):
            run.add_values(await cell.inspect(run.robot, run.task_id, node))
        values = run.values_at(node, run.latest.time if time is None else time)
        if values is None:
            raise UnknownName(f"the values of node {node} of {key} were not read while it ran")
        return values.to_dict()

    @router.get("/runs/{key:path}/scene", responses=answers(models.Scene, 404))
    async def scene_at(caller: CallerArg, service: ServiceArg, key: str, time: FiniteFloat) -> Response:
        """Elements and robots at a time."""
        if key.startswith("bag/"):
            with service.reading_bag(caller):
                return _json(await asyncio.to_thread(bags.scene_at, key, time, cell.recorded_view()))
        service.view(caller)
        find(key)
        return _json(view.scenes.at(time))

    @router.get("/runs/{key:path}", responses=answers(models.RunAt, 404))
    async def run_at(caller: CallerArg, service: ServiceArg, key: str, time: FiniteFloat | None = None) -> Response:
        """A run at a time."""
        service.view(caller)
        return _json(history_data(find(key), time))

    @router.post("/runs/{key}/{action}", responses=answers(models.Empty, 404, 409))
    async def command(caller: CallerArg, service: ServiceArg, key: str, action: str) -> dict[str, Any]:
        """Stops, pauses, resumes or steps a task."""
        if action not in TASK_ACTIONS:
            raise UnknownName(f"there is no action {action!r}; there are: {', '.join(TASK_ACTIONS)}")

        async def send() -> dict[str, Any]:
            run = live_run(key)
            if run.robot == GOALS and action == "stop":
                cell.stop_goal(view.cell.goal_runs.id_of(run))
            for task in view.cell.goal_runs.tasks(run) if run.robot == GOALS else [run]:
                if run is task or (action != "stop" and not task.is_finished):
                    await cell.command(action, task.robot, task.task_id)
            return {}

        return await service.command(caller, f"{action} task", key, send)

    return router


async def _with_beats(events: AsyncIterator[Event]) -> AsyncIterator[bytes]:
    """Yields the messages of events, and an event `beat` with the clock once a second."""
    following = asyncio.ensure_future(anext(events))
    due = monotonic()
    try:
        while True:
            await asyncio.wait({following}, timeout=max(0.0, due - monotonic()))
            if following.done():
                yield following.result().message
                following = asyncio.ensure_future(anext(events))
            if monotonic() >= due:
                due = monotonic() + BEAT
                yield f"event: beat\ndata: {monotonic():.3f}\n\n".encode()
    finally:
        following.cancel()


def page_router(folder: Path, stop_port: int = -1) -> APIRouter:
    """Returns the routes of the page; they need no credentials, as the page has no data of the cell.

    :param folder: of the bundled files.
    """
    router = APIRouter()
    headers = {"Content-Security-Policy": _POLICY.format(f" *:{stop_port}" if stop_port >= 0 else "")}

    @router.get("/", include_in_schema=False)
    async def page() -> Response:
        if not (folder / "index.html").is_file():
            text = "The page is not installed. Run: make setup (it needs npm); REST works: see /openapi.json\n"
            return Response(text, 404, media_type="text/plain")
        return FileResponse(folder / "index.html", headers=headers)

    @router.get("/page/states.css", include_in_schema=False)
    async def colours() -> Response:
        lines = [f"--{role}: light-dark({light}, {dark});" for role, (light, dark) in ROLE_COLOURS.items()]
        return Response(f":root {{{' '.join(lines)}}}\n", media_type="text/css")

    @router.get("/page/{name}", include_in_schema=False)
    async def asset(name: str) -> FileResponse:
        if name not in [path.name for path in folder.glob("*")]:
            raise UnknownName(f"the page has no file {name}")
        return FileResponse(folder / name, headers=headers)

    return router


def _styles() -> dict[str, Any]:
    def data(style: StateStyle) -> dict[str, str]:
        return {"symbol": style.symbol, "word": style.word, "role": style.colour_role}

    return {
        "node": {int(state): data(style_of(state)) for state in NodeState},
        "task": {str(state): data(style_of(state)) for state in TaskState},
    }


def _json(data: Any) -> Response:
    return Response(json_text(data), media_type="application/json")
