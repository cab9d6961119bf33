"""The simulator node: topics, services, shutdown."""

from __future__ import annotations

import math
import os
import shutil
import signal
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rospy
from actionlib_msgs.msg import GoalStatusArray
from geometry_msgs.msg import Point, Vector3, Wrench, WrenchStamped
from nav_msgs.msg import Odometry
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import CameraInfo, Image, JointState

from skiros2_common.core.errors import SkirosError
from skiros2_common.ros.node import EXIT_CONFIGURATION
from skiros2_gui.app.ros.connections import SimulatorConnection
from skiros2_sim_msgs.msg import Contacts
from skiros2_std_reasoners.ros.transforms import Transforms
from support.ros import Ros, RosMaster, wait_until
from support.simulator_client import (
    ARM,
    CAMERA,
    GRIPPER,
    PRODUCT,
    ROBOT,
    SCENE,
    TRAY,
    WAIT,
    WORKSPACE,
    SimulatorClient,
    pose_stamped,
)

pytestmark = pytest.mark.timeout(120)

NAN = math.nan


# -- what it publishes ------------------------------------------------------------------------------------------------


def test_the_clock_ticks_at_least_50_times_a_simulated_second_and_never_goes_back(
    ros: Ros, sim: SimulatorClient
) -> None:
    clock = ros.messages("/clock", Clock)
    begin = sim.step(0).stamp
    assert sim.step(240).stamp == begin + rospy.Duration(1)
    sim.reset(seed=3)
    end = sim.step(24).stamp
    clock.wait_for(lambda message: message.clock == end)
    times = [message.clock for message in clock.all]
    assert times == sorted(times)
    steps = np.diff([time.to_sec() for time in times if time >= begin])
    assert steps.max() <= 0.02
    assert end > begin + rospy.Duration(1)


def test_node_knows_its_own_time_without_its_messages(ros: Ros, ros_master: RosMaster, sim: SimulatorClient) -> None:
    assert "/sim" not in ros_master.subscribers("/clock")
    status = ros.messages("/mobile_manipulator/move_base/status", GoalStatusArray)
    now = sim.step(240).stamp
    status.wait_for(lambda message: now - message.header.stamp < rospy.Duration(0, 20_000_000))


def test_joints_odometry_wrench_and_frames_are_published(ros: Ros, sim: SimulatorClient) -> None:
    topics = (("joint_states", JointState), ("odom", Odometry), ("arm/wrench", WrenchStamped))
    joints, odometry, wrench = (ros.messages(f"/mobile_manipulator/{name}", kind) for name, kind in topics)
    transforms = Transforms()
    transforms.listen()
    wait_until(lambda: sim.step(24).ok and joints.all and odometry.all and wrench.all, WAIT, "what sensors tell")
    message = joints.all[-1]
    assert [f"arm/panda_joint{i}" for i in range(1, 8)] == message.name[:7]
    assert len(message.name) == len(message.position) == len(message.velocity) == len(message.effort)
    assert (odometry.all[-1].header.frame_id, odometry.all[-1].child_frame_id) == (
        "mobile_manipulator/odom",
        "mobile_manipulator/base_link",
    )
    assert wrench.all[-1].header.frame_id == "mobile_manipulator/arm/tool"
    tool = wait_until(lambda: sim.step(24).ok and transforms.find("map", "mobile_manipulator/arm/tool"), WAIT, "tf")
    assert tool.position == pytest.approx(sim.position(GRIPPER), abs=0.01)
    assert transforms.find("mobile_manipulator/odom", "mobile_manipulator/camera") is not None


def test_contacts_are_latched_and_published_on_change(ros: Ros, sim: SimulatorClient) -> None:
    sim.step(240)
    contacts = ros.messages("/sim/contacts", Contacts)

    def lies_in_the_tray(message: Any) -> bool:
        return any({PRODUCT, TRAY} == {contact.first, contact.second} for contact in message.contacts)

    contacts.wait_for(lies_in_the_tray)
    x, y, z = sim.position(PRODUCT)
    assert sim.set_pose(PRODUCT, pose_stamped((x, y, z + 0.5))).ok
    sim.step(24)
    contacts.wait_for(lambda message: message.contacts and not lies_in_the_tray(message))


def test_images_are_published_only_with_subscribers(ros: Ros, sim: SimulatorClient) -> None:
    colour = ros.messages("/mobile_manipulator/camera/color/image_raw", Image)
    depth = ros.messages("/mobile_manipulator/camera/depth/image_raw", Image)
    info = ros.messages("/mobile_manipulator/camera/depth/camera_info", CameraInfo)
    wait_until(lambda: sim.step(48).ok and colour.all and depth.all and info.all, WAIT, "pictures")
    image, lens = colour.all[0], info.all[0]
    assert (image.encoding, image.width, image.height, len(image.data)) == ("rgb8", 320, 240, 320 * 240 * 3)
    assert len(set(image.data)) > 10
    distances = np.frombuffer(depth.all[0].data, np.float32)
    assert (depth.all[0].encoding, distances.size) == ("32FC1", 320 * 240)
    assert 0 < np.nanmin(distances) < np.nanmax(distances) < 20
    assert (lens.header.frame_id, lens.width, lens.K[0]) == ("mobile_manipulator/camera", 320, lens.K[4])


# -- time -------------------------------------------------------------------------------------------------------------


def test_action_servers_publish_their_status_while_paused(ros: Ros, sim: SimulatorClient) -> None:
    status = ros.messages("/mobile_manipulator/move_base/status", GoalStatusArray)
    wait_until(lambda: len(status.all) > 3, what="status of an action")


def test_stepped_run_is_repeatable_after_a_reset(sim: SimulatorClient) -> None:
    def run(seed: int) -> list[tuple[float, ...]]:
        sim.reset(seed)
        assert sim.push(PRODUCT, Wrench(Vector3(4, 1, 0), Vector3()), rospy.Duration.from_sec(0.1)).ok
        sim.step(120)
        return [sim.position(PRODUCT), sim.position(GRIPPER), sim.position(TRAY)]

    first = run(seed=5)
    assert first == run(seed=5)


def test_time_advances_only_while_not_paused(sim: SimulatorClient) -> None:
    before = sim.step(0).stamp
    with sim.running():
        wait_until(lambda: sim.get_pose(ROBOT, "").pose.header.stamp > before + rospy.Duration(1), WAIT)
        refused = sim.step(1)
        assert (refused.ok, "not paused" in refused.message) == (False, True)
    assert sim.step(0).stamp == sim.step(0).stamp


# -- poses, pushes, faults --------------------------------------------------------------------------------------------


def test_poses_are_given_in_any_frame(sim: SimulatorClient) -> None:
    in_map, of_robot = sim.position(PRODUCT), sim.position(ROBOT)
    answer = sim.get_pose(PRODUCT, "mobile_manipulator/base_link")
    assert answer.pose.header.frame_id == "mobile_manipulator/base_link"
    at = answer.pose.pose.position
    assert (at.x, at.y) == pytest.approx((in_map[0] - of_robot[0], in_map[1] - of_robot[1]), abs=1e-4)
    assert sim.set_pose(PRODUCT, pose_stamped((1.0, 0.0, 0.05), frame="mobile_manipulator/base_link")).ok
    assert sim.position(PRODUCT) == pytest.approx((of_robot[0] + 1.0, of_robot[1], 0.05), abs=1e-4)


def test_pushed_body_moves(sim: SimulatorClient) -> None:
    sim.step(120)
    before = sim.position(PRODUCT)
    assert sim.push(PRODUCT, Wrench(Vector3(0, 0, 20), Vector3()), rospy.Duration.from_sec(0.1)).ok
    sim.step(24)
    assert sim.position(PRODUCT)[2] > before[2] + 0.01


def test_window_pushes_a_body(sim: SimulatorClient) -> None:
    simulator = SimulatorConnection()
    assert simulator.is_up()
    sim.step(120)
    before = sim.position(PRODUCT)
    simulator.push(PRODUCT, (0.0, 0.0, 20.0), 0.1)
    sim.step(24)
    assert sim.position(PRODUCT)[2] > before[2] + 0.01
    with pytest.raises(SkirosError, match="nothing:Here"):
        simulator.push("nothing:Here-1", (0.0, 0.0, 20.0), 0.1)
    simulator.close()


def test_delayed_sensor_reports_the_past(ros: Ros, sim: SimulatorClient) -> None:
    joints = ros.messages("/mobile_manipulator/joint_states", JointState)
    wait_until(lambda: sim.step(24).ok and joints.all, WAIT, "joint states")
    assert sim.set_fault("late_sensor", ARM, True, 1.0, 0.0).ok
    joints.clear()
    begin = sim.step(0).stamp
    end = sim.step(480).stamp
    # the other topics of this step have come too, when this one has
    last = joints.wait_for(lambda m: m.header.stamp >= end - rospy.Duration.from_sec(1.05))
    assert all(m.header.stamp <= end - rospy.Duration(1) for m in joints.all)
    assert last.header.stamp >= begin
    assert sim.set_fault("late_sensor", ARM, False, 0.0, 0.0).ok
    joints.wait_for(lambda m: sim.step(24).ok and m.header.stamp > end)


def test_objects_are_detected_and_pictures_taken(sim: SimulatorClient) -> None:
    x, y, z = sim.position(TRAY)
    assert sim.set_pose(ROBOT, pose_stamped((1.0, 1.5, 0.0))).ok
    sim.step(120)
    answer = sim.detect(CAMERA, "mobile_manipulator/base_link", ["skiros:Product"])
    assert answer.ok, answer.message
    assert {d.pose.header.frame_id for d in answer.detections} <= {"mobile_manipulator/base_link"}
    assert {d.type for d in answer.detections} <= {"skiros:Product"}
    answer = sim.take_picture(Point(x - 1, y, z + 1), Point(x, y, z), 0.0, 64, 48)
    assert (answer.ok, answer.image.width, answer.image.height) == (True, 64, 48)


REFUSED = [
    ("get_pose", ("nobody", ""), "'nobody' is not in the simulated world"),
    ("get_pose", ("", ""), "'' is not in the simulated world"),
    ("get_pose", (PRODUCT, "no_frame"), "frame 'no_frame' is neither in the simulated world nor on tf"),
    ("set_pose", (PRODUCT, pose_stamped((NAN, 0, 0))), "expected numbers up to"),
    ("set_pose", (PRODUCT, pose_stamped((1e300, 0, 0))), "expected numbers up to"),
    ("set_pose", (PRODUCT, pose_stamped((0, 0, 0), (0, 0, 0, 0))), "expected a quaternion of length 1"),
    ("set_pose", (PRODUCT, pose_stamped((0, 0, 0), (NAN, 0, 0, 1))), "expected a quaternion of length 1"),
    ("set_pose", (PRODUCT, pose_stamped((0, 0, 0), frame="no_frame")), "no_frame"),
    ("set_pose", (GRIPPER, pose_stamped((0, 0, 0))), "part of a robot"),
    ("push", ("nobody", Wrench(), rospy.Duration(1)), "nobody"),
    ("push", (PRODUCT, Wrench(Vector3(NAN, 0, 0), Vector3()), rospy.Duration(1)), "force"),
    ("push", (PRODUCT, Wrench(), rospy.Duration(-1)), "push of"),
    ("push", ("demo:Workstation-6", Wrench(Vector3(1, 0, 0), Vector3()), rospy.Duration(1)), "fixed"),
    ("set_fault", ("gremlins", GRIPPER, True, 0.0, 0.0), "no fault 'gremlins'"),
    ("set_fault", ("slipping_gripper", ROBOT, True, 0.0, 0.0), "expected a gripper"),
    ("set_fault", ("slipping_gripper", GRIPPER, True, NAN, 0.0), "expected a value"),
    ("set_fault", ("slipping_gripper", GRIPPER, True, 0.5, -1.0), "expected a duration"),
    ("detect", ("nobody", "", []), "no camera 'nobody'"),
    ("detect", (CAMERA, "", ["no:Such"]), "no class 'no:Such'"),
    ("detect", (CAMERA, "no_frame", []), "no_frame"),
    ("take_picture", (Point(NAN, 0, 0), Point(), 0.0, 0, 0), "eye"),
    ("take_picture", (Point(), Point(), 0.0, 0, 0), "the points are equal"),
    ("take_picture", (Point(1, 1, 1), Point(), 0.0, 10**9, 0), "pixels"),
    ("take_picture", (Point(1, 1, 1), Point(), NAN, 0, 0), "field of view"),
    ("step", (2**32 - 1,), "expected 0 to 864000"),
    ("set_rate", (NAN,), "times real time"),
    ("set_rate", (-1.0,), "times real time"),
]


@pytest.mark.parametrize(("service", "arguments", "reason"), REFUSED)
def test_impossible_requests_are_rejected_with_the_reason(
    shared_sim: SimulatorClient, service: str, arguments: tuple[Any, ...], reason: str
) -> None:
    answer = getattr(shared_sim, service)(*arguments)
    assert (answer.ok, answer.message) == (False, answer.message)
    assert reason in answer.message


# -- its start and end ------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def other_master(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RosMaster]:
    """One whose clock is of no other simulator."""
    with RosMaster(tmp_path_factory.mktemp("other")) as master:
        yield master


@pytest.fixture
def other(other_master: RosMaster) -> Iterator[Ros]:
    ros = Ros(other_master)
    yield ros
    ros.stop()


@pytest.mark.parametrize("arguments", [{"rate": -1.0}, {"scene": "nothing.ttl"}], ids=["rate", "scene"])
def test_invalid_parameter_ends_the_node_with_one_line(other: Ros, arguments: dict[str, Any]) -> None:
    params = {"workspace": str(WORKSPACE), "scene": SCENE} | arguments
    program = other.run("skiros2_sim", "simulator_node", name="sim", params=params)
    assert program.wait(WAIT) == EXIT_CONFIGURATION
    assert all(str(value) in program.output for value in arguments.values())
    assert "Traceback" not in program.output


def test_simulator_with_a_broken_scene_and_no_display_runs_until_terminated(other: Ros, tmp_path: Path) -> None:
    text = (WORKSPACE / SCENE).read_text()
    for right, wrong in (
        ("franka_panda/panda.urdf", "nowhere.urdf"),
        ('"/mobile_manipulator/move_base"', '"no name!"'),
        ('skiros:SizeX "0.6"', 'skiros:SizeX "NaN"'),
    ):
        assert right in text
        text = text.replace(right, wrong)
    shutil.copy(WORKSPACE / "demo.owl.ttl", tmp_path)
    (tmp_path / SCENE).write_text(text)
    params = {"workspace": str(tmp_path), "scene": SCENE, "gui": True}
    env = {key: value for key, value in other.master.env.items() if key != "DISPLAY"}
    program = other.run("skiros2_sim", "simulator_node", name="sim", params=params, env=env)
    program.wait_for_line("the simulated world is ready", WAIT)
    for expected in ("cannot open a window", "nowhere.urdf", "'no name!' is not a valid ROS name", "size ignored"):
        assert expected in program.output
    assert "/mobile_manipulator/move_base/goal" in {name for kind, name, _ in other.master.registrations({"/sim"})}
    os.kill(other.master.node_pid("/sim"), signal.SIGTERM)
    program.wait(10)
    assert "Traceback" not in program.output
