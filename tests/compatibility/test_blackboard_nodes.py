"""A pick-and-place library on a skill manager. Compatibility, section 2."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from compatibility.rules import rule
from skiros2_common.core.world_element import Element
from skiros2_msgs import msg as msgs
from skiros2_msgs import srv as srvs
from skiros2_skill.ros.skill_manager_interface import SkillManagerInterface
from skiros2_world_model.ros.world_model_interface import WorldModelInterface
from support.ros import Ros

pytestmark = pytest.mark.timeout(120)

ROBOT = "/test_robot"
LIBRARIES = Path(__file__).parents[1] / "libraries"
PRIMITIVES = "[drive_fake, wm_move_object, scan_fake, sort_fake, detect_fake, weigh_fake, watch_fake]"
COMPOUNDS = "[pick_fake, place_fake, fetch_fake, take_stock_fake]"


class Cell:
    """A manager with the library, and a scene with a bolt on a shelf, a table, and a dock with the robot."""

    def __init__(self, ros: Ros) -> None:
        env = {**ros.master.env, "PYTHONPATH": f"{LIBRARIES}:{ros.master.env['PYTHONPATH']}"}
        ros.launch("skiros2", "world_model_server.launch", gui=False)
        ros.launch(
            "skiros2", "skill_mgr.launch", libraries_list="[skiros2_std_skills, pick_place_skills]",
            primitive_list=PRIMITIVES, skill_list=COMPOUNDS, env=env,
        )  # fmt: skip
        ros.service(f"{ROBOT}/command", srvs.SkillCommand)
        self.wmi = WorldModelInterface("tests")
        self.client = SkillManagerInterface(ROBOT, "tests")
        self.progress = ros.messages(f"{ROBOT}/monitor", msgs.TreeProgress)
        (robot,) = self.wmi.resolve_elements(Element("cora:Robot"))
        self.shelf, self.table, dock = (self._add("skiros:Location", name) for name in ("shelf", "table", "dock"))
        self.bolt = self._add("skiros:Product", "bolt", self.shelf.id)
        arm = self._add("rparts:ArmDevice", "arm", robot.id, "skiros:hasA")
        self.gripper = self._add("rparts:GripperEffector", "gripper", arm.id, "skiros:hasA", ContainerState="Empty")
        self.wmi.set_relation(robot.id, "skiros:at", dock.id, True)

    def _add(
        self, etype: str, label: str, over: str = "skiros:Scene-0", relation: str = "skiros:contain", **more: Any
    ) -> Element:
        element = Element(etype, label)
        for key, value in more.items():
            element.setProperty(f"skiros:{key}", value)
        element.addRelation(over, relation, "-1")
        self.wmi.add_element(element)
        return element

    def run(self, name: str, **params: Any) -> Any:
        """The root's last progress of a task of one skill."""
        skill = self.client.get_skill(name)
        for key, value in params.items():
            skill.ph.specify(key, value)
        task = self.client.execute(skill_list=[skill])
        assert task >= 0, self.client.last_error
        end = self.progress.wait_for(lambda m: m.progress[0].task_id == task and abs(m.progress[0].progress_code) == 1)
        return end.progress[0]


@pytest.fixture
def cell(ros: Ros) -> Iterator[Cell]:
    cell = Cell(ros)
    yield cell
    cell.client.shutdown()


@rule("blackboard", "Pick and place on a robot: a child that moves the object unsets the gripper, its start")
def test_pick_and_place_on_a_manager(cell: Cell) -> None:
    end = cell.run("fetch_fake", Object=cell.bolt, To=cell.table)
    assert end.state == msgs.SkillProgress.SUCCESS, end.progress_message
    assert cell.wmi.get_relations(cell.table.id, "skiros:contain", cell.bolt.id)
    assert cell.wmi.get_element(cell.gripper.id).getProperty("skiros:ContainerState").value == "Empty"


@rule("blackboard", "On a robot: producers append, consumers pop, and an element that was added reaches its sibling")
def test_values_are_handed_on_on_a_manager(cell: Cell) -> None:
    end = cell.run("take_stock_fake", Container=cell.table)
    assert end.state == msgs.SkillProgress.SUCCESS, end.progress_message
    (found,) = cell.wmi.resolve_elements(Element("skiros:Product", "detected"))
    assert found.getProperty("skiros:Weight").value == 0.5


@rule("blackboard", "An element that is removed while a skill of a robot runs is dropped from its parameter",
      differs="the skill fails in one line with the element's id, who removed it and when")  # fmt: skip
def test_failure_names_the_author_of_a_removal(cell: Cell) -> None:
    skill = cell.client.get_skill("watch_fake")
    skill.ph.specify("Object", cell.bolt)
    bolt = cell.bolt.id
    task = cell.client.execute(skill_list=[skill])
    cell.progress.wait_for(lambda m: m.progress[0].task_id == task and any(p.progress_code > 0 for p in m.progress))
    WorldModelInterface("somebody").remove_element(bolt)
    end = cell.progress.wait_for(lambda m: m.progress[0].task_id == task and abs(m.progress[0].progress_code) == 1)
    text = end.progress[0].progress_message
    assert f"element {bolt} was removed by " in text and "\n" not in text, text
