"""A goal whose plan lacks learned values: the task manager names them, and plans once they are applied."""

from __future__ import annotations

import json
from typing import Any

import pytest
import rospkg

from skiros2_common.core.explanation import UNSET, Explanation
from skiros2_learning.core.evaluation import Evaluation
from skiros2_learning.core.parameter_sets import apply_result
from skiros2_learning.core.scenario import load_scenario
from skiros2_msgs import srv as srvs
from skiros2_msgs.msg import AchieveResult, MakePlanResult
from skiros2_skill.ros.utils import deserialize_skill
from skiros2_task.ros.task_manager_interface import PLAN, TaskManagerInterface
from skiros2_world_model.ros.world_model_interface import WorldModelInterface
from support.ros import ROOT, Ros, wait_until

pytestmark = pytest.mark.timeout(120)

NAMES = ["Push.StartX", "Push.StartY", "Push.GoalX", "Push.GoalY"]
GOAL = "(skiros:at Block Goal)"


def test_the_goal_action_names_missing_values_and_plans_with_applied_ones(ros: Ros) -> None:
    scene = f"{rospkg.RosPack().get_path('skiros2_learning_demo')}/scene"
    files = {"workspace_dir": scene, "init_scene": "push_scene.ttl"}
    ros.run("skiros2_world_model", "world_model_server_node", name="wm", params=files)
    libraries = ["skiros2_std_skills", "skiros2_sim_skills", "skiros2_learning.demo_skills"]
    params = {"libraries_list": libraries, "skill_list": ["push"], "prefix": "demo"}
    ros.run("skiros2_skill", "skill_manager_node", name="pusher", params=params)
    task_manager = ros.run("skiros2_task", "task_manager_node", name="tm")
    ros.service("/pusher/get_skills", srvs.ResourceGetDescriptions)()
    wait_until(lambda: "/tm/achieve/status" in ros.master.topics(), 60.0, "the task manager")

    tasks = TaskManagerInterface()
    tasks.achieve(GOAL)
    refused = tasks.wait_for_result()
    (why,) = map(Explanation.from_dict, json.loads(refused.explanations))
    assert refused.state == AchieveResult.IMPOSSIBLE
    assert (why.type, [f"Push.{p.key}" for p in why.params]) == ("skiros:Push", NAMES)
    assert {p.source for p in why.params} == {UNSET}
    assert "learn scenario --goal '(skiros:at Block Goal)' --libraries skiros2_learning.demo_skills" in refused.message

    texts: list[str] = []

    def plan() -> Any:
        tasks.plan(GOAL, feedback_cb=lambda feedback: texts.append(feedback.progress_message))
        return tasks.wait_for_result()

    left_open = plan()
    assert left_open.progress_code == PLAN, left_open.progress_message
    (push,) = deserialize_skill(left_open.progress_message).children
    assert [push.ph.getParamValues(name.partition(".")[2]) for name in NAMES] == [[]] * 4
    warning = f"warning: the plan lacks values, to be specified when its skills start: {', '.join(NAMES)}"
    # Each topic has its own connection: a result may overtake the feedback before it.
    wait_until(lambda: warning in texts or not plan(), 60.0, "the warning")
    task_manager.wait_for_line("the plan lacks values")

    scenario = load_scenario(ROOT / "skiros2_std_lib/demos/learning/scenarios/push.yaml")
    result = Evaluation(dict.fromkeys(NAMES, 0.01), 1, {"goal": 1.0, "force": 1.0}, success_rate=1.0)
    apply_result(WorldModelInterface("tests"), scenario, 1, result, "2026-01-01T00:00:00+00:00")
    tasks.make_plan(GOAL)
    planned = tasks.wait_for_result()
    assert planned.state == MakePlanResult.PLANNED
    assert [step["skill"] for step in json.loads(planned.plan)] == ["skiros:Push"]
