"""An unchanged project: ontology, scene, launch file, skills and clients."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import actionlib
import pytest
import rospy
from actionlib import msg as actions
from std_msgs.msg import Empty, String

from compatibility.rules import rule
from skiros2_common.core.params import ParamTypes
from skiros2_common.core.world_element import Element
from skiros2_msgs import msg as msgs
from skiros2_msgs import srv as srvs
from skiros2_skill.ros.skill_layer_interface import SkillLayerInterface
from skiros2_skill.ros.skill_manager_interface import SkillManagerInterface
from skiros2_skill.ros.utils import deserialize_skill
from skiros2_world_model.ros.world_model_interface import WorldModelInterface
from support.ros import Messages, Ros, RosMaster, wait_until

pytestmark = pytest.mark.timeout(120)

LIBRARIES = Path(__file__).parents[1] / "libraries"


class Cell:
    """The running project, and what its operator's programs use."""

    def __init__(self, ros: Ros) -> None:
        env = {**ros.master.env, "PYTHONPATH": f"{LIBRARIES}:{ros.master.env['PYTHONPATH']}"}
        self.ros = ros
        self.driven: list[int] = []
        self._server = actionlib.SimpleActionServer("/drive", actions.TestAction, self._drive, auto_start=False)
        self._server.start()
        self.program = ros.launch_file(LIBRARIES / "assembly_cell/launch/assembly.launch", env=env)
        ros.service("/worker/get_skills", srvs.ResourceGetDescriptions, timeout=60)
        self.wmi = WorldModelInterface("operator")
        self.robots = SkillLayerInterface("operator")
        wait_until(lambda: "/worker" in self.robots.agents, what="the robot /worker")
        self.manager: SkillManagerInterface = self.robots.get_agent("/worker")
        self.progress: Messages = ros.messages("/worker/monitor", msgs.TreeProgress)
        self.put_robot("dock")

    def _drive(self, goal: Any) -> None:
        self.driven.append(goal.goal)
        self._server.set_succeeded(actions.TestResult(goal.goal))

    def put_robot(self, place: str) -> None:
        robot = self.wmi.resolve_element(Element("cora:Robot", "assembly:worker"))
        robot.setRelation("-1", "skiros:at", self.find(place).id)
        self.wmi.update_element(robot)

    def find(self, label: str) -> Element:
        return self.wmi.resolve_element(Element("", label))

    def plan(self, goal: str) -> Any:
        client = actionlib.SimpleActionClient("/tm/task_plan", msgs.AssignTaskAction)
        assert client.wait_for_server(rospy.Duration(30))
        client.send_goal(msgs.AssignTaskGoal(author="worker", goals=goal))
        assert client.wait_for_result(rospy.Duration(60))
        return client.get_result()

    def run(self, *skills: Any) -> Any:
        """Starts skills as one task, and waits for its root's last progress."""
        task = self.manager.execute(skill_list=list(skills))
        assert task is not None and task >= 0
        return self.end_of(task)

    def end_of(self, task: int) -> Any:
        end = self.progress.wait_for(lambda m: m.progress[0].task_id == task and abs(m.progress[0].progress_code) == 1)
        return end.progress[0]


@pytest.fixture(scope="module")
def cell(ros_master: RosMaster) -> Iterator[Cell]:
    ros = Ros(ros_master)
    try:
        cell = Cell(ros)
        yield cell
    finally:
        ros.stop()


@rule("robustness", "A scene with a doubled value, a relation to nothing and an undeclared property loads")
def test_scene_of_the_project_loads_unchanged(cell: Cell) -> None:
    assert {e.label for e in cell.wmi.resolve_elements(Element("skiros:Location"))} >= {
        "left_rack",
        "right_rack",
        "dock",
    }
    assert cell.find("right_rack").getProperty("skiros:Colour").value == "red"


@rule("loading", "A project's library loads as it is: wildcard imports, `modifyDescription`, narrower classes")
def test_the_projects_skills_are_listed_with_their_parameters(cell: Cell) -> None:
    skills = cell.manager.get_skill_list(update=True)
    assert {"grasp_simple", "put_simple", "inspect", "move_base_fake", "arm_move", "wait"} <= set(skills)
    params = skills["move_base_fake"].ph.getParamMap()
    assert params["StartLocation"].paramTypeIs(ParamTypes.Inferred)
    assert params["Times"].value == 1


@rule("wire", "A client plans with `tm/task_plan`, reads the plan as JSON, starts its steps and reads the results")
def test_a_goal_is_planned_read_and_executed_by_a_client(cell: Cell) -> None:
    valve, rack = cell.find("the_valve"), cell.find("right_rack")
    result = cell.plan(f"(skiros:contain {rack.id} {valve.id})")
    assert result.progress_code == 3, result.progress_message
    plan = json.loads(result.progress_message)
    steps = [(step["type"], step["manager"]) for step in plan["children"]]
    assert [kind.split(":")[-1] for kind, _ in steps] == ["MoveBase", "Grasp", "MoveBase", "Put"]
    assert {manager for _, manager in steps} == {"/worker"}
    assert plan["children"][1]["ph"]["Object"]["values"][0]["id"] == valve.id

    task = deserialize_skill(result.progress_message)
    end = cell.run(*task.children)
    assert end.state == msgs.SkillProgress.SUCCESS, end.progress_message
    assert cell.wmi.get_relations(rack.id, "skiros:contain", valve.id)
    assert cell.wmi.get_element(cell.find("left_rack").id).getProperty("skiros:ContainerState").value == "Empty"
    gripper = cell.wmi.resolve_element(Element("rparts:GripperEffector"))
    assert gripper.getProperty("skiros:ContainerState").value == "Empty"
    assert cell.driven == [cell.find("left_rack").getIdNumber(), rack.getIdNumber()]


@rule("blackboard", "An element added in a skill, and a list filled in place, reach its siblings")
def test_found_elements_reach_siblings(cell: Cell) -> None:
    inspect = cell.manager.get_skill("inspect")
    inspect.ph.specify("Container", cell.find("dock"))
    end = cell.run(inspect)
    assert end.state == msgs.SkillProgress.SUCCESS, end.progress_message
    assert cell.find("found").getData(":Position") == [0.1, 0.0, 0.3]


@rule("client", "`preempt_one` and `tasks` stop a running task; its root ends with state 2 and code -1")
def test_a_running_task_is_stopped_by_a_client(cell: Cell) -> None:
    wait = cell.manager.get_skill("wait")
    wait.ph.specify("Duration", 100.0)
    task = cell.manager.execute(skill_list=[wait])
    assert cell.manager.tasks == [task]
    assert cell.manager.preempt_one(task) is True
    end = cell.end_of(task)
    assert (end.state, end.progress_code) == (msgs.SkillProgress.FAILURE, -1)


@rule(
    "robots", "Agents are announced on `/skill_managers/description` when a client asks on `/skill_managers/discovery`"
)
def test_agents_answer_discovery(cell: Cell) -> None:
    heard = cell.ros.messages("/skill_managers/description", String)
    ask = rospy.Publisher("/skill_managers/discovery", Empty, queue_size=1, latch=True)
    ask.publish(Empty())
    assert heard.wait_for(lambda m: m.data == "/worker")
