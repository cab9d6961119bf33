"""`rosrun skiros2_skill doctor` finds what is wrong with a running system."""

from __future__ import annotations

import json
import xmlrpc.client
from collections.abc import Callable

import pytest
import rospy
from geometry_msgs.msg import TransformStamped
from rosgraph_msgs.msg import Clock
from tf2_msgs.msg import TFMessage

from support.ros import Ros, wait_until

pytestmark = pytest.mark.timeout(90)

Examine = Callable[[], dict[str, str]]


@pytest.fixture
def examine(ros: Ros) -> Examine:
    """Runs the command. Returns the text of each finding that is not good, by its check."""

    def run() -> dict[str, str]:
        program = ros.program("rosrun", "skiros2_skill", "doctor", "--json")
        status = program.wait(60.0)
        findings = json.loads(program.output)
        assert status == any(finding["severity"] == "error" for finding in findings)
        assert all(finding["advice"] for finding in findings if finding["severity"] == "warning")
        return {f["check"]: f["text"] for f in findings if f["severity"] != "ok"}

    return run


def test_missing_parts_are_named_and_running_parts_are_good(ros: Ros, examine: Examine) -> None:
    assert {"world-model", "skill-managers", "task-manager"} <= set(examine())
    ros.launch("skiros2", "world_model_server.launch", gui=False)
    ros.wait_for_node("/wm")
    wait_until(lambda: "/wm/modify" in ros.master.services(), what="the world model")
    assert "world-model" not in examine()


def test_registered_node_that_does_not_answer_is_found(ros: Ros, examine: Examine) -> None:
    master = xmlrpc.client.ServerProxy(ros.master.uri)
    dead = ("/ghost", "/ghostly", "std_msgs/Empty", "http://localhost:1/")
    master.registerPublisher(*dead)
    try:
        assert examine()["nodes"] == "nodes are registered that do not answer: /ghost at localhost:1"
    finally:
        master.unregisterPublisher("/ghost", "/ghostly", dead[3])


def test_simulated_time_needs_one_clock(ros: Ros, examine: Examine) -> None:
    clock = rospy.Publisher("/clock", Clock, queue_size=1)
    try:
        assert "use_sim_time is false" in examine()["clock"]
    finally:
        clock.unregister()
    ros.master.set_parameter("/use_sim_time", True)
    try:
        assert "no node publishes /clock" in examine()["clock"]
    finally:
        ros.master.delete_parameter("/use_sim_time")


@pytest.mark.long
def test_frame_with_two_publishers_is_found(ros: Ros, examine: Examine) -> None:
    pose = ("1", "0", "0", "0", "0", "0")
    other = ros.program("rosrun", "tf2_ros", "static_transform_publisher", *pose, "map", "tool")
    transform = TransformStamped()
    transform.header.frame_id, transform.child_frame_id = "map", "tool"
    transform.transform.rotation.w = 1.0
    own = rospy.Publisher("/tf_static", TFMessage, queue_size=1, latch=True)
    own.publish(TFMessage([transform]))
    try:
        wait_until(lambda: len(_publishers(ros, "/tf_static")) == 2, what="both publishers")
        assert examine()["tf-publishers"].startswith("frame tool is published by several nodes: ")
    finally:
        own.unregister()
        other.stop()


def _publishers(ros: Ros, topic: str) -> list[str]:
    published = xmlrpc.client.ServerProxy(ros.master.uri).getSystemState("/tests")[2][0]  # type: ignore[index, misc]
    return [node for name, nodes in published if name == topic for node in nodes]  # type: ignore[misc, union-attr]
