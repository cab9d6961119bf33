"""Clients of skill managers: `SkillManagerInterface`, `SkillLayerInterface`, `DiscoveryInterface`."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest

from compatibility.rules import rule
from compatibility.test_preempt_nodes import ROBOT, Cell
from skiros2_common.core.errors import UnknownName
from skiros2_common.core.world_element import Element
from skiros2_skill.ros.discovery_interface import DiscoveryInterface
from skiros2_skill.ros.skill_layer_interface import SkillLayerInterface
from skiros2_skill.ros.skill_manager_interface import SkillManagerInterface
from skiros2_world_model.ros.world_model_interface import WorldModelInterface
from support.ros import Ros, RosMaster, wait_until

pytestmark = pytest.mark.timeout(240)


@pytest.fixture(scope="module")
def cell(ros_master: RosMaster) -> Iterator[Cell]:
    ros = Ros(ros_master)
    cell = Cell(ros)
    yield cell
    cell.client.shutdown()
    ros.stop()


@pytest.fixture
def robot(cell: Cell) -> Iterator[SkillManagerInterface]:
    yield cell.client
    cell.client.preempt_all()
    wait_until(lambda: not cell.client.tasks, what="the end of all tasks")


@pytest.fixture
def layer(cell: Cell) -> Iterator[SkillLayerInterface]:
    layer = SkillLayerInterface("tests")
    wait_until(lambda: layer.agents, what="an agent")
    yield layer
    layer.shutdown()


@rule("client", "`preempt_one`, `preempt_all`, `pause_one` and `pause_all` answer True or False")
def test_commands_answer_true_or_false(cell: Cell, robot: SkillManagerInterface) -> None:
    task = cell.start("creep")
    assert robot.pause_one(task) is True
    assert robot.pause_all() is True
    assert robot.preempt_one(task) is True
    cell.end(task)
    assert robot.preempt_one(task) is False
    assert robot.pause_one(task) is False
    assert robot.preempt_all() is True


@rule(
    "client", "`preempt_one()` and `pause_one()` answer False when no task is known", better="and touch no other task"
)
def test_commands_without_a_task_answer_false(cell: Cell, robot: SkillManagerInterface) -> None:
    assert robot.tasks == []
    assert robot.preempt_one() is False
    assert robot.pause_one() is False
    task = cell.start("creep")
    assert robot.pause_one() is True
    assert robot.preempt_one() is True
    cell.end(task)


@rule(
    "client",
    "`.tasks` is the list of the ids of running tasks, `.task` the first of them",
    better="a task is in it as soon as `execute` has answered",
)
def test_tasks_is_the_list_of_running_tasks(cell: Cell, robot: SkillManagerInterface) -> None:
    assert robot.tasks == []
    first = cell.start("creep")
    second = robot.execute(skill_list=[robot.get_skill("creep")])
    assert robot.tasks == [first, second]
    assert robot.task == first
    robot.preempt_one(first)
    wait_until(lambda: robot.tasks == [second])
    assert robot.task == second


@rule("client", "`._skill_list` is a dict of the skills by name, which windows of others read")
def test_the_private_skill_list_is_a_dict_by_name(robot: SkillManagerInterface) -> None:
    assert {name: skill.type for name, skill in robot._skill_list.items()}["creep"] == "skiros:Block"


@rule(
    "client",
    "`SkillLayerInterface.get_agent(x)` takes a name or the robot's element, by its `skiros:SkillMgr` with and "
    "without slash",
)
def test_an_agent_is_found_by_name_or_element(layer: SkillLayerInterface) -> None:
    by_hand = Element("cora:Robot", "by hand")
    by_hand.setProperty("skiros:SkillMgr", ROBOT)
    wmi = WorldModelInterface("tests")
    (registered,) = [r for r in wmi.resolve_elements(Element("cora:Robot")) if r.hasProperty("skiros:SkillMgr")]
    for asked in (ROBOT, ROBOT[1:], by_hand, registered, None):
        assert layer.get_agent(asked).name == ROBOT
    with pytest.raises(UnknownName, match=r"no skill manager other runs; there are: /test_robot"):
        layer.get_agent("other")


@rule("client", "`.has_active_agents`: a task is running")
def test_agents_are_active_while_a_task_runs(cell: Cell, robot: SkillManagerInterface, layer: Any) -> None:
    assert not layer.has_active_agents
    task = cell.start("creep")
    wait_until(lambda: layer.has_active_agents, what="an active agent")
    robot.preempt_one(task)
    wait_until(lambda: not layer.has_active_agents, what="the end of the task")


@rule("client", '`DiscoveryInterface.init_discovery("skill_managers", ...)`: the slash may be left out')
@pytest.mark.parametrize("name", ["skill_managers", "/skill_managers"])
def test_slash_of_the_namespace_is_optional(cell: Cell, name: str) -> None:
    found: list[str] = []
    follower = DiscoveryInterface()
    follower.init_discovery(name, found.append, lambda agent: None)
    wait_until(lambda: found == [ROBOT], what="the manager")
    follower.stop_discovery()


@rule("more", "`tick_once` and `pause` answer when the task is paused and its tick is over")
def test_a_task_that_was_ticked_once_can_be_started_at_once(cell: Cell, robot: SkillManagerInterface) -> None:
    task = robot.tick_once(skill_list=[robot.get_skill("creep")])
    for _ in range(20):
        assert robot.execute(task) == task, robot.last_error
        assert robot.pause_one(task), robot.last_error
        assert robot.tick_once(task) == task, robot.last_error
    assert robot.preempt_one(task)
    cell.end(task)
