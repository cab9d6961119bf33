"""Planning as a skill: plans, runs the plan as its children, and does not block other tasks."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from skiros2_common.core.params import Param, ParamTypes
from skiros2_common.ros.utils import serializeParamMap
from skiros2_msgs.msg import ResourceDescription, SkillProgress, TreeProgress, WmElement
from skiros2_msgs.srv import ResourceGetDescriptions, SkillCommand, WmGet
from support.ros import INSTALL, Messages, Ros

ROBOT = "/mobile_manipulator"
TRAY_A, TRAY_B, PRODUCT_A = "demo:Tray-10", "demo:Tray-12", "skiros:Product-14"


class Manager:
    """The demo's skill manager, as a client sees it."""

    def __init__(self, ros: Ros) -> None:
        self._ros = ros
        self.progress: Messages = ros.messages(f"{ROBOT}/monitor", TreeProgress)
        self._command = ros.service(f"{ROBOT}/command", SkillCommand)
        ros.service(f"{ROBOT}/get_skills", ResourceGetDescriptions)()

    def start(self, stype: str, label: str, **params: Any) -> int:
        given = {key: Param(key, "", value, ParamTypes.Required) for key, value in params.items()}
        skill = ResourceDescription(stype, label, serializeParamMap(given))
        return int(self._command(author="test", action="start", execution_id=-1, skills=[skill]).execution_id)

    def preempt(self, task: int) -> None:
        self._command(author="test", action="preempt", execution_id=task)

    def wait_for(self, task: int, condition: Callable[[list[Any]], Any]) -> list[Any]:
        """The nodes of a task as soon as the condition is true of them."""
        found = self.progress.wait_for(lambda m: m.progress[0].task_id == task and condition(m.progress), 40.0)
        return list(found.progress)

    def end(self, task: int) -> list[Any]:
        return self.wait_for(task, lambda nodes: abs(nodes[0].progress_code) == 1)


def holder(ros: Ros, element: str) -> str:
    (found,) = ros.service("/wm/get", WmGet)(action="get", element=WmElement(id=element), context="scene").elements
    (relation,) = (r for r in found.relations if r.predicate == "skiros:contain" and r.objectId == "-1")
    return str(relation.subjectId)


@pytest.mark.long
def test_task_plan_runs_the_planned_skills(ros: Ros) -> None:
    ros.launch("skiros2_demo_skills", "demo.launch", gui=False)
    manager = Manager(ros)

    def planned(goal: str) -> list[Any]:
        return manager.end(manager.start("skiros:TaskPlan", "task_plan", Goal=goal))

    for impossible in (f"(skiros:contain {TRAY_B} demo:Workstation-6)", f"(skiros:contain {TRAY_B} {PRODUCT_A}"):
        nodes = planned(impossible)
        assert nodes[0].state == SkillProgress.FAILURE
        assert "No plan" in nodes[1].progress_message

    nodes = planned(f"(skiros:contain {TRAY_B} {PRODUCT_A})")
    assert nodes[0].state == SkillProgress.SUCCESS, nodes[0].progress_message
    plan = next(node for node in nodes if node.label == "task_plan")
    assert [node.label for node in nodes if node.parent_id == plan.id] == ["drive", "pick", "drive", "place"]
    assert all(node.state == SkillProgress.SUCCESS for node in nodes)
    assert holder(ros, PRODUCT_A) == TRAY_B

    again = planned(f"(skiros:contain {TRAY_B} {PRODUCT_A})")
    assert again[0].state == SkillProgress.SUCCESS
    assert [node.label for node in again[1:]] == ["task_plan"]
    assert again[1].progress_message == "The goal is reached already"

    back = manager.start("skiros:TaskPlan", "task_plan", Goal=f"(skiros:contain {TRAY_A} {PRODUCT_A})")
    assert manager.wait_for(back, lambda nodes: any(n.label == "pick" and n.state == n.RUNNING for n in nodes))
    manager.preempt(back)
    stopped = manager.end(back)
    assert all(node.state != SkillProgress.RUNNING for node in stopped)
    assert stopped[0].state == SkillProgress.FAILURE


@pytest.mark.long
def test_task_plan_without_a_task_manager_fails_and_other_tasks_continue(ros: Ros) -> None:
    ros.launch("skiros2", "skiros.launch", gui=False, task_mgr_on=False, robot_name="mobile_manipulator",
               robot_ontology_prefix="demo", workspace_dir=INSTALL / "share" / "skiros2_demo_skills" / "owl",
               init_scene="pick_place_scene.ttl", libraries_list=["skiros2_std_skills"])  # fmt: skip
    manager = Manager(ros)
    planning = manager.start("skiros:TaskPlan", "task_plan", Goal=f"(skiros:contain {TRAY_B} {PRODUCT_A})")
    waiting = manager.start("skiros:Wait", "wait", Duration=1.0)
    assert manager.end(waiting)[0].state == SkillProgress.SUCCESS
    assert not any(m.progress[0].task_id == planning and abs(m.progress[0].progress_code) == 1
                   for m in manager.progress.all)  # fmt: skip
    nodes = manager.end(planning)
    assert nodes[0].state == SkillProgress.FAILURE
    assert "No task manager answers on tm/task_plan" in nodes[1].progress_message
