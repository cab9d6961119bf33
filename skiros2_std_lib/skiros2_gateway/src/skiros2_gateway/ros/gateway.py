"""The gateway node: one asyncio loop in the main thread; threads of ROS hand over to it."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import socket
import threading
from pathlib import Path
from typing import Any

import rospkg
import rospy
from fastapi import APIRouter
from pydantic import ValidationError

from skiros2_common.core.errors import ConfigurationError
from skiros2_gateway.agents.server import AgentServer
from skiros2_gateway.core.access import Access
from skiros2_gateway.core.approvals import Approvals
from skiros2_gateway.core.bags import Bags
from skiros2_gateway.core.events import EventStream
from skiros2_gateway.core.job_control import JobControl
from skiros2_gateway.core.live import LiveView
from skiros2_gateway.core.problems import problems_of
from skiros2_gateway.core.retention import keep_days
from skiros2_gateway.core.service import Service
from skiros2_gateway.core.settings import Settings
from skiros2_gateway.core.store import JobStore
from skiros2_gateway.core.users import UsersFile
from skiros2_gateway.core.work_masters import WorkMasters, read_work_masters
from skiros2_gateway.http.app import create_app
from skiros2_gateway.http.live import live_router, page_router
from skiros2_gateway.http.server import GRACE, HttpServer, Limits
from skiros2_gateway.mqtt.bridge import MqttBridge
from skiros2_gateway.opcua.server import OpcuaServer
from skiros2_gateway.ros.live import LiveRos
from skiros2_gateway.ros.ros_cell import RosCell

log = logging.getLogger(__name__)

#: Private parameters that are no settings: of every node, and those that the gateway sets.
_OTHERS = ("verbose", "debug", "address", "opcua_address")


def main() -> None:
    """Serves until ROS shuts down.

    :raises ConfigurationError: parameters or files have mistakes; the text names all.
    """
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
    store = JobStore(folder / "jobs.sqlite")
    events = EventStream()
    control = JobControl(store, masters, events)
    access = Access(users.users, store, settings.rate, settings.burst)
    approvals = Approvals(events, is_needed=settings.agents == "ask", timeout=settings.approval_timeout)
    service = Service(store, access, control, events, approvals)
    cell = RosCell(control, events, masters, settings.jobs_at_once)
    async with contextlib.AsyncExitStack() as stack:
        stack.callback(is_down.set)
        stack.callback(store.close)
        stack.callback(service.access.close)
        stack.callback(cell.close)
        stack.callback(control.close)
        control.start(cell)
        rospy.on_shutdown(end)
        stack.callback(loop.create_task(users.follow(access.set_users)).cancel)
        stack.callback(loop.create_task(keep_days(store, settings.keep_days)).cancel)
        if settings.http_port >= 0:
            routers = _live_view(service, cell, settings, stack)
            if settings.agents != "off":
                hosts = [settings.host, *filter(None, settings.hosts.replace(" ", "").split(","))]
                agents = AgentServer(service, settings.max_body, hosts)
                await stack.enter_async_context(agents.running())
                routers.append(agents.router())
            await _start_http(service, settings, routers, stack)
        if settings.opcua_port >= 0:
            opcua = OpcuaServer(service, settings)
            await opcua.start()
            stack.push_async_callback(opcua.stop)
            rospy.set_param("~opcua_address", opcua.address)
        if settings.mqtt:
            bridge = MqttBridge(service, settings)
            bridge.start()
            stack.push_async_callback(bridge.stop)
        await ended.wait()


def _live_view(
    service: Service, cell: RosCell, settings: Settings, stack: contextlib.AsyncExitStack
) -> list[APIRouter]:
    """Starts the live view, which ends with the stack. Returns its routes and those of the page."""
    view = LiveView()
    live = LiveRos(cell, view)
    stack.callback(live.close)
    stack.callback(asyncio.get_running_loop().create_task(view.follow(service)).cancel)
    bags = Bags(Path(settings.bags).expanduser() if settings.bags else None)
    page = Path(rospkg.RosPack().get_path("skiros2_gateway")) / "page"  # missing if it was not built
    return [live_router(view, live, bags), page_router(page)]


async def _start_http(
    service: Service, settings: Settings, routers: list[APIRouter], stack: contextlib.AsyncExitStack
) -> None:
    """Starts the HTTP server, which ends with the stack.

    :raises ConfigurationError: the address is in use, or the certificate cannot be read.
    """
    family = socket.AF_INET6 if ":" in settings.host else socket.AF_INET
    # asyncio sets TCP_NODELAY only if TCP is named; without it each answer takes 40 ms longer
    sock = socket.socket(family, socket.SOCK_STREAM, socket.IPPROTO_TCP)
    sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        sock.bind((settings.host, settings.http_port))
        sock.listen()  # clients that read the address connect at once
    except OSError as error:
        raise ConfigurationError(f"http_port {settings.http_port} on {settings.host}: {error}") from error
    limits = Limits(of_address=settings.connections)
    app = create_app(service, routers, max_body=settings.max_body)
    server = HttpServer(app, sock, settings.certificate, settings.key, limits)
    server.start()
    stack.push_async_callback(server.stop)
    host, port = sock.getsockname()[:2]
    address = f"{'https' if settings.certificate else 'http'}://{host}:{port}"
    rospy.set_param("~address", address)
    log.info("the gateway serves %s; users and tokens are in %s", address, settings.users_file)
