"""Plans of third-party skills: requested, read and run by programs written for SkiROS2."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import actionlib
import pytest

from compatibility.rules import rule
from skiros2_common.core.params import Param, ParamTypes
from skiros2_common.core.world_element import Element
from skiros2_common.ros import utils
from skiros2_msgs import msg as msgs
from skiros2_msgs import srv as srvs
from skiros2_skill.ros.skill_manager_interface import SkillManagerInterface
from skiros2_skill.ros.utils import deserialize_skill
from skiros2_task.ros.task_manager_interface import TaskManagerInterface
from skiros2_world_model.ros.world_model_interface import WorldModelInterface
from support.planning_world import DRIVE, PlanningWorld
from support.ros import Ros, RosMaster, SharedSystem, wait_until

pytestmark = pytest.mark.timeout(120)

LIBRARIES = Path(__file__).parents[1] / "libraries"
ROBOT = "/carrier"
BIN, TABLE, STATION = "plant:Bin-5", "skiros:Location-6", "skiros:Location-7"
WAIT = 30.0  # s


class Plant:
    """A robot with a third-party library in a third-party scene."""

    @staticmethod
    def launch(ros: Ros) -> None:
        env = {**ros.master.env, "PYTHONPATH": f"{LIBRARIES}:{ros.master.env['PYTHONPATH']}"}
        ros.launch(
            "skiros2", "skiros.launch", env=env, gui=False, robot_name="carrier", robot_ontology_prefix="plant",
            workspace_dir=str(LIBRARIES / "plant_skills" / "owl"), init_scene="plant_scene.turtle", journal=False,
            libraries_list=["skiros2_std_skills", "plant_skills"], skill_list=["task_plan"],
            primitive_list=["drive_fake", "locate_fake", "pick_fake", "place_fake", "wait"],
        )  # fmt: skip
        ros.service(f"{ROBOT}/command", srvs.SkillCommand)

    def __init__(self, ros: Ros) -> None:
        self.command = ros.service(f"{ROBOT}/command", srvs.SkillCommand)
        self.listed = {s.name: s for s in ros.service(f"{ROBOT}/get_skills", srvs.ResourceGetDescriptions)().list}
        self.progress = ros.messages(f"{ROBOT}/monitor", msgs.TreeProgress).connected()
        self.wmi = WorldModelInterface("tests")
        self.client = actionlib.SimpleActionClient("tm/task_plan", msgs.AssignTaskAction)
        assert self.client.wait_for_server(_seconds(WAIT))

    def plan(self, goals: str, author: str = "tests") -> Any:
        """The plan for a goal, as a client reads it."""
        self.client.send_goal(msgs.AssignTaskGoal(author=author, goals=goals))
        assert self.client.wait_for_result(_seconds(WAIT))
        result = self.client.get_result()
        assert result.progress_code == 3, result.progress_message
        return json.loads(result.progress_message)

    def run(self, skills: list[Any]) -> list[Any]:
        """Starts skills; the progress of their task when it has ended."""
        answer = self.command(author="tests", action="start", execution_id=-1, skills=skills)
        assert answer.ok
        task = answer.execution_id
        return list(
            self.progress.wait_for(
                lambda m: m.progress[0].task_id == task and abs(m.progress[0].progress_code) == 1, 40.0
            ).progress
        )


def _seconds(seconds: float) -> Any:
    import rospy

    return rospy.Duration.from_sec(seconds)


@pytest.fixture(scope="module")
def shared(ros_master: RosMaster) -> Iterator[SharedSystem]:
    with SharedSystem(ros_master, Plant.launch) as system:
        yield system


@pytest.fixture
def plant(ros: Ros, shared: SharedSystem) -> Iterator[Plant]:
    shared.use()
    yield Plant(ros)
    shared.restore()


def labels(plan: Any) -> list[str]:
    return [child["name"] for child in plan["children"]]


GEAR_TO_TABLE = f"(skiros:contain {TABLE} plant:gear)"
STEPS = ["drive_fake", "locate_fake", "pick_fake", "drive_fake", "place_fake"]


@rule("wire", "A plan is one JSON text; `ph` is an object with **all** parameters of the skill, by key")
def test_a_plan_has_all_parameters_of_each_skill(plant: Plant) -> None:
    plan = plant.plan(GEAR_TO_TABLE)
    assert {key: plan[key] for key in ("manager", "type", "name", "ph")} == {
        "manager": "", "type": "Processor", "name": "Sequential", "ph": {},
    }  # fmt: skip
    assert labels(plan) == STEPS
    for child in plan["children"]:
        assert set(child) == {"manager", "type", "name", "ph", "children"}
        assert (child["manager"], child["children"]) == (ROBOT, [])
        listed = plant.listed[child["name"]]
        assert child["type"] == listed.type
        described = [json.loads(param.param) for param in listed.params]
        assert sorted(child["ph"]) == sorted(param["key"] for param in described)
        for expected in described:
            param = child["ph"][expected["key"]]
            assert set(param) == {"key", "description", "specType", "type", "values"}
            for part in ("key", "description", "specType", "type"):
                assert param[part] == expected[part]
    pick = plan["children"][2]["ph"]
    assert (pick["Object"]["specType"], pick["Force"]["specType"], pick["Arm"]["specType"]) == (0, 1, 2)
    assert (pick["Object"]["description"], pick["Force"]["values"]) == ("What to pick", [20.0])


@rule("wire", "A planned value is the whole element as it is in the scene; one that is still to be found has id `\"\"` "
      "and its template's name as label")  # fmt: skip
def test_a_planned_value_is_a_whole_element(plant: Plant) -> None:
    drive, locate, pick, _, place = plant.plan(GEAR_TO_TABLE)["children"]
    (container,) = locate["ph"]["Container"]["values"]
    assert (locate["ph"]["Container"]["type"], container["id"]) == ("skiros_wm::Element", BIN)
    assert (container["label"], container["type"]) == ("start_box", "plant:Bin")
    assert container["properties"]["skiros:Template"]["values"] == ["plant:gear_bin"]
    assert container["properties"]["skiros:Template"]["type"] == "str"
    (robot,) = pick["ph"]["Robot"]["values"]
    at = [r for r in robot["relations"] if r["type"] == "skiros:at"]
    assert at == [{"src": "-1", "type": "skiros:at", "dst": STATION, "state": True, "abstract": False}]
    for step in (locate, pick, place):
        (gear,) = step["ph"]["Object"]["values"]
        assert (gear["id"], gear["label"], gear["type"]) == ("", "plant:gear", "plant:Gear")
    assert drive["ph"]["StartLocation"]["values"][0]["id"] == STATION


@rule("wire", "`deserialize_skill` of a plan gives its skills with their parameters; a program starts them")
def test_a_plan_is_read_and_each_of_its_skills_started(plant: Plant) -> None:
    """A client in the idioms of the field: it walks the children, and builds commands from ids and labels."""
    plan = plant.plan(f"(skiros:at cora:Robot-1 {TABLE})")
    for child in plan["children"]:
        params = {}
        for key in child["ph"]:
            for value in child["ph"][key]["values"]:
                if child["ph"][key]["type"] == "skiros_wm::Element" and value["id"]:
                    element = plant.wmi.get_element(value["id"])
                    params[key] = Param(key, "", element, ParamTypes.Required)
        skill = msgs.ResourceDescription(child["type"], child["name"], utils.serializeParamMap(params))
        end = plant.run([skill])
        assert end[0].state == msgs.SkillProgress.SUCCESS, end[0].progress_message
    assert plant.wmi.get_relations("cora:Robot-1", "skiros:at", TABLE)

    back = deserialize_skill(json.dumps(plant.plan(f"(skiros:at cora:Robot-1 {STATION})")))
    assert [child.ph.getParamValue("TargetLocation").id for child in back.children] == [STATION]
    end = plant.run([child.toMsg() for child in back.children])
    assert end[0].state == msgs.SkillProgress.SUCCESS, end[0].progress_message
    assert plant.wmi.get_relations("cora:Robot-1", "skiros:at", STATION)


@rule("wire", "`task_plan` takes a plan's skills as its children, with the planned values, and runs them")
def test_a_goal_that_names_a_template_is_planned_and_executed(plant: Plant) -> None:
    goal = {"Goal": Param("Goal", "", GEAR_TO_TABLE, ParamTypes.Required)}
    end = plant.run([msgs.ResourceDescription("skiros:TaskPlan", "task_plan", utils.serializeParamMap(goal))])
    assert end[0].state == msgs.SkillProgress.SUCCESS, [(n.label, n.progress_message) for n in end]
    above = next(node for node in end if node.label == "task_plan")
    assert [node.label for node in end if node.parent_id == above.id] == STEPS
    (gear,) = plant.wmi.resolve_elements(Element("plant:Gear"))
    assert plant.wmi.get_relations(TABLE, "skiros:contain", gear.id)


@rule("wire", "Skills in older idioms (conditions after `setDescription`, narrower classes, `Or`) are planned and run")
def test_a_library_in_older_idioms_is_planned_and_executed(ros: Ros, shared: SharedSystem) -> None:
    shared.stop()
    env = {**ros.master.env, "PYTHONPATH": f"{LIBRARIES}:{ros.master.env['PYTHONPATH']}"}
    ros.launch(
        "skiros2", "skiros.launch", env=env, gui=False, journal=False,
        libraries_list=["skiros2_std_skills", "foreign_cell_skills"],
        skill_list=["go_around", "grab_light", "bring", "task_plan"],
        primitive_list=["approach_fake", "go_fake", "grab_fake", "drop_fake", "look_fake", "scrap_fake", "check_value",
                        "wait", "wm_move_object"],
    )  # fmt: skip
    ros.service("/test_robot/command", srvs.SkillCommand)
    ros.wait_for_node("/tm")
    wmi = WorldModelInterface("tests")
    shelf, table, dock = (Element("skiros:Location", name) for name in ("shelf", "table", "dock"))
    for place in (shelf, table, dock):
        place.addRelation("skiros:Scene-0", "skiros:contain", "-1")
        wmi.add_element(place)
    bolt = Element("skiros:Product", "bolt")
    bolt.addRelation(shelf.id, "skiros:contain", "-1")
    wmi.add_element(bolt)
    robot = wmi.resolve_element(Element("cora:Robot"))
    robot.setRelation("-1", "skiros:at", dock.id)
    wmi.update_element(robot)
    for kind, key, value in (
        ("rparts:ArmDevice", "skiros:StateProperty", "Idle"),
        ("rparts:GripperEffector", "skiros:ContainerState", "Empty"),
    ):
        device = wmi.resolve_element(Element(kind))
        device.setProperty(key, value)
        wmi.update_element_properties(device)
    manager = SkillManagerInterface("/test_robot", "tests")
    progress = ros.messages("/test_robot/monitor", msgs.TreeProgress)
    try:
        task_plan = manager.get_skill("task_plan")
        task_plan.ph.specify("Goal", f"(skiros:contain {table.id} {bolt.id})")
        task = manager.execute(skill_list=[task_plan])
        assert task >= 0, manager.last_error
        end = progress.wait_for(lambda m: m.progress[0].task_id == task and abs(m.progress[0].progress_code) == 1, 40.0)
    finally:
        manager.shutdown()
    nodes = [(n.label, n.progress_message) for n in end.progress]
    assert end.progress[0].state == msgs.SkillProgress.SUCCESS, nodes
    assert [n.label for n in end.progress if n.label in ("go_fake", "grab_fake", "drop_fake")] == [
        "go_fake", "grab_fake", "go_fake", "drop_fake",
    ]  # fmt: skip
    assert wmi.get_relations(table.id, "skiros:contain", bolt.id)


@rule(
    "robots", "A plan has steps for each robot in the scene whose `skiros:SkillMgr` is the name of a manager",
    differs="only for the robot that a running manager has registered",
)  # fmt: skip
def test_a_robot_that_no_manager_has_registered_takes_no_steps(plant: Plant) -> None:
    stale = PlanningWorld(plant.wmi).robot("carrier", DRIVE, at=STATION)
    plant.client.send_goal(msgs.AssignTaskGoal(author="tests", goals=f"(skiros:at {stale} {TABLE})"))
    assert plant.client.wait_for_result(_seconds(WAIT))
    assert plant.client.get_result().progress_code == 1
    assert [child["manager"] for child in plant.plan(f"(skiros:at cora:Robot-1 {TABLE})")["children"]] == [ROBOT]


@rule("robots", "The author of a goal is a manager's name with slash or without")
def test_the_author_of_a_goal_has_a_slash_or_not(plant: Plant) -> None:
    for author in ("carrier", "/carrier"):
        plan = plant.plan(f"(skiros:at cora:Robot-1 {TABLE})", author)
        assert [child["manager"] for child in plan["children"]] == [ROBOT]


@rule("client", "`TaskManagerInterface.plan()` returns True; without a task manager False, and the error is logged")
def test_plan_returns_whether_the_goal_was_sent(
    ros: Ros, shared: SharedSystem, caplog: pytest.LogCaptureFixture
) -> None:
    shared.stop()
    tasks = TaskManagerInterface()
    assert tasks.plan("(skiros:at a b)") is False
    assert "no task manager answers on /tm/task_plan" in caplog.text
    ros.run("skiros2_world_model", "world_model_server_node", name="wm")
    ros.run("skiros2_task", "task_manager_node", name="tm")
    wait_until(lambda: tasks.plan("(skiros:at nobody nowhere)") is True, WAIT, "the task manager")
    assert tasks.wait_for_result().progress_code == 1
