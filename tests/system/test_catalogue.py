"""The trees of the catalogue on a skill manager: its progress messages match the traces."""

from __future__ import annotations

import itertools
import os
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import pytest

from catalogue import CASES, PREEMPT, Case
from catalogue.clients import CatalogueServers
from skiros2_common.core.abstract_skill import State
from skiros2_common.core.primitive import PrimitiveBase
from skiros2_common.tools.plugin_loader import PluginLoader
from skiros2_msgs import msg as msgs
from skiros2_msgs import srv as srvs
from skiros2_skill.core.skill import SkillBase
from skiros2_skill.ros.skill_manager_interface import SkillManagerInterface
from skiros2_skill.testing import SkillBench, Trace
from skiros2_skill.testing.bench_task import TracedNode
from skiros2_world_model.ros.world_model_interface import WorldModelInterface
from support.ros import Messages, Ros

pytestmark = pytest.mark.timeout(300)

ROBOT = "/test_robot"
TESTS = Path(__file__).parents[1]

_STATES = {
    msgs.SkillProgress.SUCCESS: State.Success,
    msgs.SkillProgress.FAILURE: State.Failure,
    msgs.SkillProgress.RUNNING: State.Running,
    msgs.SkillProgress.IDLE: State.Idle,
}


@pytest.fixture(scope="module")
def servers(ros_master: Any) -> Iterator[CatalogueServers]:
    servers = CatalogueServers()
    yield servers
    servers.close()


@pytest.fixture
def robot(ros: Ros) -> Iterator[SkillManagerInterface]:
    """A manager with all skills of the catalogue, on a world model with a blank scene."""
    classes = PluginLoader().find("catalogue", (PrimitiveBase, SkillBase))
    python_path = os.pathsep.join([str(TESTS), ros.master.env.get("PYTHONPATH", "")])
    ros.launch(
        "skiros2", "skiros.launch", gui=False, task_mgr_on=False, libraries_list="[catalogue]",
        primitive_list=[c.__name__ for c in classes if not issubclass(c, SkillBase)],
        skill_list=[c.__name__ for c in classes if issubclass(c, SkillBase)],
        env={**ros.master.env, "PYTHONPATH": python_path},
    )  # fmt: skip
    ros.service(f"{ROBOT}/command", srvs.SkillCommand)
    client = SkillManagerInterface(ROBOT, "tests")
    yield client
    client.shutdown()


@pytest.mark.long
def test_one_manager_reproduces_all_traces(ros: Ros, robot: SkillManagerInterface, servers: CatalogueServers) -> None:
    messages = _listen(ros, robot)
    world = SkillBench(wmi=WorldModelInterface("tests", make_cache=True))
    differ = []
    for case in CASES:
        trace = Stage(robot, messages, world).play(case)
        if str(trace) != str(case.trace):
            differ.append(f"{case.name}, expected:\n{case.trace}\nseen:\n{trace}")
    assert not differ, "\n\n".join(differ)


def test_parallel_tasks_have_the_same_traces_as_single_ones(ros: Ros, robot: SkillManagerInterface) -> None:
    """At the manager's own rate; those that need nothing of the world. Names are not looked at: which implementation is
    free depends on the others."""
    messages = _listen(ros, robot)
    cases = [case for case in CASES if not (case.scene or case.events or case.servers)]
    tasks = {_start(robot, case): case for case in cases}
    assert len(tasks) == len(cases) > 20
    for task in tasks:
        messages.wait_for(lambda message, task=task: message.progress[0].task_id == task and _has_ended(message))
    told: dict[int, list[Any]] = {task: [] for task in tasks}
    for message in messages.all:
        root = message.progress[0]
        column = _states(_seen(message))
        if root.state != root.IDLE and told[root.task_id][-1:] != [column]:
            told[root.task_id].append(column)
    for task, case in tasks.items():
        columns = map(_states, case.trace.ticks)
        assert told[task] == [column for column, _ in itertools.groupby(columns)], case.name


def _listen(ros: Ros, robot: SkillManagerInterface) -> Messages:
    """The manager's messages from now on; the subscriber is connected."""
    messages = ros.messages(f"{ROBOT}/monitor", msgs.TreeProgress)
    task = robot.tick_once(skill_list=[robot.get_skill("default_sequence")])
    messages.wait_for(lambda message: message.progress[0].task_id == task)  # it is told once a second at least
    robot.preempt_one(task)
    messages.wait_for(lambda message: message.progress[0].task_id == task and _has_ended(message))
    messages.clear()
    return messages


def _states(nodes: Iterable[TracedNode]) -> list[Any]:
    return [(node.child_indices, node.state, node.code) for node in nodes]


def _start(robot: SkillManagerInterface, case: Case) -> int:
    holder = robot.get_skill(case.name)
    for key, value in case.given.items():
        holder.ph.specify(key, value)
    return robot.execute(skill_list=[holder])


@pytest.mark.parametrize("case", [case for case in CASES if case.servers], ids=lambda case: case.name)
def test_traces_of_server_clients_are_the_same_in_one_process(
    servers: CatalogueServers, skill_bench: SkillBench, case: Case
) -> None:
    task = case.play(skill_bench)
    assert str(task.trace) == str(case.trace), task.why


class Stage:
    """Plays a case on a manager: its world has what the case needs while it is played.

    The task is ticked by `tick_once`, so that events come between the ticks that they belong between.
    """

    def __init__(self, robot: SkillManagerInterface, messages: Messages, world: SkillBench) -> None:
        self._robot = robot
        self._messages = messages
        self._world = world
        self._last: list[Any] = []

    def play(self, case: Case) -> Trace:
        wmi = self._world.wmi
        before = {e.id for e in wmi.get_scene_elements()}
        if case.scene is not None:
            case.scene(self._world)
        try:
            return Trace([list(_seen(message)) for message in self._ticks(case)])
        finally:
            for element in wmi.get_scene_elements():
                if element.id not in before and wmi.is_scene_element(element.id):
                    wmi.remove_element(element)

    def _ticks(self, case: Case) -> Iterator[Any]:
        """The messages after each tick, up to the end or the number of the case."""
        holder = self._robot.get_skill(case.name)
        for key, value in case.params(self._world).items():
            holder.ph.specify(key, value)
        self._messages.clear()
        task = self._robot.tick_once(skill_list=[holder])
        assert task >= 0, self._robot.last_error
        message = self._next(task)
        yield message
        for tick in range(2, len(case.trace.ticks) + 1):
            if _has_ended(message):
                return
            event = case.events.get(tick)
            self._messages.clear()
            if event == PREEMPT:
                self._robot.preempt_one(task)
            else:
                if event is not None:
                    event(self._world)
                self._robot.tick_once(task)
            message = self._next(task)
            yield message
        if not _has_ended(message):
            self._robot.preempt_one(task)
            self._messages.wait_for(lambda m: m.progress[0].task_id == task and _has_ended(m))

    def _next(self, task: int) -> Any:
        """What is told after the next tick. What is told again, because nothing has changed, is passed over: at each
        tick of the catalogue some skill makes a step."""

        def is_new(message: Any) -> bool:
            root, *others = message.progress
            now = [(node.id, node.state, node.progress_code, node.progress_time) for node in others]
            if root.task_id != task or now == self._last or all(n.state == n.IDLE for n in others):
                return False
            self._last = now
            return True

        return self._messages.wait_for(is_new)


def _has_ended(message: Any) -> bool:
    return abs(message.progress[0].progress_code) == 1


def _seen(message: Any) -> Iterator[TracedNode]:
    places: dict[int, tuple[int, ...]] = {}
    children: dict[int, int] = {}
    for node in message.progress:
        if node.parent_id in places:
            index = children.get(node.parent_id, 0)
            children[node.parent_id] = index + 1
            places[node.id] = (*places[node.parent_id], index)
        else:
            places[node.id] = ()
        name = node.label or (node.processor if node.type == ":Skill" else node.type.rpartition(":")[2])
        name = "root" if node.type == ":Root" else name
        yield TracedNode(places[node.id], name, _STATES[node.state], node.progress_code)
