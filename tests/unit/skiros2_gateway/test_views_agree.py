"""Window, page, interfaces and bags are views of one document: of the same cell they show the same."""

from __future__ import annotations

import asyncio
import json
import threading
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

pytest.importorskip("asyncua")

from asyncua import Client, ua

from skiros2_bags.core.recorded_cell import recorded_cell, recorded_patches
from skiros2_bags.core.run import Run
from skiros2_gateway.core.bags import Bags
from skiros2_gateway.core.live import LiveView
from skiros2_gateway.core.recorded_bag import read_scene
from skiros2_gateway.http.live import live_router
from skiros2_gui.app.system import MANAGER, parts_of
from skiros2_gui.app.tasks import skills_text
from skiros2_gui.app.window import Window
from skiros2_live.core.cell import RobotChanged
from skiros2_live.core.patch import (
    MASTER,
    WORLD_MODEL,
    Connection,
    EntriesChanged,
    ManagerConnection,
    Patch,
    SafetyChanged,
)
from skiros2_live.core.scene_view import SceneView
from skiros2_runs.core.goal_runs import GOALS
from skiros2_runs.core.task_run import TaskRun
from skiros2_world_model.core.queries import SceneReader
from support.broker import broker, needs_broker
from support.http_gateway import curl, served
from support.opcua import cell_index, opcua_server
from support.ros import ROOT
from support.window.synchronous import make_window
from unit.skiros2_gateway.conftest import TOKENS, Gateway
from unit.skiros2_gateway.test_mqtt import connected

BAG = ROOT / "tests/bags/timed_goal.bag"
ROBOT = "/mobile_manipulator"
#: How many times during the run the views are compared.
MOMENTS = 8
#: What does not depend on when a view's document began.
_ROBOT_KEYS = ("name", "state", "reason", "tasks")

#: Name, state, and the names and states of the nodes of each task that lists show.
Tasks = list[tuple[str, str, list[str], list[int]]]


class Cell:
    """The document of a recorded cell whose robot is stopped at times, and its views."""

    def __init__(self, gateway: Gateway) -> None:
        self.run = Run.open(BAG)
        self.gateway = gateway
        self.document = gateway.cell.document
        self.document.subscribe(RobotChanged, lambda _: gateway.control.cell_changed())
        gateway.cell.state = self.state  # type: ignore[method-assign]
        scene = self.run.world(partial=True)
        reader = SceneReader(threading.RLock(), lambda _: [scene], SimpleNamespace)  # type: ignore[arg-type]
        system: Any = SimpleNamespace(scene=reader, managers={}, planner=None)
        self.window: Window = make_window(lambda _: system)

    def state(self) -> dict[str, Any]:
        return {"robots": self.document.robots_data(), "ready": True, "capacity": 1}

    def patches(self) -> Iterator[Patch]:
        """Yields those of the bag, of its scene at the end, and of stops of the robot."""
        yield ManagerConnection(ROBOT, True)
        yield Connection(MASTER, "http://localhost:11311", True, 1.0)
        yield Connection(WORLD_MODEL, "/wm", False, 0.0)
        view = SceneView(lambda child, parent: child == parent)
        for _, eid, element in read_scene(BAG).elements:
            yield EntriesChanged("elements", {eid: view.element(element) if element is not None else None})
        for number, patch in enumerate(recorded_patches(self.run)):
            yield patch
            if number % 100 == 0:
                yield Connection(WORLD_MODEL, "/wm", number % 200 == 0, patch.stamp, "It has not answered for 5 s.")
            if number % 50 == 49:
                yield SafetyChanged(ROBOT, "protective_stop", "light curtain", ("light curtain",), patch.stamp)
            if number % 50 == 10:
                yield SafetyChanged(ROBOT, "running", "", (), patch.stamp)

    def apply(self, patch: Patch) -> None:
        self.document.apply(patch)
        if not isinstance(patch, EntriesChanged):
            self.window.post(patch)
            self.window.process_events()


def tasks_of(runs: list[TaskRun]) -> Tasks:
    found = []
    for run in runs:
        shape = run.latest.shape
        names = [shape.name(index) for index in range(len(shape))]
        found.append((skills_text(run), str(run.state), names, run.latest.rows["state"].tolist()))
    return found


def tasks_of_page(document: dict[str, Any]) -> Tasks:
    found = []
    for key, run in document["runs"].items():
        if "goal" not in run:
            tree = document["trees"][key]
            names = tree["shape"]["names"]
            found.append((run["name"], run["state"], names, [tree["rows"][str(i)][0] for i in range(len(names))]))
    return found


@asynccontextmanager
async def views(cell: Cell, folder: Path) -> AsyncIterator[tuple[str, Client]]:
    """Serves the page's routes and OPC UA; yields the address of HTTP, and a client of OPC UA."""
    view = LiveView(cell.document)
    following = asyncio.create_task(view.follow(cell.gateway.service))
    routers = [live_router(view, SimpleNamespace(), Bags(None))]  # type: ignore[arg-type]
    opcua = opcua_server(cell.gateway.service, folder)
    await opcua.start()
    client = Client(opcua.address, timeout=10)
    client.set_user("view")
    client.set_password(TOKENS["view"])
    try:
        async with served(cell.gateway.service, routers=routers) as address, client:
            yield address, client
    finally:
        await opcua.stop()
        following.cancel()


def has_state(state: str, data: Any) -> bool:
    return [robot["state"] for robot in data["robots"]] == [state]


async def until_equal(read: Any, expected: Any) -> None:
    """Waits until a view that follows later shows what is expected."""
    for _ in range(300):
        try:
            found = await read()
        except ua.UaStatusCodeError as error:
            found = error
        if found == expected:
            return
        await asyncio.sleep(0.02)
    assert found == expected


def test_window_page_and_interfaces_show_the_same_at_any_time(in_gateway: Any, tmp_path: Path) -> None:
    async def test(gateway: Gateway) -> None:
        cell = Cell(gateway)
        patches = list(cell.patches())
        seen: list[tuple[Tasks, list[str]]] = []
        async with views(cell, tmp_path) as (address, client):
            index = await cell_index(client)

            async def opcua(path: str) -> Any:
                return await client.get_node(ua.NodeId(path, index)).read_value()

            for number, patch in enumerate(patches, 1):
                cell.apply(patch)
                if number % (len(patches) // MOMENTS) and number < len(patches):
                    continue
                shown = tasks_of(cell.window.tasks.shown)
                document = (await curl(address, "/api/live", token=TOKENS["view"]))[1]["document"]
                assert tasks_of_page(document) == shown
                [robot] = (await curl(address, "/api/state", token=TOKENS["view"]))[1]["robots"]
                *others, shown_robot = parts_of(cell.window.tasks.cell)
                assert (shown_robot.kind, shown_robot.name, shown_robot.is_up) == (MANAGER, robot["name"], True)
                assert shown_robot.stop == ("protective stop" if robot["state"] == "protective_stop" else "")
                [of_window] = cell.window.tasks.cell.robots_data()
                assert [of_window[key] for key in _ROBOT_KEYS] == [robot[key] for key in _ROBOT_KEYS]
                connections = document["connections"].values()
                assert [(part.kind, part.name, part.is_up, part.since, part.text) for part in others] == [
                    (each["name"], each["address"], each["is_up"], each["since"], each["text"]) for each in connections
                ]
                await until_equal(partial(opcua, f"Cell/Robots{ROBOT}/State"), robot["state"])
                assert await opcua(f"Cell/Robots{ROBOT}/Reason") == robot["reason"]
                titles = [goal["title"] for goal in document["goals"].values()]
                assert titles == [skills_text(run) for run in cell.window.tasks.runs if run.robot == GOALS]
                seen.append((shown, [robot["state"]]))
            elements = document["elements"]
            for eid in ("demo:Tray-12", "skiros:Product-14"):
                await until_equal(partial(opcua, f"World/{eid}/Type"), elements[eid]["type"])
                relations = [" ".join(relation) for relation in elements[eid]["relations"]]
                await until_equal(partial(opcua, f"World/{eid}/Relations"), sorted(relations))
        assert shown == tasks_of(recorded_cell(cell.run).shown)
        [(name, state, nodes, _)] = shown
        assert (name, state) == ("Tray B contains Product A", "succeeded") and len(nodes) > 4
        assert {state for _, [state] in seen} >= {"protective_stop", "busy"}
        assert len({json.dumps(tasks) for tasks, _ in seen}) > MOMENTS // 2

    in_gateway(test)


@needs_broker
def test_mqtt_has_the_robots_and_elements_of_the_document(in_gateway: Any) -> None:
    async def test(gateway: Gateway) -> None:
        cell = Cell(gateway)
        with broker() as port:
            async with connected(gateway, port, "views") as (_, subscriber):
                states = set()
                for patch in cell.patches():
                    cell.apply(patch)
                    robots = cell.document.robots_data()
                    if robots and robots[0]["state"] not in states:
                        states.add(robots[0]["state"])
                        data = await subscriber.until("views/cell", partial(has_state, robots[0]["state"]))
                        assert [robot["name"] for robot in data["robots"]] == [ROBOT]
                assert states == {"idle", "busy", "protective_stop"}
                gateway.events.publish("reset", {})  # what was published before was skipped
                tray = await subscriber.until("views/world/demo:Tray-12")
                shown = cell.document.tables["elements"]["demo:Tray-12"]
                assert all(json.dumps(value) == json.dumps(shown[key]) for key, value in tray.items())

    in_gateway(test)
