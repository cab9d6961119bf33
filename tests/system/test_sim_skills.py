"""The skills of the simulated robot, with poses from tf."""

from __future__ import annotations

import math
import subprocess

import pytest

from skiros2_msgs import srv as srvs
from skiros2_sim_msgs.srv import GetPose, SetFault, SetFaultRequest
from skiros2_std_reasoners.core.scene_poses import pose_in_scene
from skiros2_world_model.ros.world_model_interface import WorldModelInterface
from support.ros import Ros, run_command, wait_until
from support.stand_in_drivers import pose_of

pytestmark = pytest.mark.timeout(120)

ROBOT = "/mobile_manipulator"
PRODUCT, GRIPPER, STATION_1 = "skiros:Product-14", "rparts:GripperEffector-4", "demo:Workstation-6"


@pytest.mark.long
def test_picked_object_follows_the_gripper_until_it_is_lost(ros: Ros) -> None:
    ros.launch("skiros2_sim_skills", "demo.launch", gui=False, rate=4.0)
    ros.service(f"{ROBOT}/command", srvs.SkillCommand)
    get_pose = ros.service("/sim/get_pose", GetPose)
    wm = WorldModelInterface("tests")

    def run(*words: str) -> subprocess.CompletedProcess[str]:
        command = ["rosrun", "skiros2_skill", "run", *words]
        return run_command(command, ros.master.env)

    def error(element: str) -> float:
        """How far the world model is from the truth (m)."""
        told = pose_in_scene(wm, wm.get_element(element))[1]
        return math.dist(told.position, pose_of(get_pose(element=element).pose.pose).position)

    picked = run(
        *("drive", "TargetLocation=Workstation 1", "look", "Workstation=Workstation 1", "pick", "Object=Product A")
    )
    assert picked.returncode == 0, picked.stdout + picked.stderr
    assert wm.get_element(PRODUCT).getRelation("", "skiros:contain", "-1")["src"] == GRIPPER
    for element in (PRODUCT, GRIPPER, "cora:Robot-1"):
        wait_until(lambda e=element: error(e) < 0.02, 5.0, f"the pose of {element} by tf")

    slipping = SetFaultRequest(kind=SetFaultRequest.SLIPPING_GRIPPER, target=GRIPPER, active=True, value=0.0)
    assert ros.service("/sim/set_fault", SetFault)(slipping).ok
    lost = run("drive", "TargetLocation=Workstation 2")
    assert lost.returncode == 1
    assert "Product A is not between the fingers: they have closed; Gripper has lost it" in lost.stdout
    assert wm.get_element(PRODUCT).getRelation("", "skiros:contain", "-1")["src"] == "skiros:Scene-0"
    assert wm.get_element(GRIPPER).value_of("skiros:ContainerState") == "Empty"
