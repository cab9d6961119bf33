"""Somebody guides a released arm in rviz by the marker at its tool."""

from __future__ import annotations

import math
from collections.abc import Iterator

import pytest
import rospy
from visualization_msgs.msg import InteractiveMarkerFeedback, InteractiveMarkerInit, InteractiveMarkerUpdate

from skiros2_motion.core.geometry import Vector
from skiros2_msgs import srv as srvs
from skiros2_sim_msgs.srv import GetPose
from skiros2_skill.ros.skill_manager_interface import SkillManagerInterface
from skiros2_world_model.ros.world_model_interface import WorldModelInterface
from support.ros import Ros, wait_until
from support.teaching_cell import ARM, GRIPPER

pytestmark = pytest.mark.timeout(180)

WAIT = 60.0  # s


class Cell:
    """The nodes of teaching.launch, and a view's part of a drag."""

    def __init__(self, ros: Ros) -> None:
        ros.launch("skiros2_teaching", "teaching.launch", gui=False)
        ros.service("/panda/get_skills", srvs.ResourceGetDescriptions)()
        ros.run("skiros2_gui", "markers_node", name="markers")
        self.manager = SkillManagerInterface("/panda", "tests")
        self.arm = WorldModelInterface("tests").get_element(ARM)
        self._get_pose = ros.service("/sim/get_pose", GetPose)
        self._full = ros.messages("/skiros/guiding/update_full", InteractiveMarkerInit)
        self._updates = ros.messages("/skiros/guiding/update", InteractiveMarkerUpdate)
        self._feedback = rospy.Publisher("/skiros/guiding/feedback", InteractiveMarkerFeedback, queue_size=10)
        wait_until(self._feedback.get_num_connections, what="a server of the markers")
        self.marker = self._full.wait_for(lambda m: m.markers).markers[0]
        self._updates.clear()
        # a marker's server takes no feedback in the first second; it gives signs of life twice in it
        wait_until(lambda: sum(m.type == m.KEEP_ALIVE for m in self._updates.all) > 2, what="three signs of life")

    def tool(self) -> Vector:
        at = self._get_pose(GRIPPER, "").pose.pose.position
        return at.x, at.y, at.z

    def speed(self) -> float:
        v = self._get_pose(GRIPPER, "").twist.linear
        return math.hypot(v.x, v.y, v.z)

    def release(self) -> None:
        skill = self.manager.get_skill("teach_release")
        skill.ph.specify("Arm", self.arm)
        run = self.manager.run([skill])
        assert run.wait_for_task(WAIT) >= 0

    def send(self, event: int, position: Vector = (0.0, 0.0, 0.0), frame: str = "map") -> None:
        message = InteractiveMarkerFeedback(client_id="rviz", marker_name=self.marker.name, event_type=event)
        message.header.frame_id = frame
        message.pose.position.x, message.pose.position.y, message.pose.position.z = position
        message.pose.orientation.w = 1.0
        self._feedback.publish(message)

    def marker_at(self) -> Vector | None:
        """Where the marker was moved to last."""
        poses = [update.poses[0].pose.position for update in self._updates.all if update.poses]
        return (poses[-1].x, poses[-1].y, poses[-1].z) if poses else None


@pytest.fixture
def cell(ros: Ros) -> Iterator[Cell]:
    yield Cell(ros)


@pytest.mark.long
def test_released_arm_follows_the_dragged_marker(cell: Cell) -> None:
    cell.release()
    x, y, z = cell.tool()
    goal = (x, y + 0.1, z)

    def pulled() -> bool:
        cell.send(InteractiveMarkerFeedback.KEEP_ALIVE)
        return math.dist(cell.tool(), goal) < 0.02

    cell.send(InteractiveMarkerFeedback.MOUSE_DOWN)
    cell.send(InteractiveMarkerFeedback.POSE_UPDATE, goal)
    wait_until(pulled, WAIT, "the tool at the marker")
    cell.send(InteractiveMarkerFeedback.MOUSE_UP)
    wait_until(lambda: cell.speed() < 0.002, WAIT, "the tool at rest")
    wait_until(lambda: math.dist(cell.marker_at() or goal, cell.tool()) < 0.005, WAIT, "the marker at the tool")
    assert math.dist(cell.tool(), (x, y, z)) > 0.05

    # invalid feedback exerts no force
    before = cell.tool()
    cell.send(InteractiveMarkerFeedback.POSE_UPDATE, (x, y - 1.0, z), frame="panda/arm/tool")
    cell.send(InteractiveMarkerFeedback.POSE_UPDATE, (math.nan, y, z))
    sent = rospy.get_time()
    wait_until(lambda: rospy.get_time() > sent + 1.0, WAIT, "a second of simulated time")
    assert math.dist(cell.tool(), before) < 0.01
