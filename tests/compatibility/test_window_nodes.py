"""A window written for SkiROS2, with the running system."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest

from compatibility.rules import rule
from skiros2_common.core.params import ParamTypes
from skiros2_common.core.world_element import Element
from skiros2_skill.ros.skill_layer_interface import SkillLayerInterface
from skiros2_world_model.ros.world_model_interface import WorldModelInterface
from support.ros import Ros, RosMaster, wait_until

pytestmark = pytest.mark.timeout(90)


class OtherWindow:
    """What a window of somebody else holds: trees of skills and elements, kept up to date by callbacks."""

    def __init__(self) -> None:
        self.wmi = WorldModelInterface("other_window")
        self.layer = SkillLayerInterface("other_window")
        self.states: list[tuple[int, int]] = []
        self.shown: dict[str, Element] = {}
        self.snapshot_id = ""
        self.wmi.set_monitor_cb(self._on_world)
        self.layer.set_monitor_cb(self._on_progress)

    def refresh(self) -> None:
        scene, self.snapshot_id = self.wmi.get_scene()
        self.shown = {element.id: element for element in scene}

    def _on_world(self, message: Any) -> None:
        if message.prev_snapshot_id != self.snapshot_id:
            self.refresh()
            return
        for told in message.elements:
            if message.action.startswith("remove"):
                self.shown.pop(told.id, None)
            else:
                self.shown[told.id] = self.wmi.get_element(told.id)
        self.snapshot_id = message.snapshot_id

    def _on_progress(self, message: Any) -> None:
        self.states += [(node.task_id, node.state) for node in message.progress]

    def combo_boxes(self, skill: Any) -> dict[str, list[str]]:
        """What may be chosen for each parameter that takes an element, by label."""
        return {
            key: [e.label for e in self.wmi.resolve_elements(param.default)]
            for key, param in skill.ph._params.items()
            if param.dataTypeIs(Element) and param.paramType != ParamTypes.Optional
        }


@pytest.fixture(scope="module")
def window(ros_master: RosMaster) -> Iterator[OtherWindow]:
    ros = Ros(ros_master)
    try:
        ros.launch("skiros2_demo_skills", "demo.launch", gui=False)
        wait_until(lambda: "/mobile_manipulator/get_skills" in ros_master.services(), 60, "the robot's skills")
        window = OtherWindow()
        wait_until(lambda: window.layer.agents, what="the robot")
        yield window
        window.layer.shutdown()
    finally:
        ros.stop()


@rule(
    "client",
    "A window of others follows the scene: `get_scene()`, `set_monitor_cb`, `prev_snapshot_id`, `remove_element`",
)
def test_other_window_follows_the_scene(window: OtherWindow) -> None:
    window.refresh()
    assert "skiros:Scene-0" in window.shown
    box = Element("skiros:Product", "seen")
    box.setRelation("skiros:Scene-0", "skiros:contain", "-1")
    eid = window.wmi.add_element(box).id
    wait_until(lambda: eid in window.shown, what="the new element")
    assert window.wmi.remove_element(eid) == 1
    wait_until(lambda: eid not in window.shown, what="the element being gone")


@rule(
    "client",
    "A window of others fills its lists from `_skill_list` and `ph._params`, and from `resolve_elements(default)`",
)
def test_foreign_window_lists_skills_and_choices(window: OtherWindow) -> None:
    agent = window.layer.get_agent("/mobile_manipulator")
    skills = agent._skill_list
    assert {"drive", "pick", "place", "wait"} <= set(skills)
    choices = window.combo_boxes(skills["pick"])
    assert {"Product A", "Product B", "Product C"} <= set(choices["Object"])


@rule(
    "client",
    "A window of others starts, pauses and stops: `execute`, `pause_one`, `preempt_one`, `preempt_all`, `tasks`",
)
def test_other_window_starts_pauses_and_stops_a_task(window: OtherWindow) -> None:
    agent = window.layer.get_agent("/mobile_manipulator")
    assert agent.preempt_one() is False
    wait = agent.get_skill("wait")
    wait.ph["Duration"].value = 60.0
    task = agent.execute(skill_list=[wait])
    assert agent.tasks == [task]
    assert agent.task == task
    wait_until(lambda: (task, 3) in window.states, what="the running task")
    assert agent.pause_one(task) is True
    assert agent.preempt_all() is True
    wait_until(lambda: (task, 2) in window.states, what="the end of the task")
    wait_until(lambda: agent.tasks == [], what="no task")
