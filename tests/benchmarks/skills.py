"""A skill manager as a real node: how soon it does what it is asked, and what its progress costs.

Its skills tell when their hooks are called, to a socket of this process; all processes share the monotonic clock.
Figures are from the moment before the call, so that they hold all that a user waits for.
"""

from __future__ import annotations

import itertools
import socket
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import rospy

from benchmarks.measurement import Measurement, cpu_seconds, paired
from benchmarks.services import _bare_service, _echo, _size
from skiros2_common.core.params import Param, ParamTypes
from skiros2_common.core.world_element import Element
from skiros2_common.ros.utils import serializeParamMap
from skiros2_msgs import msg as msgs
from skiros2_msgs import srv as srvs
from skiros2_world_model.ros.world_model_interface import WorldModelInterface
from support.ros import Ros

ROBOT = "/test_robot"
SOCKET = "SKIROS_BENCH_SOCKET"
RUNS = 30
#: The largest part of a core that the progress of a large tree may take while nothing changes (%).
MOST_FOR_PROGRESS = 5.0
NODES = 1000
PERIOD = 10.0  # s that CPU time is measured

LIBRARY = f'''"""Skills that tell when their hooks are called: the hook, the task's name and the time, in a datagram."""
import os, socket, time

from skiros2_common.core.abstract_skill import SkillDescription, State
from skiros2_common.core.params import ParamTypes
from skiros2_common.core.primitive import PrimitiveBase
from skiros2_common.core.world_element import Element
from skiros2_skill.core.skill import ParallelFf, SkillBase

_socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)


def tell(what, skill):
    _socket.sendto(f"{{what}} {{skill.params['Name'].value}} {{time.monotonic()}}".encode(), os.environ["{SOCKET}"])


class BenchOnce(SkillDescription):
    def createDescription(self):
        self.addParam("Name", str, ParamTypes.Required)


class bench_once(PrimitiveBase):
    """Tells of its first `execute`."""

    def createDescription(self):
        self.setDescription(BenchOnce(), "bench_once")

    def execute(self):
        tell("first", self)
        return self.success("")


class BenchRun(SkillDescription):
    def createDescription(self):
        self.addParam("Name", str, ParamTypes.Required)


class bench_run(PrimitiveBase):
    """Runs until it is preempted; tells of each tick and of its end."""

    def createDescription(self):
        self.setDescription(BenchRun(), "bench_run")

    def execute(self):
        tell("tick", self)
        return self.step("")

    def onEnd(self):
        tell("end", self)
        return True


class BenchHold(SkillDescription):
    def createDescription(self):
        self.addParam("Name", str, ParamTypes.Required)
        self.addParam("Object", Element("skiros:Product"), ParamTypes.Required)
        self.addHoldCondition(self.getPropCond("Light", "skiros:Weight", "Object", "<", 1.0, True))


class bench_hold(PrimitiveBase):
    """Runs while its object is light."""

    def createDescription(self):
        self.setDescription(BenchHold(), "bench_hold")

    def execute(self):
        if self.progress_code == 0:
            tell("first", self)
        return self.step("")

    def onEnd(self):
        tell("end", self)
        return True


class BenchIdle(SkillDescription):
    pass


class bench_idle(PrimitiveBase):
    """Runs and has nothing to tell."""

    def createDescription(self):
        self.setDescription(BenchIdle(), "bench_idle")

    def execute(self):
        return State.Running


class BenchMany(SkillDescription):
    def createDescription(self):
        self.addParam("Number", int, ParamTypes.Required)


class bench_many(SkillBase):
    """As many leaves that run, in groups of ten."""

    def createDescription(self):
        self.setDescription(BenchMany(), "bench_many")
        self._expand_on_start = True

    def expand(self, skill):
        skill.setProcessor(ParallelFf())
        number = self.params["Number"].value
        for start in range(0, number, 10):
            group = [self.skill("BenchIdle", "bench_idle") for _ in range(min(10, number - start))]
            skill(self.skill(ParallelFf())(*group))
'''


class _Ear:
    """Hears what the skills tell."""

    def __init__(self, path: Path) -> None:
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._socket.bind(str(path))
        self._socket.settimeout(10.0)

    def wait_for(self, what: str, name: str) -> float:
        """When a skill told that (s, monotonic). What others tell before is dropped."""
        while True:
            heard = self._next()
            if heard[:2] == (what, name):
                return heard[2]

    def ticks(self, seconds: float) -> dict[str, list[float]]:
        """When each task was ticked, for so long from now."""
        times: dict[str, list[float]] = {}
        end = time.monotonic() + seconds
        while (heard := self._next())[2] < end:
            if heard[0] == "tick":
                times.setdefault(heard[1], []).append(heard[2])
        return times

    def _next(self) -> tuple[str, str, float]:
        what, name, moment = self._socket.recv(1000).decode().split(" ")
        return what, name, float(moment)


class _Manager:
    """The manager of the skills above.

    :param command: its service.
    """

    def __init__(self, ros: Ros, folder: Path) -> None:
        workspace = folder / "skills"
        package = workspace / "skiros2_bench_skills"
        package.mkdir(parents=True)
        (package / "__init__.py").write_text("")
        (package / "bench_skills.py").write_text(LIBRARY)
        self.ear = _Ear(workspace / "ear")
        env = {**ros.master.env, SOCKET: str(workspace / "ear")}
        env["PYTHONPATH"] = f"{workspace}:{env['PYTHONPATH']}"
        names = ["bench_once", "bench_run", "bench_hold", "bench_idle"]
        params = {"libraries_list": [package.name], "primitive_list": names, "skill_list": ["bench_many"]}
        ros.run("skiros2_world_model", "world_model_server_node", name="wm", params={"workspace_dir": str(workspace)})
        ros.service("/wm/get", srvs.WmGet)
        ros.run("skiros2_skill", "skill_manager_node", name=ROBOT[1:], params=params, env=env)
        self.command = ros.service(f"{ROBOT}/command", srvs.SkillCommand)
        self.pid = ros.master.node_pid(ROBOT)
        self._names = itertools.count()

    def start(self, stype: str, **params: object) -> int:
        return int(self.command(start_request(stype, **params)).execution_id)

    def preempt(self, task: int) -> None:
        self.command(srvs.SkillCommandRequest("bench", srvs.SkillCommandRequest.PREEMPT, task, []))

    def new_name(self) -> str:
        return f"task-{next(self._names)}"


def start_request(stype: str, **params: object) -> srvs.SkillCommandRequest:
    """The request that starts a skill."""
    handler = {key: Param(key, "", value, ParamTypes.Required) for key, value in params.items()}
    skill = msgs.ResourceDescription(stype, "", serializeParamMap(handler))
    return srvs.SkillCommandRequest("bench", srvs.SkillCommandRequest.START, -1, [skill])


def measure(ros: Ros, folder: Path) -> Iterator[Measurement]:
    manager = _Manager(ros, folder)
    bare = _bare_service(ros, folder)
    request = start_request("BenchOnce", Name=manager.new_name())
    call = _echo(bare, _size(request), _size(srvs.SkillCommandResponse()))

    def peer() -> float:
        begin = time.monotonic()
        call()
        return 1e3 * (time.monotonic() - begin)

    def beside_the_peer(name: str, ours: Callable[[], float], limit: float) -> Measurement:
        what = "a call of a bare rospy service"
        return paired(name, lambda: 1e3 * ours(), what, peer, unit="ms", runs=RUNS, warm_up=3, limit=limit)

    yield beside_the_peer("from a command to the first `execute`", lambda: _start(manager), 5.0)
    many = manager.start("BenchMany", Number=100)
    yield beside_the_peer(
        "from a command to the first `execute`, while another task of 100 nodes runs", lambda: _start(manager), 5.0
    )
    manager.preempt(many)
    yield beside_the_peer("from a command to the end of one of five tasks", lambda: _preempt(manager), 50.0)
    yield _unaffected(manager)
    wmi = WorldModelInterface("bench")
    product = Element("skiros:Product", "held")
    product.setProperty("skiros:Weight", 0.5)
    wmi.add_element(product)
    yield beside_the_peer(
        "from a change by another process to the end it causes", lambda: _react(manager, wmi, product), 10.0
    )
    yield _progress(manager)


def _start(manager: _Manager) -> float:
    """From a command to the skill's first `execute` (s)."""
    name = manager.new_name()
    request = start_request("BenchOnce", Name=name)
    begin = time.monotonic()
    manager.command(request)
    return manager.ear.wait_for("first", name) - begin


def _preempt(manager: _Manager, tasks: int = 5) -> float:
    """From a command to the end of a skill, while others run (s)."""
    names = [manager.new_name() for _ in range(tasks)]
    ids = [manager.start("BenchRun", Name=name) for name in names]
    manager.ear.wait_for("tick", names[-1])
    begin = time.monotonic()
    manager.preempt(ids[2])
    took = manager.ear.wait_for("end", names[2]) - begin
    for task in (task for task in ids if task != ids[2]):
        manager.preempt(task)
    return took


def _unaffected(manager: _Manager) -> Measurement:
    """The longest that four tasks wait for a tick while others are started and preempted, beside when none are."""
    ids = [manager.start("BenchRun", Name=manager.new_name()) for _ in range(4)]

    def gap(disturbed: bool) -> float:
        if disturbed:
            manager.preempt(manager.start("BenchRun", Name="another"))
        times = manager.ear.ticks(0.4)
        gaps = [b - a for name, t in times.items() if name != "another" for a, b in itertools.pairwise(t)]
        return 1e3 * max(gaps)

    row = paired(
        "longest wait of four tasks for a tick, another one preempted", lambda: gap(True),
        "none is preempted", lambda: gap(False), unit="ms", runs=15, target=1.2,
    )  # fmt: skip
    for task in ids:
        manager.preempt(task)
    return row


def _react(manager: _Manager, wmi: WorldModelInterface, product: Element) -> float:
    """From an update in this process to the end of a skill whose hold-condition speaks of it (s)."""
    name = manager.new_name()
    product.setProperty("skiros:Weight", 0.5)
    wmi.update_element(product)
    manager.start("BenchHold", Name=name, Object=product)
    manager.ear.wait_for("first", name)
    product.setProperty("skiros:Weight", 2.0)
    begin = time.monotonic()
    wmi.update_element(product)
    return manager.ear.wait_for("end", name) - begin


def _progress(manager: _Manager) -> Measurement:
    """The CPU time of the manager while a large tree runs in which nothing changes, with its ticks."""
    task = manager.start("BenchMany", Number=NODES)
    topic = f"{ROBOT}/monitor"

    def share(listening: bool) -> float:
        if not listening:
            return _share_of_core(manager.pid)
        subscriber = rospy.Subscriber(topic, rospy.AnyMsg, lambda _: None)
        try:
            rospy.wait_for_message(topic, rospy.AnyMsg, timeout=10.0)
            return _share_of_core(manager.pid)
        finally:
            subscriber.unregister()

    row = paired(
        f"manager of {NODES} leaves in which nothing changes, progress heard", lambda: share(True),
        "nobody listens", lambda: share(False), unit="% of a core", runs=3, warm_up=0, limit=MOST_FOR_PROGRESS,
    )  # fmt: skip
    manager.preempt(task)
    return row


def _share_of_core(pid: int) -> float:
    """The CPU time of a process over the period, in % of one core."""
    before, begin = cpu_seconds(pid), time.monotonic()
    time.sleep(PERIOD)  # the period of a measurement
    return 100.0 * (cpu_seconds(pid) - before) / (time.monotonic() - begin)
