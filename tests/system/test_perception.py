"""Skills locate an engine block with the simulated camera of an arm, over topics and tf."""

from __future__ import annotations

import math
import re
import subprocess
from collections.abc import Callable, Iterator

import actionlib
import numpy as np
import pytest
import rospy
from actionlib_msgs.msg import GoalStatus
from sensor_msgs.msg import CameraInfo, Image, PointCloud2, PointField
from std_msgs.msg import Header
from trajectory_msgs.msg import JointTrajectoryPoint

from control_msgs.msg import FollowJointTrajectoryAction, FollowJointTrajectoryGoal
from skiros2_common.core.world_element import Element
from skiros2_motion.core.geometry import Pose
from skiros2_msgs import srv as srvs
from skiros2_perception.core.transforms import difference
from skiros2_sim_msgs.srv import GetPose, SetPose
from skiros2_std_reasoners.core.scene_poses import pose_in_scene
from skiros2_world_model.ros.world_model_interface import WorldModelInterface
from support.perception_cell import BLOCK, CAMERA, CUBE, POSTURES, SCENE
from support.ros import Ros, RosMaster, run_command
from support.simulator_client import WAIT, pose_stamped
from support.stand_in_drivers import pose_of

pytestmark = pytest.mark.timeout(240)

CLOUD = "/test/points"


class Cell:
    """The simulated cell with a world model and a skill manager."""

    def __init__(self, ros: Ros) -> None:
        self.ros = ros
        workspace = {"workspace_dir": SCENE.parent}
        ros.launch("skiros2_sim", "sim.launch", scene=SCENE.name, camera_rate=1.0, depth_noise=0.001, **workspace)
        ros.launch(
            "skiros2",
            "skiros.launch",
            gui=False,
            init_scene=SCENE.name,
            robot_name="stationary",
            robot_ontology_prefix="skiros",
            libraries_list="[skiros2_std_skills, skiros2_perception]",
            skill_list="[]",
            primitive_list="[estimate_pose, observe_scene]",
            **workspace,
        )
        ros.service("/stationary/command", srvs.SkillCommand)
        self._get = ros.service("/sim/get_pose", GetPose)
        self._set = ros.service("/sim/set_pose", SetPose)
        self._arm = actionlib.SimpleActionClient("/stationary/arm/follow_joint_trajectory", FollowJointTrajectoryAction)
        assert self._arm.wait_for_server(rospy.Duration(WAIT))
        self.wm = WorldModelInterface("tests")

    def run(self, *words: str) -> subprocess.CompletedProcess[str]:
        return run_command(["rosrun", "skiros2_skill", "run", *words], self.ros.master.env, timeout=120.0)

    def done(self, *words: str) -> str:
        result = self.run(*words, "Timeout=30.0")
        assert result.returncode == 0, result.stdout + result.stderr
        return result.stdout

    def move_to(self, posture: str) -> None:
        """Moves the arm to a posture of the scene."""
        goal = FollowJointTrajectoryGoal()
        goal.trajectory.joint_names = [f"panda_joint{n}" for n in range(1, 8)]
        goal.trajectory.points = [JointTrajectoryPoint(positions=POSTURES[posture], time_from_start=rospy.Duration(2))]
        self._arm.send_goal(goal)
        assert self._arm.wait_for_result(rospy.Duration(WAIT))
        assert self._arm.get_state() == GoalStatus.SUCCEEDED, self._arm.get_goal_status_text()

    def close(self) -> None:
        self._arm.action_client.stop()

    def put(self, eid: str, position: tuple[float, ...], yaw: float) -> None:
        q = (0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2))
        assert self._set(element=eid, pose=pose_stamped(position, q)).ok

    def set_camera(self, key: str, value: str) -> None:
        camera = self.wm.get_element(CAMERA)
        camera.setProperty(key, value, "xsd:string")
        self.wm.update_element_properties(camera)

    def error(self, eid: str) -> tuple[float, float]:
        """How far the world model is from the truth: m, degrees."""
        error = difference(pose_in_scene(self.wm, self.wm.get_element(eid))[1], self.true(eid))
        return float(np.linalg.norm(error[:3])), math.degrees(float(np.linalg.norm(error[3:])))

    def true(self, eid: str) -> Pose:
        return pose_of(self._get(element=eid).pose.pose)


@pytest.fixture(scope="module")
def cell(ros_master: RosMaster) -> Iterator[Cell]:
    ros = Ros(ros_master)
    try:
        made = Cell(ros)
        yield made
        made.close()
    finally:
        ros.stop()


@pytest.mark.long
def test_block_is_located_from_three_postures_of_the_arm(cell: Cell) -> None:
    cell.put(BLOCK, (0.62, 0.015, 0.35), math.pi / 2 + 0.1)
    assert cell.error(BLOCK)[0] > 0.02
    cell.move_to("left")
    cell.done("estimate_pose", "Camera=Camera", "Object=Engine block")
    cell.move_to("right")
    cell.done("estimate_pose", "Camera=Camera", "Object=Engine block", "Fuse=true")
    cell.move_to("home")
    text = cell.done("estimate_pose", "Camera=Camera", "Object=Engine block", "Fuse=true")
    assert "3 views" in text
    position, angle = cell.error(BLOCK)
    assert position < 0.001 and angle < 0.3
    block = cell.wm.get_element(BLOCK)
    assert block.value_of("skiros:EstimateViews") == 3 and block.value_of("skiros:EstimateFitness") > 0.8


@pytest.mark.long
def test_displaced_block_is_refused_by_fusion_and_located_again(cell: Cell) -> None:
    cell.move_to("left")
    cell.done("estimate_pose", "Camera=Camera", "Object=Engine block")
    x, y, z = cell.true(BLOCK).position
    cell.put(BLOCK, (x - 0.02, y, z), math.pi / 2)
    version = cell.wm.get_element(BLOCK).version
    refused = cell.run("estimate_pose", "Camera=Camera", "Object=Engine block", "Fuse=true", "Timeout=30.0")
    assert refused.returncode == 1 and "the object may have moved" in refused.stdout
    assert cell.wm.get_element(BLOCK).version == version
    cell.done("estimate_pose", "Camera=Camera", "Object=Engine block")
    assert cell.error(BLOCK)[0] < 0.002


@pytest.mark.long
def test_removed_cube_becomes_missing(cell: Cell) -> None:
    cell.move_to("home")
    assert "2 objects in view" in cell.done("observe_scene", "Camera=Camera")
    cell.put(CUBE, (3.0, 3.0, 0.1), 0.0)
    for _ in range(4):
        text = cell.done("observe_scene", "Camera=Camera")
    assert "missing: Cube" in text
    assert cell.wm.get_element(CUBE).value_of("skiros:Missing") is True


@pytest.mark.long
def test_unknown_cube_becomes_one_element_with_a_frame(cell: Cell) -> None:
    """Last of the tests with the cube: its element is removed."""
    cell.move_to("home")
    cell.wm.remove_element(cell.wm.get_element(CUBE))
    cell.put(CUBE, (0.45, 0.2, 0.33), 0.3)
    assert "new: skiros:UnknownObject-" in cell.done("observe_scene", "Camera=Camera", "Place=Table")
    assert "new" not in cell.done("observe_scene", "Camera=Camera", "Place=Table")
    (element,) = cell.wm.resolve_elements(Element("skiros:UnknownObject"))
    assert cell.wm.get_element(element.getRelation("", "skiros:contain", "-1")["src"]).label == "Table"
    assert math.dist(pose_in_scene(cell.wm, element)[1].position, cell.true(CUBE).position) < 0.01
    assert element.value_of("skiros:FrameId") and element.value_of("skiros:Confidence") > 0.7


@pytest.mark.long
def test_camera_without_messages_and_frame_without_tf_are_refused(cell: Cell, clouds: Clouds) -> None:
    silent = cell.run("estimate_pose", "Camera=Camera", "Object=Engine block", "Timeout=0.5")
    assert silent.returncode == 1 and f"No view within 0.5 s: no message on {CLOUD}" in silent.stdout

    clouds.publish(lambda cloud: setattr(cloud.header, "frame_id", "nowhere"))
    lost = cell.run("estimate_pose", "Camera=Camera", "Object=Engine block", "Timeout=10.0")
    assert lost.returncode == 1 and re.search("no transform from 'nowhere' to 'map' on tf at", lost.stdout)

    clouds.publish(lambda cloud: setattr(cloud.header, "stamp", rospy.Time(1)))
    old = cell.run("estimate_pose", "Camera=Camera", "Object=Engine block", "Timeout=10.0")
    assert old.returncode == 1 and re.search(r"the last message is [\d.]+ s older than the start", old.stdout)

    clouds.publish(lambda cloud: setattr(cloud, "data", np.full(len(cloud.data) // 4, np.nan, np.float32).tobytes()))
    empty = cell.run("estimate_pose", "Camera=Camera", "Object=Engine block", "Timeout=30.0")
    assert empty.returncode == 1 and "0 points before the camera: expected at least 100" in empty.stdout


@pytest.mark.long
def test_block_is_located_from_point_clouds(cell: Cell, clouds: Clouds) -> None:
    cell.move_to("left")
    clouds.publish(lambda cloud: None)
    cell.done("estimate_pose", "Camera=Camera", "Object=Engine block")
    assert cell.error(BLOCK)[0] < 0.002


class Clouds:
    """Makes point clouds of the depth images, as drivers do."""

    def __init__(self) -> None:
        self._publisher = rospy.Publisher(CLOUD, PointCloud2, queue_size=1)
        self._info = rospy.wait_for_message("/stationary/camera/depth/camera_info", CameraInfo, 30.0)
        self._change: Callable[[PointCloud2], None] | None = None
        self._subscriber = rospy.Subscriber("/stationary/camera/depth/image_raw", Image, self._on_image, queue_size=1)

    def publish(self, change: Callable[[PointCloud2], None]) -> None:
        """Publishes all further clouds, changed."""
        self._change = change

    def close(self) -> None:
        self._subscriber.unregister()
        self._publisher.unregister()

    def _on_image(self, image: Image) -> None:
        change, k = self._change, self._info.K
        if change is None:
            return
        depth = np.frombuffer(image.data, np.float32).reshape(image.height, image.width)
        columns, rows = np.meshgrid(np.arange(image.width), np.arange(image.height))
        points = np.stack(((columns - k[2]) / k[0] * depth, (rows - k[5]) / k[4] * depth, depth), axis=-1)
        fields = [PointField(name, 4 * n, PointField.FLOAT32, 1) for n, name in enumerate("xyz")]
        header = Header(frame_id=image.header.frame_id, stamp=image.header.stamp)
        data = points.astype(np.float32).tobytes()
        cloud = PointCloud2(header, image.height, image.width, fields, False, 12, 12 * image.width, data, False)
        change(cloud)
        self._publisher.publish(cloud)


@pytest.fixture
def clouds(cell: Cell) -> Iterator[Clouds]:
    """The camera has point clouds, from the first `publish` on."""
    cell.set_camera("skiros:PointCloudTopic", CLOUD)
    made = Clouds()
    yield made
    made.close()
    cell.set_camera("skiros:PointCloudTopic", "")
