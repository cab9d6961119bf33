"""Skill managers that are killed, suspended and restarted."""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import rospy

from skiros2_common.core.world_element import Element
from skiros2_msgs import msg as msgs
from skiros2_msgs import srv as srvs
from skiros2_skill.ros.skill_layer_interface import SkillLayerInterface
from skiros2_skill.ros.skill_manager_interface import SkillManagerInterface
from skiros2_task.ros.task_manager_interface import FAILED, PLAN, TaskManagerInterface
from skiros2_world_model.ros.world_model_interface import WmException, WorldModelInterface
from support.ros import Ros, wait_until

pytestmark = pytest.mark.timeout(120)

ROBOT = "/test_robot"
LAST_WILL = f"last will of {ROBOT}"
STATE, HOLDER = "skiros:StateProperty", "skiros:LockedBy"

SKILLS = """
from skiros2_common.core.abstract_skill import ParamOptions, SkillDescription
from skiros2_common.core.params import ParamTypes
from skiros2_common.core.primitive import PrimitiveBase
from skiros2_common.core.world_element import Element

class Move(SkillDescription):
    def createDescription(self):
        self.addParam("Arm", Element("rparts:ArmDevice"), ParamTypes.Required, [ParamOptions.Lock])
        self.addParam("Ticks", 1, ParamTypes.Required)

class move(PrimitiveBase):
    def createDescription(self):
        self.setDescription(Move(), "move")

    def onStart(self):
        self.ticks = 0
        return True

    def execute(self):
        self.ticks += 1
        done = self.ticks >= self.params["Ticks"].value
        return self.success("moved") if done else self.step("moving")

class Visit(SkillDescription):
    def createDescription(self):
        self.addParam("TargetLocation", Element("skiros:Location"), ParamTypes.Required)
        self.addPreCondition(self.getRelationCond("NotThere", "skiros:at", "Robot", "TargetLocation", False))
        self.addPostCondition(self.getRelationCond("RobotAt", "skiros:at", "Robot", "TargetLocation", True))

class visit(PrimitiveBase):
    def createDescription(self):
        self.setDescription(Visit(), "visit")

    def execute(self):
        return self.success("there")
"""
PARAMS = {"libraries_list": ["arm_skills"], "primitive_list": ["move", "visit"]}


class Cell:
    """A world model and a skill manager whose skill `move` locks an arm, and a client of both."""

    def __init__(self, ros: Ros, folder: Path) -> None:
        (folder / "library" / "arm_skills").mkdir(parents=True)
        (folder / "library" / "arm_skills" / "__init__.py").write_text("")
        (folder / "library" / "arm_skills" / "moving.py").write_text(SKILLS)
        self.ros = ros
        self.folder = folder
        path = f"{folder / 'library'}:{ros.master.env['PYTHONPATH']}"
        self.env = {**ros.master.env, "PYTHONPATH": path}
        self.start_world_model()
        self.wmi = WorldModelInterface("tests")
        self.changes = ros.messages("/wm/monitor", msgs.WmMonitor)
        self.arm = Element("rparts:ArmDevice", "arm")
        self.arm.setProperty(STATE, "Idle")
        self.wmi.add_element(self.arm)

    def start_world_model(self) -> None:
        params = {"workspace_dir": str(self.folder)}
        self.ros.run("skiros2_world_model", "world_model_server_node", name="wm", params=params)
        self.ros.service("/wm/last_will", srvs.WmLastWill)

    def start_manager(self) -> None:
        self.manager = self.ros.run("skiros2_skill", "skill_manager_node", name=ROBOT[1:], params=PARAMS, env=self.env)
        self.wait_for_manager()

    def wait_for_manager(self) -> None:
        self.ros.service(f"{ROBOT}/command", srvs.SkillCommand)

    # -- the scene ---------------------------------------------------------------------------------------------

    def lock(self) -> tuple[str | None, str | None]:
        """State and holder of the arm."""
        found = self.wmi.get_element(self.arm.id)
        return found.value_of(STATE), found.value_of(HOLDER)

    def skills(self) -> list[str]:
        """The labels of all skills in the scene."""
        return sorted(str(skill.label) for skill in self.wmi.resolve_elements(Element("skiros:Skill")))

    def has_buried(self) -> None:
        """Waits until the last will of the manager was carried out."""
        self.changes.wait_for(lambda change: change.author == LAST_WILL)
        wait_until(lambda: self.skills() == [], what="the end of the skills")
        assert self.lock() == ("Idle", None)
        assert self.wmi.resolve_elements(Element("skiros:Parameter")) == []

    def was_never_buried(self) -> bool:
        return all(change.author != LAST_WILL for change in self.changes.all)

    # -- tasks -------------------------------------------------------------------------------------------------

    def move(self, ticks: int) -> int:
        """Starts a task that locks the arm for a number of ticks; returns its id."""
        client = SkillManagerInterface(ROBOT, "tests")
        try:
            skill = client.get_skill("move")
            skill.ph.specify("Arm", self.wmi.get_element(self.arm.id))
            skill.ph.specify("Ticks", ticks)
            task = client.execute(skill_list=[skill])
            assert task >= 0, client.last_error
            return task
        finally:
            client.shutdown()

    def moves_for_long(self) -> None:
        """A task has locked the arm, for as long as the manager runs."""
        self.move(1_000_000)
        wait_until(lambda: self.lock() == ("Busy", ROBOT), what="the lock")

    def preempt_all(self) -> None:
        client = SkillManagerInterface(ROBOT, "tests")
        client.preempt_all()
        client.shutdown()
        assert client.last_error == ""

    def works(self) -> bool:
        """Whether the manager is in the world model once, and runs a task that locks the arm, to its end."""
        wait_until(self._is_listed, what="the skills of the manager")
        heard = self.ros.messages(f"{ROBOT}/monitor", msgs.TreeProgress)
        wait_until(lambda: heard._subscriber.get_num_connections(), what="the connection to the manager")
        task = self.move(3)
        last = heard.wait_for(lambda m: m.progress[0].id == task and abs(m.progress[0].progress_code) == 1)
        return bool(last.progress[0].state == msgs.SkillProgress.SUCCESS) and self.lock() == ("Idle", None)

    def _is_listed(self) -> bool:
        try:
            return self.skills() == ["move", "visit"]
        except WmException:  # one of them has just been replaced, or the world model has just been started
            return False


@pytest.fixture
def cell(ros: Ros, tmp_path: Path) -> Cell:
    cell = Cell(ros, tmp_path)
    cell.start_manager()
    return cell


@pytest.fixture
def layer() -> Iterator[SkillLayerInterface]:
    layer = SkillLayerInterface("tests")
    yield layer
    layer.shutdown()


# -- a manager that dies -----------------------------------------------------------------------------------------------


def test_killed_manager_is_removed_from_the_world_model(cell: Cell, ros: Ros) -> None:
    cell.moves_for_long()
    ros.kill_node(ROBOT)
    cell.has_buried()


def test_last_will_is_empty_after_a_clean_shutdown(cell: Cell, ros: Ros) -> None:
    cell.moves_for_long()
    cell.manager.interrupt()
    cell.manager.wait()
    wait_until(lambda: cell.skills() == [] and cell.lock() == ("Idle", None), what="skills and lock away")
    cell.wmi.add_element(Element("skiros:Part", "after"))  # and this is told after all before
    cell.changes.wait_for(lambda change: any(e.label == "after" for e in change.elements))
    assert cell.was_never_buried()


@pytest.mark.long
def test_suspended_manager_continues(cell: Cell) -> None:
    cell.moves_for_long()
    process = cell.ros.master.node_pid(ROBOT)
    os.kill(process, signal.SIGSTOP)
    try:
        assert not threading.Event().wait(2.0)
    finally:
        os.kill(process, signal.SIGCONT)
    cell.preempt_all()
    wait_until(lambda: cell.lock() == ("Idle", None), what="the end of the task")
    assert cell.works()
    assert cell.was_never_buried()


@pytest.mark.long
def test_skills_of_a_killed_manager_are_gone_for_clients_and_planning(
    cell: Cell, ros: Ros, layer: SkillLayerInterface
) -> None:
    ros.run("skiros2_task", "task_manager_node", name="tm")
    wait_until(lambda: "/tm/task_plan/status" in ros.master.topics(), what="the task manager")
    place = Element("skiros:Location", "place")
    cell.wmi.add_element(place)
    (robot,) = cell.wmi.resolve_elements(Element("cora:Robot"))
    goal = f"(skiros:at {robot.id} {place.id})"
    wait_until(lambda: ROBOT in layer.agents, what="the manager")
    assert plan(goal) == PLAN
    ros.kill_node(ROBOT)
    wait_until(lambda: layer.agents == {}, what="no manager any more")
    cell.has_buried()
    assert plan(goal) == FAILED
    cell.start_manager()
    wait_until(lambda: ROBOT in layer.agents, what="the manager again")
    assert plan(goal) == PLAN


@pytest.mark.long
def test_killed_manager_is_noticed_while_simulated_time_is_paused(ros: Ros, tmp_path: Path) -> None:
    ros.master.set_parameter("/use_sim_time", True)
    cell = Cell(ros, tmp_path)
    cell.start_manager()
    client = ros.program(sys.executable, "-u", "-c", FOLLOWER)
    client.wait_for_line(rf"came \[{ROBOT}\]")
    cell.moves_for_long()
    ros.kill_node(ROBOT)
    client.wait_for_line(r"went \[\]")
    cell.has_buried()


FOLLOWER = """
import rospy
from skiros2_skill.ros.skill_layer_interface import SkillLayerInterface
rospy.init_node("follower")
layer = SkillLayerInterface("follower")
for word in ("came", "went"):
    while not layer.has_changes:
        rospy.rostime.wallsleep(0.02)
    print(word, "[" + ", ".join(layer.agents) + "]")
rospy.spin()
"""


def plan(goal: str) -> int:
    """The code of the result."""
    ended = threading.Event()
    codes: list[int] = []

    def on_end(_: int, result: Any) -> None:
        codes.append(result.progress_code)
        ended.set()

    TaskManagerInterface().plan(goal, on_end)
    assert ended.wait(30.0)
    return codes[0]


# -- and comes back ----------------------------------------------------------------------------------------------------


def test_restarted_manager_is_registered_once_and_works(ros: Ros, tmp_path: Path) -> None:
    cell = Cell(ros, tmp_path)
    ros.launch(
        "skiros2", "skill_mgr.launch", robot_name=ROBOT[1:], deploy=True, env=cell.env, libraries_list="[arm_skills]",
        skill_list="[]", primitive_list="[move, visit]", robot_ontology_prefix="skiros", verbose=False,
    )  # fmt: skip
    cell.wait_for_manager()
    for _ in range(2):
        cell.moves_for_long()
        process = ros.master.node_pid(ROBOT)
        os.kill(process, signal.SIGKILL)
        wait_until(lambda: is_other_process(ros, process), what="another life of the manager")  # noqa: B023
        assert cell.works()


@pytest.mark.long
def test_clients_distinguish_a_restarted_manager(cell: Cell, ros: Ros, layer: SkillLayerInterface) -> None:
    wait_until(lambda: ROBOT in layer.agents, what="the manager")
    former = layer.agents[ROBOT]
    wait_until(lambda: former._monitor_sub.get_num_connections(), what="the connection to the manager")
    cell.moves_for_long()
    wait_until(lambda: former.tasks, what="the task")
    ros.kill_node(ROBOT)
    cell.start_manager()
    wait_until(lambda: layer.agents.get(ROBOT) not in (None, former), what="the other life")
    assert layer.agents[ROBOT].tasks == []
    assert "move" in layer.agents[ROBOT].skills


def is_other_process(ros: Ros, process: int) -> bool:
    try:
        return ros.master.node_pid(ROBOT) != process
    except OSError:  # not there yet
        return False


@pytest.mark.long
def test_quickly_restarted_manager_frees_its_locks(cell: Cell, ros: Ros) -> None:
    cell.moves_for_long()
    world_model = ros.master.node_pid("/wm")
    os.kill(world_model, signal.SIGSTOP)
    try:
        ros.kill_node(ROBOT)
        ros.run("skiros2_skill", "skill_manager_node", name=ROBOT[1:], params=PARAMS, env=cell.env)
        wait_until(lambda: is_there(ros), what="the new manager")
    finally:
        os.kill(world_model, signal.SIGCONT)
    cell.wait_for_manager()
    assert cell.works()


def is_there(ros: Ros) -> bool:
    try:
        return bool(ros.master.node_pid(ROBOT))
    except OSError:
        return False


# -- a world model that dies -------------------------------------------------------------------------------------------


@pytest.mark.long
def test_manager_that_dies_without_world_model_is_removed_later(cell: Cell, ros: Ros) -> None:
    cell.moves_for_long()
    ros.kill_node("/wm")
    ros.kill_node(ROBOT)
    cell.start_world_model()
    cell.has_buried()


def test_recovered_world_model_keeps_running_managers(cell: Cell, ros: Ros) -> None:
    cell.moves_for_long()
    ros.kill_node("/wm")
    cell.start_world_model()
    assert cell.lock() == ("Busy", ROBOT)
    cell.preempt_all()
    wait_until(lambda: cell.lock() == ("Idle", None), what="the end of the task")
    assert cell.works()
    assert cell.was_never_buried()
    ros.kill_node(ROBOT)
    cell.has_buried()


def test_blank_world_model_receives_the_last_wills_again(cell: Cell, ros: Ros) -> None:
    ros.master.set_parameter("/wm/journal_recover", "never")
    ros.kill_node("/wm")
    cell.start_world_model()
    cell.wmi.add_element(arm := Element("rparts:ArmDevice", "arm"))
    arm.setProperty(STATE, "Idle")
    cell.wmi.update_element(arm)
    cell.arm = arm
    assert cell.works()
    cell.moves_for_long()
    ros.kill_node(ROBOT)
    cell.has_buried()


@pytest.mark.long
def test_missed_release_of_a_lock_is_repeated(cell: Cell, ros: Ros) -> None:
    cell.moves_for_long()
    ros.kill_node("/wm")
    heard = ros.messages(f"{ROBOT}/monitor", msgs.TreeProgress)
    heard.wait_for()
    cell.preempt_all()
    heard.wait_for(lambda m: abs(m.progress[0].progress_code) == 1)
    cell.start_world_model()
    wait_until(lambda: cell.lock() == ("Idle", None), what="the release")
    assert cell.was_never_buried()
    assert cell.works()


# -- the service -------------------------------------------------------------------------------------------------------


def test_invalid_last_will_is_rejected(ros: Ros, tmp_path: Path) -> None:
    Cell(ros, tmp_path)
    leave: Callable[..., Any] = ros.service("/wm/last_will", srvs.WmLastWill)
    fitting = msgs.WmBequest(key=HOLDER, value="/me")
    for request, text in [
        ({"owner": "/me", "node_uri": "nowhere", "pid": 1, "bequests": [fitting]}, "expected http://HOST:PORT/"),
        ({"owner": "/me", "node_uri": "http://a:1/", "pid": 1, "bequests": [msgs.WmBequest()]}, "key and value"),
        ({"owner": "", "node_uri": "http://a:1/", "pid": 1, "bequests": [fitting]}, "expected an owner"),
    ]:
        with pytest.raises(rospy.ServiceException, match=text):
            leave(**request)
