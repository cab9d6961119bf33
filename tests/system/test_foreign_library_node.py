"""An unchanged third-party library on a skill manager."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from skiros2_common.core.world_element import Element
from skiros2_msgs import msg as msgs
from skiros2_msgs import srv as srvs
from skiros2_skill.ros.skill_manager_interface import SkillManagerInterface
from skiros2_world_model.ros.world_model_interface import WorldModelInterface
from support.ros import Ros

pytestmark = pytest.mark.timeout(90)

ROBOT = "/test_robot"
LIBRARIES = Path(__file__).parents[1] / "libraries"


def test_a_product_is_brought_to_the_table(ros: Ros) -> None:
    env = {**ros.master.env, "PYTHONPATH": f"{LIBRARIES}:{ros.master.env['PYTHONPATH']}"}
    ros.launch("skiros2", "world_model_server.launch", gui=False)
    manager = ros.launch(
        "skiros2", "skill_mgr.launch", libraries_list="[skiros2_std_skills, foreign_cell_skills]",
        primitive_list="[approach_fake, go_fake, grab_fake, drop_fake, wait]", skill_list="[go_around, bring]", env=env,
    )  # fmt: skip
    ros.service(f"{ROBOT}/command", srvs.SkillCommand)
    wmi = WorldModelInterface("tests")
    shelf, table, dock, bolt = furnish(wmi)
    client = SkillManagerInterface(ROBOT, "tests")
    progress = ros.messages(f"{ROBOT}/monitor", msgs.TreeProgress)
    try:
        bring = client.get_skill("bring")
        bring.ph.specify("Object", bolt)
        bring.ph.specify("To", table)
        task = client.execute(skill_list=[bring])
        assert task >= 0, client.last_error
        end = progress.wait_for(lambda m: m.progress[0].task_id == task and abs(m.progress[0].progress_code) == 1)
        assert end.progress[0].state == msgs.SkillProgress.SUCCESS, end.progress[0].progress_message
    finally:
        client.shutdown()
    assert wmi.get_relations(table.id, "skiros:contain", bolt.id)
    assert not wmi.get_relations(shelf.id, "skiros:contain", bolt.id)
    assert wmi.get_relations("", "skiros:at", table.id)
    assert not wmi.get_relations("", "skiros:at", dock.id)
    assert "error" not in manager.output.lower()


def furnish(wmi: WorldModelInterface) -> list[Any]:
    """Adds a shelf with a bolt, a table, and a dock with the manager's robot; its arm is idle, its gripper empty."""
    elements = [Element("skiros:Location", name) for name in ("shelf", "table", "dock")]
    for place in elements:
        place.addRelation("skiros:Scene-0", "skiros:contain", "-1")
        wmi.add_element(place)
    bolt = Element("skiros:Product", "bolt")
    bolt.setProperty("skiros:Weight", 0.2)
    bolt.addRelation(elements[0].id, "skiros:contain", "-1")
    wmi.add_element(bolt)
    (robot,) = (r for r in wmi.resolve_elements(Element("cora:Robot")) if r.hasProperty("skiros:SkillMgr", ROBOT[1:]))
    robot.setRelation("-1", "skiros:at", elements[2].id)
    wmi.update_element(robot)
    arm = wmi.resolve_element(Element("rparts:ArmDevice"))
    arm.setProperty("skiros:StateProperty", "Idle")
    wmi.update_element_properties(arm)
    gripper = wmi.resolve_element(Element("rparts:GripperEffector"))
    gripper.setProperty("skiros:ContainerState", "Empty")
    wmi.update_element_properties(gripper)
    return [*elements, bolt]
