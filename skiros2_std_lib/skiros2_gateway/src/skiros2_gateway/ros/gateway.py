"""The gateway node: one asyncio loop in the main thread; threads of ROS hand over to it."""

from __future__ import annotations

import asyncio
import contextlib
import errno
import importlib
import logging
import socket
import sys
import threading
import time
from pathlib import Path
from typing import Any

import rospkg
import rospy
from fastapi import APIRouter
from pydantic import ValidationError

from skiros2_common.core.errors import ConfigurationError
from skiros2_common.core.file_lock import own_file
from skiros2_gateway.core.access import Access
from skiros2_gateway.core.approvals import Approvals
from skiros2_gateway.core.bags import Bags
from skiros2_gateway.core.events import EventStream
from skiros2_gateway.core.figures import Figures, totals_of
from skiros2_gateway.core.job_control import JobControl
from skiros2_gateway.core.live import LiveView
from skiros2_gateway.core.missed_tasks import MissedTasks
from skiros2_gateway.core.other_cells import OtherCells, read_cells
from skiros2_gateway.core.problems import problems_of
from skiros2_gateway.core.retention import keep_days
from skiros2_gateway.core.service import Service
from skiros2_gateway.core.settings import Settings
from skiros2_gateway.core.store import JobStore
from skiros2_gateway.core.users import UsersFile
from skiros2_gateway.core.work_masters import WorkMasters, read_work_masters
from skiros2_gateway.http.alarms import alarms_router
from skiros2_gateway.http.app import create_app
from skiros2_gateway.http.cameras import cameras_router
from skiros2_gateway.http.figures import figures_router
from skiros2_gateway.http.live import live_router, page_router
from skiros2_gateway.http.other_cells import other_cells_router
from skiros2_gateway.http.server import GRACE, HttpServer, Limits
from skiros2_gateway.mqtt.bridge import MqttBridge
from skiros2_gateway.ros.cameras import RosCameras
from skiros2_gateway.ros.live import LiveRos
from skiros2_gateway.ros.ros_cell import RosCell
from skiros2_gateway.ros.stop_process import StopProcess
from skiros2_live.core.cell import RobotChanged

log = logging.getLogger(__name__)

#: Private parameters that are not settings: of every node, and those that the gateway sets.
_OTHERS = ("verbose", "debug", "address", "stop_address", "opcua_address")


#: The time for which a port that is in use is tried again, and the period (s): a killed gateway's process for stops
#: may have it for a moment.
_PORT_TIMEOUT, _PORT_PERIOD = 5.0, 0.2

#: How long a thread that computes, such as the one that makes OPC UA's nodes, keeps the loop waiting (s). With Python's
#: 0.005 s, half of the requests in the first seconds took 17 ms, not 3.5 ms.
_SWITCH_INTERVAL = 0.0005


def main() -> None:
    """Serves until ROS shuts down.

    :raises ConfigurationError: parameters or files have mistakes; the text names all.
    """
    sys.setswitchinterval(_SWITCH_INTERVAL)
    asyncio.run(_serve(_settings()))


def _settings() -> Settings:
    found: dict[str, Any] = rospy.get_param("~", {}) or {}
    found.update(found.pop("settings", {}))  # a parameter with any of the settings, which overrides the others
    try:
        return Settings.model_validate({key: value for key, value in found.items() if key not in _OTHERS})
    except ValidationError as error:
        raise ConfigurationError("; ".join(str(problem) for problem in problems_of(error))) from error


async def _serve(settings: Settings) -> None:
    loop, ended = asyncio.get_running_loop(), asyncio.Event()
    is_down = threading.Event()

    def end() -> None:
        """In the shutdown's thread: waits until the loop has ended, while the node is still up."""
        with contextlib.suppress(RuntimeError):  # the loop has ended by itself
            loop.call_soon_threadsafe(ended.set)
            is_down.wait(2 * GRACE + 3.0)

    folder = settings.make_folder()
    masters = WorkMasters(read_work_masters(Path(settings.work_masters).expanduser()) if settings.work_masters else ())
    users = UsersFile(settings.users_file)
    lock = own_file(folder / "jobs.sqlite")  # two gateways would both start its jobs
    store = JobStore(folder / "jobs.sqlite")
    events = EventStream()
    control = JobControl(store, masters, events)
    access = Access(users.users, store, settings.rate, settings.burst)
    approvals = Approvals(events, is_needed=settings.agents == "ask", timeout=settings.approval_timeout)
    service = Service(store, access, control, events, approvals)
    rospy.set_param("wm/journal_sync", True)  # a job that is done has not lost its changes, also after a power failure
    cell = RosCell(control, events, masters, settings.jobs_at_once)
    cell.document.continue_counters(totals_of(store.figures()))
    figures = Figures(store, cell.document)
    MissedTasks(cell.document, control.jobs)
    async with contextlib.AsyncExitStack() as stack:
        stack.callback(is_down.set)
        stack.callback(lock.close)
        stack.callback(store.close)
        stack.callback(service.access.close)
        stack.callback(cell.close)
        stack.callback(control.close)
        control.start(cell)
        rospy.on_shutdown(end)
        stack.callback(loop.create_task(users.follow(service.set_users)).cancel)
        stack.push_async_callback(_ended, loop.create_task(figures.keep()))
        stack.callback(loop.create_task(keep_days(store, settings.keep_days)).cancel)
        if settings.http_port >= 0:
            sock = await _listen(settings, "http_port", settings.http_port)
            stops = await _start_stop_port(service, cell, settings, sock.getsockname()[1], stack)
            stop_port = stops.port if stops is not None else -1
            routers = [figures_router(figures.write), *_live_view(service, cell, settings, stop_port, stack)]
            if settings.agents != "off":
                module = await _imported("skiros2_gateway.agents.server")
                hosts = [settings.host, *filter(None, settings.hosts.replace(" ", "").split(","))]
                agents = module.AgentServer(service, settings.max_body, hosts)
                await stack.enter_async_context(agents.running())
                routers.append(agents.router())
            if stops is not None and not await stops.serves():  # whoever uses the gateway can stop robots
                log.error("the stop port does not serve yet")
            await _start_http(service, settings, sock, routers, stack)
        if settings.opcua_port >= 0:
            module = await _imported("skiros2_gateway.opcua.server")
            opcua = module.OpcuaServer(service, settings, _share() / "nodesets")
            await opcua.start()
            stack.push_async_callback(opcua.stop)
            rospy.set_param("~opcua_address", opcua.address)
        if settings.mqtt:
            bridge = MqttBridge(service, settings)
            bridge.start()
            stack.push_async_callback(bridge.stop)
        await ended.wait()


async def _imported(module: str) -> Any:
    """Imports a module that takes about a second, in a thread: meanwhile the loop serves others."""
    return await asyncio.to_thread(importlib.import_module, module)


async def _ended(task: asyncio.Task[None]) -> None:
    """Cancels a task, and waits for its end."""
    task.cancel()
    with contextlib.suppress(asyncio.CancelledError):
        await task


def _live_view(
    service: Service, cell: RosCell, settings: Settings, stop_port: int, stack: contextlib.AsyncExitStack
) -> list[APIRouter]:
    """Starts the live view, which ends with the stack. Returns its routes and those of the page."""
    view = LiveView(cell.document)
    live = LiveRos(cell)
    stack.callback(live.close)
    cameras = RosCameras(cell)
    stack.callback(cameras.close)
    stack.callback(asyncio.get_running_loop().create_task(view.follow(service)).cancel)
    bags = Bags(Path(settings.bags).expanduser() if settings.bags else None, settings.make_folder() / "bags")
    page = _share() / "page"  # missing if it was not built
    others = OtherCells(read_cells(Path(settings.cells).expanduser()) if settings.cells else [])
    routers = [live_router(view, live, bags, stop_port), cameras_router(view, cameras), alarms_router(view)]
    return [*routers, other_cells_router(others), page_router(page, stop_port)]


def _share() -> Path:
    return Path(rospkg.RosPack().get_path("skiros2_gateway"))


async def _listen(settings: Settings, name: str, port: int) -> socket.socket:
    """
    :param name: of the setting.
    :raises ConfigurationError: the address is in use.
    """
    family = socket.AF_INET6 if ":" in settings.host else socket.AF_INET
    sock = socket.socket(family, socket.SOCK_STREAM, socket.IPPROTO_TCP)
    sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    end = time.monotonic() + _PORT_TIMEOUT
    while True:
        try:
            sock.bind((settings.host, port))
            sock.listen()  # clients that read the address connect at once
            return sock
        except OSError as error:
            if error.errno != errno.EADDRINUSE or time.monotonic() > end:
                raise ConfigurationError(f"{name} {port} on {settings.host}: {error.strerror or error}") from error
        await asyncio.sleep(_PORT_PERIOD)


async def _start_stop_port(
    service: Service, cell: RosCell, settings: Settings, http_port: int, stack: contextlib.AsyncExitStack
) -> StopProcess | None:
    """Starts the process of the stop port, which ends with the stack. Returns None if it is off.

    :raises ConfigurationError: the address is in use.
    """
    if settings.stop_port < 0:
        return None
    port = settings.stop_port or (http_port + 1 if settings.http_port else 0)
    sock = await _listen(settings, "stop_port", port)
    stops = StopProcess(service, settings, sock, lambda: cell.connected)
    stack.push_async_callback(stops.close)
    cell.document.subscribe(RobotChanged, lambda _: stops.inform())
    rospy.set_param("~stop_address", _address(settings, sock))
    return stops


def _address(settings: Settings, sock: socket.socket) -> str:
    host, port = sock.getsockname()[:2]
    return f"{'https' if settings.certificate else 'http'}://{host}:{port}"


async def _start_http(
    service: Service,
    settings: Settings,
    sock: socket.socket,
    routers: list[APIRouter],
    stack: contextlib.AsyncExitStack,
) -> None:
    """Starts the HTTP server, which ends with the stack.

    :raises ConfigurationError: the certificate cannot be read.
    """
    limits = Limits(of_address=settings.connections)
    app = create_app(service, routers, max_body=settings.max_body)
    server = HttpServer(app, sock, settings.certificate, settings.key, limits)
    server.start()
    stack.push_async_callback(server.stop)
    address = _address(settings, sock)
    rospy.set_param("~address", address)
    log.info("the gateway serves %s; users and tokens are in %s", address, settings.users_file)
