"""Names of managers in scenes, with and without a slash."""

from __future__ import annotations

import pytest

from compatibility.rules import rule
from skiros2_common.core.world_element import Element
from skiros2_msgs import srv as srvs
from skiros2_skill.ros.skill_layer_interface import SkillLayerInterface
from skiros2_world_model.ros.world_model_interface import WorldModelInterface
from support.ros import Ros, wait_until

pytestmark = pytest.mark.timeout(240)

ROBOT = "/test_robot"


@rule(
    "robots",
    "`skiros:SkillMgr` of the robot's element is the last part of the manager's node name without slash; agents are "
    "listed with slash",
)
def test_skill_mgr_has_no_slash_and_agents_have_one(ros: Ros) -> None:
    ros.launch("skiros2", "world_model_server.launch", gui=False)
    skills = {"libraries_list": "[skiros2_std_skills]", "primitive_list": "[wait]", "skill_list": "[]"}
    ros.launch("skiros2", "skill_mgr.launch", **skills)
    ros.service(f"{ROBOT}/command", srvs.SkillCommand)
    wmi = WorldModelInterface("tests")
    (robot,) = wmi.resolve_elements(Element("cora:Robot", "skiros:test_robot"))
    assert robot.getProperty("skiros:SkillMgr").value == "test_robot"
    layer = SkillLayerInterface("tests")
    wait_until(lambda: list(layer.agents) == [ROBOT], what="the agent")
    layer.shutdown()


@rule(
    "robots", "Scenes with and without slash are accepted: a manager that is gone takes its skills along in both cases"
)
@pytest.mark.parametrize("name", ["test_robot", ROBOT])
def test_a_manager_that_dies_is_taken_away_however_the_scene_names_it(ros: Ros, name: str) -> None:
    ros.launch("skiros2", "world_model_server.launch", gui=False)
    params = {"prefix": "skiros", "libraries_list": ["skiros2_std_skills"], "primitive_list": ["wait"]}
    ros.run("skiros2_skill", "skill_manager_node", name="test_robot", params=params)
    ros.service(f"{ROBOT}/command", srvs.SkillCommand)
    wmi = WorldModelInterface("tests")
    (robot,) = wmi.resolve_elements(Element("cora:Robot", "skiros:test_robot"))
    robot.setProperty("skiros:SkillMgr", name)
    wmi.update_element_properties(robot)
    assert wmi.resolve_elements(Element("skiros:Wait"))
    ros.kill_node(ROBOT)
    wait_until(lambda: not wmi.resolve_elements(Element("skiros:Wait")), what="the last will")
