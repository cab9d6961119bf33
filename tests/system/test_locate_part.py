"""The piston cell locates its displaced engine block with the camera of an arm, as a step of a plan."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
import pytest

from skiros2_learning.local.insertion_study import BLOCK
from skiros2_motion.core.geometry import Pose, composed, from_euler
from skiros2_msgs import srv as srvs
from skiros2_perception.core.transforms import difference
from skiros2_sim_msgs.srv import GetPose, SetPose
from skiros2_std_reasoners.core.scene_poses import pose_in_scene
from skiros2_world_model.ros.world_model_interface import WorldModelInterface
from support.ros import Ros, RosMaster, run_command
from support.simulator_client import pose_stamped
from support.stand_in_drivers import pose_of

pytestmark = pytest.mark.timeout(300)

GOAL = "(skiros:contain skiros:Bore-13 piston:Piston-20)"


class Cell:
    """The whole piston cell."""

    def __init__(self, ros: Ros) -> None:
        self._ros = ros
        ros.launch("skiros2_contact_skills", "piston.launch", gui=False, rate=2.0)
        ros.service("/piston_cell/command", srvs.SkillCommand)
        self._get = ros.service("/sim/get_pose", GetPose)
        self._set = ros.service("/sim/set_pose", SetPose)
        self.wm = WorldModelInterface("tests")

    def run(self, *words: str) -> str:
        result = run_command(["rosrun", *words], self._ros.master.env, timeout=120.0)
        assert result.returncode == 0, result.stdout + result.stderr
        return result.stdout

    def displace(self, shift: tuple[float, float], turn: float) -> None:
        """Moves the block in the simulated world, but not in the world model (m, rad)."""
        true = composed(self.true(), Pose((*shift, 0.0), from_euler(0.0, 0.0, turn)))
        assert self._set(element=BLOCK, pose=pose_stamped(true.position, true.orientation)).ok

    def error(self) -> tuple[float, float]:
        """How far the block in the world model is from the true one: m, degrees."""
        error = difference(pose_in_scene(self.wm, self.wm.get_element(BLOCK))[1], self.true())
        return float(np.linalg.norm(error[:3])), math.degrees(float(np.linalg.norm(error[3:])))

    def true(self) -> Pose:
        return pose_of(self._get(element=BLOCK).pose.pose)

    def forget_place(self) -> None:
        block = self.wm.get_element(BLOCK)
        block.setProperty("piston:Located", False)
        self.wm.update_element_properties(block)


@pytest.fixture
def cell(ros_master: RosMaster) -> Iterator[Cell]:
    ros = Ros(ros_master)
    try:
        yield Cell(ros)
    finally:
        ros.stop()


@pytest.mark.long
def test_displaced_block_is_located_before_the_insertion(cell: Cell) -> None:
    assert "locate_part" not in cell.run("skiros2_task", "plan", GOAL)
    cell.forget_place()
    assert "locate_part" in cell.run("skiros2_task", "plan", GOAL)

    cell.displace((0.0021, -0.0021), math.radians(2.0))
    assert cell.error() == pytest.approx((0.003, 2.0), abs=0.05)
    cell.run("skiros2_skill", "run", "locate_part", "Object=Engine block")
    position, angle = cell.error()
    assert position < 0.0005 and angle < 0.2
    block = cell.wm.get_element(BLOCK)
    assert block.value_of("piston:Located") is True and block.value_of("skiros:EstimateViews") == 2
    assert "locate_part" not in cell.run("skiros2_task", "plan", GOAL)
