"""One goal for several elements, reached by one skill for each: planned by the task manager, executed on nodes."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from compatibility.rules import rule
from skiros2_common.core.world_element import Element
from skiros2_msgs import msg as msgs
from skiros2_msgs import srv as srvs
from skiros2_skill.ros.skill_manager_interface import SkillManagerInterface
from skiros2_task.ros.task_manager_interface import TaskManagerInterface
from skiros2_world_model.ros.world_model_interface import WorldModelInterface
from support.ros import Messages, Ros, RosMaster, SharedSystem, wait_until

pytestmark = pytest.mark.timeout(240)

LIBRARIES = Path(__file__).parents[1] / "libraries"
ROBOT = "/test_robot"


def launch(ros: Ros, *skills: str) -> None:
    env = {**ros.master.env, "PYTHONPATH": f"{LIBRARIES}:{ros.master.env['PYTHONPATH']}"}
    ros.launch(
        "skiros2", "skiros.launch", env=env, gui=False, journal=False,
        libraries_list=["skiros2_std_skills", "site_skills"], skill_list=["task_plan", *skills],
        primitive_list=["go_to", "paint_wall", "pull_handle", "wm_set_properties"],
    )  # fmt: skip
    ros.service(f"{ROBOT}/command", srvs.SkillCommand)
    ros.wait_for_node("/tm")


class Site:
    """Three places, each with a wall and a door; the robot is at the first."""

    def __init__(self, ros: Ros) -> None:
        self.wmi = WorldModelInterface("tests")
        self.places = [self._add("skiros:Location", f"place_{i}") for i in range(3)]
        self.walls = [self._add("skiros:Product", f"wall_{i}", p, Painted=False, Coats=0) for i, p in self._numbered()]
        self.doors = [self._add("skiros:Product", f"door_{i}", p, Open=False) for i, p in self._numbered()]
        robot = self.wmi.resolve_element(Element("cora:Robot"))
        robot.setRelation("-1", "skiros:at", self.places[0])
        self.wmi.update_element(robot)
        self.tasks = TaskManagerInterface()
        self.progress: Messages = ros.messages(f"{ROBOT}/monitor", msgs.TreeProgress).connected()

    def _numbered(self) -> list[tuple[int, str]]:
        return list(enumerate(self.places))

    def _add(self, cls: str, label: str, inside: str = "skiros:Scene-0", **properties: Any) -> str:
        element = Element(cls, label)
        for key, value in properties.items():
            element.setProperty(f"skiros:{key}", value)
        element.addRelation(inside, "skiros:contain", "-1")
        return str(self.wmi.add_element(element).id)

    def value(self, element: str, key: str) -> Any:
        return self.wmi.get_element(element).getProperty(f"skiros:{key}").value

    def achieve(self, goal: str) -> Any:
        self.tasks.achieve(goal)
        return self.tasks.wait_for_result()

    def run_plan(self, goal: str) -> list[str]:
        """Runs the standard skill `task_plan`; returns the labels of the plan's steps."""
        manager = SkillManagerInterface(ROBOT, "tests")
        try:
            skill = manager.get_skill("task_plan")
            skill.ph.specify("Goal", goal)
            task = manager.execute(skill_list=[skill])
            end = self.progress.wait_for(
                lambda m: m.progress[0].task_id == task and abs(m.progress[0].progress_code) == 1, 60.0
            ).progress
        finally:
            manager.shutdown()
        assert end[0].state == msgs.SkillProgress.SUCCESS, [(n.label, n.progress_message) for n in end]
        above = next(node for node in end if node.label == "task_plan")
        return [node.label for node in end if node.parent_id == above.id]


@pytest.fixture(scope="module")
def shared(ros_master: RosMaster) -> Iterator[SharedSystem]:
    with SharedSystem(ros_master, lambda ros: launch(ros, "open_door")) as system:
        yield system


@pytest.fixture
def site(ros: Ros, shared: SharedSystem) -> Iterator[Site]:
    shared.use()
    yield Site(ros)
    shared.restore()


@rule("wire", "A goal for several elements is planned with one skill for each, and executed whole")
@pytest.mark.parametrize("way", ["task_plan", "achieve"])
@pytest.mark.parametrize("kind", ["paint_wall", "open_door"])
def test_each_element_of_a_goal_is_changed(site: Site, way: str, kind: str) -> None:
    painting = kind == "paint_wall"
    elements, key, count = (site.walls, "Painted", "Coats") if painting else (site.doors, "Open", "Pulls")
    goal = ", ".join(f"(skiros:{key} {element})" for element in elements)
    if way == "task_plan":
        steps = site.run_plan(goal)
    else:
        result = site.achieve(goal)
        assert result.state == result.SUCCEEDED, result.message
        steps = [step["label"] for step in json.loads(result.done)]
    assert sorted(steps) == sorted([kind] * 3 + ["go_to"] * 2)
    wait_until(lambda: all(site.value(element, key) for element in elements), what="the changes")
    assert [site.value(element, count) for element in elements] == [1] * 3
    others, other_key = (site.doors, "Open") if painting else (site.walls, "Painted")
    assert not any(site.value(element, other_key) for element in others)


@pytest.mark.long
@rule(
    "wire", "A plan with a compound whose children change what its description does not declare fails",
    better="the message names the step, the fact and the time",
)  # fmt: skip
def test_failure_names_a_step_with_undeclared_changes(ros: Ros, shared: SharedSystem) -> None:
    shared.stop()
    launch(ros, "open_door_in_a_draught")
    site = Site(ros)
    result = site.achieve(", ".join(f"(skiros:Open {door})" for door in site.doors))
    assert result.state != result.SUCCEEDED
    assert "false at" in result.message
    assert "the description of skiros:OpenDoor does not declare it" in result.message
