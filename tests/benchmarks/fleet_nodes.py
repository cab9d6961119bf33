"""Five skill managers as nodes with 20 tasks each, on the node of a world model of 10 000 elements, beside one manager.

This process changes the objects of the tasks in turn, and the tasks report the tick that sees a change, as in `skills`.
What a robot costs is the CPU time of its process. Each node receives the changes of all robots: the CPU of five is
measured beside one robot that sees its own changes only, and beside one in a world with as many changes as five robots
make. The time for an update is that of one after the other, of an element that no task watches; all nodes receive it,
and share the cores with the world model.
"""

from __future__ import annotations

import itertools
import socket
import statistics
import threading
import time
from collections.abc import Iterator
from pathlib import Path

from benchmarks.fleet import ELEMENTS, FLAT, TASKS, TIMEOUT, product
from benchmarks.measurement import Measurement, cpu_seconds
from benchmarks.skills import start_request
from skiros2_common.core.world_element import Element
from skiros2_msgs import srv as srvs
from skiros2_world_model.ros.world_model_interface import WorldModelInterface
from support.ros import Ros

ROBOTS = 5
#: The changes of the objects of each robot (1/s), and their number.
RATE, CHANGES = 5.0, 75
#: The duration of updates one after the other (s).
SECONDS = 3.0

SOCKET = "SKIROS_BENCH_SOCKET"
LIBRARY = f'''"""A skill that reports each new weight of its object, with the time, in a datagram."""
import os, socket, time

from skiros2_common.core.abstract_skill import SkillDescription, State
from skiros2_common.core.params import ParamTypes
from skiros2_common.core.primitive import PrimitiveBase
from skiros2_common.core.world_element import Element

_socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)


class BenchWatch(SkillDescription):
    def createDescription(self):
        self.addParam("Object", Element("skiros:Product"), ParamTypes.Required)
        self.addHoldCondition(self.getPropCond("Light", "skiros:Weight", "Object", "<", 1.0, True))


class bench_watch(PrimitiveBase):
    def createDescription(self):
        self.setDescription(BenchWatch(), "bench_watch")

    def onStart(self):
        self._weight = None
        return True

    def execute(self):
        weight = self.params["Object"].value.value_of("skiros:Weight")
        if weight != self._weight:
            self._weight = weight
            _socket.sendto(f"{{weight!r}} {{time.monotonic()}}".encode(), os.environ["{SOCKET}"])
        return State.Running
'''


class Ticks:
    """Receives in a thread of its own when a task has seen a weight (s, monotonic)."""

    def __init__(self, path: Path) -> None:
        self.seen: dict[float, float] = {}
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._socket.bind(str(path))
        threading.Thread(target=self._receive, daemon=True).start()

    def wait_for(self, number: int) -> None:
        """Waits until the tasks have seen that many weights."""
        limit = time.monotonic() + TIMEOUT
        while len(self.seen) < number:
            if time.monotonic() > limit:
                raise RuntimeError(f"{number - len(self.seen)} of {number} changes were not seen in {TIMEOUT} s")
            time.sleep(0.01)

    def _receive(self) -> None:
        while True:
            weight, moment = self._socket.recv(100).decode().split(" ")
            self.seen.setdefault(float(weight), float(moment))


class Fleet:
    """A world model and managers with their tasks, as nodes."""

    def __init__(self, ros: Ros, folder: Path) -> None:
        self._ros = ros
        self._workspace = folder / "fleet"
        package = self._workspace / "skiros2_bench_fleet"
        package.mkdir(parents=True)
        (package / "__init__.py").write_text("")
        (package / "bench_fleet.py").write_text(LIBRARY)
        self.ticks = Ticks(self._workspace / "ticks")
        self._env = {**ros.master.env, SOCKET: str(self._workspace / "ticks")}
        self._env["PYTHONPATH"] = f"{self._workspace}:{self._env['PYTHONPATH']}"
        params = {"workspace_dir": str(self._workspace)}
        ros.run("skiros2_world_model", "world_model_server_node", name="wm", params=params)
        ros.service("/wm/get", srvs.WmGet)
        self.wmi = WorldModelInterface("bench")
        for start in range(0, ELEMENTS, 1000):
            self.wmi.add_elements([product(str(number)) for number in range(start, start + 1000)])
        self.other = product("seen by no task")
        self.wmi.add_element(self.other)
        self._weights = (number * 1e-6 for number in itertools.count(1))
        self.objects: list[list[Element]] = []
        self.pids: list[int] = []

    def add_robot(self) -> None:
        """Starts a manager with its tasks, and waits until they run."""
        name = f"/robot_{len(self.pids)}"
        self.wmi.add_element(Element("cora:Robot", f"skiros:{name[1:]}"))
        params = {"libraries_list": ["skiros2_bench_fleet"], "primitive_list": ["bench_watch"], "skill_list": []}
        self._ros.run("skiros2_skill", "skill_manager_node", name=name[1:], params=params, env=self._env)
        command = self._ros.service(f"{name}/command", srvs.SkillCommand)
        objects = [product(f"{name} {number}") for number in range(TASKS)]
        self.wmi.add_elements(objects)
        for thing in objects:
            command(start_request("BenchWatch", Object=thing))
            self.change(thing)
        self.objects.append(objects)
        self.pids.append(self._ros.master.node_pid(name))

    def change(self, thing: Element) -> float:
        """Writes another weight, and returns it."""
        weight = next(self._weights)
        thing.setProperty("skiros:Weight", weight)
        self.wmi.update_element(thing)
        return weight


def measure(ros: Ros, folder: Path) -> Iterator[Measurement]:
    fleet = Fleet(ros, folder)
    fleet.add_robot()
    cpu_alone, delay_alone = _run(fleet)
    cpu_beside_changes, _ = _run(fleet, other_changes=ROBOTS - 1)
    time_alone = _time_for_an_update(fleet)
    while len(fleet.pids) < ROBOTS:
        fleet.add_robot()
    cpu, delay = _run(fleet)
    alone = "one robot alone"
    for what, unit, figure, peer, peer_figure, target in (
        ("CPU of each robot", "% of a core", cpu, alone, cpu_alone, FLAT),
        ("CPU of each robot", "% of a core", cpu, "one robot, as many changes in the world", cpu_beside_changes, FLAT),
        ("delay from a change to its tick, p99", "ms", delay, alone, delay_alone, FLAT),
        ("time for an update", "ms", _time_for_an_update(fleet), alone, time_alone, None),
    ):
        name = f"{ROBOTS} robots as nodes, {TASKS} tasks each: {what}"
        yield Measurement(name, figure, unit, 1, peer, peer_figure, figure / peer_figure, target)


def _run(fleet: Fleet, other_changes: int = 0) -> tuple[float, float]:
    """Changes the objects of all robots, at a constant rate.

    :param other_changes: of an element that no task watches, for each change of an object.
    :returns: the CPU of each robot (% of a core), and the delay from a change to its tick (ms, p99).
    """
    robots = len(fleet.pids)
    rate = RATE * (robots + other_changes)
    time.sleep(1.0)  # the starts of tasks are over
    fleet.ticks.seen.clear()
    written = {}
    cpu, begin = sum(map(cpu_seconds, fleet.pids)), time.monotonic()
    for count in range(CHANGES * (robots + other_changes)):
        time.sleep(max(0.0, begin + count / rate - time.monotonic()))
        turn, robot = divmod(count, robots + other_changes)
        if robot >= robots:
            fleet.change(fleet.other)
            continue
        start = time.monotonic()
        written[fleet.change(fleet.objects[robot][turn % TASKS])] = start
    cpu, elapsed = sum(map(cpu_seconds, fleet.pids)) - cpu, time.monotonic() - begin
    fleet.ticks.wait_for(len(written))
    delays = [1e3 * (fleet.ticks.seen[weight] - start) for weight, start in written.items()]
    return 100.0 * cpu / elapsed / robots, statistics.quantiles(delays, n=100, method="inclusive")[-1]


def _time_for_an_update(fleet: Fleet) -> float:
    """Milliseconds for an update, one after the other."""
    count, begin = 0, time.monotonic()
    while time.monotonic() < begin + SECONDS:
        fleet.change(fleet.other)
        count += 1
    return 1e3 * (time.monotonic() - begin) / count
