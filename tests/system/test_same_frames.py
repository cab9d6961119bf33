"""The world model's node publishes that frames are the same."""

from __future__ import annotations

import rospy
from geometry_msgs.msg import TransformStamped
from tf2_msgs.msg import TFMessage

from skiros2_world_model.ros.same_frames import publish_same_frames
from support.ros import Ros


def test_frames_of_the_parameter_are_the_same_on_tf(ros: Ros) -> None:
    ros.launch("skiros2", "world_model_server.launch", gui=False, same_frames="[map world, base odom]")
    message = rospy.wait_for_message("/tf_static", TFMessage, timeout=30.0)
    assert [(t.header.frame_id, t.child_frame_id) for t in message.transforms] == [("map", "world"), ("base", "odom")]
    assert all(t.transform.rotation.w == 1.0 for t in message.transforms)


def test_late_subscriber_gets_them_beside_the_static_frames_of_a_reasoner(ros: Ros) -> None:
    frames = publish_same_frames(["map world"])
    table = TransformStamped(child_frame_id="table")
    table.header.frame_id = "world"
    reasoner = rospy.Publisher("/tf_static", TFMessage, queue_size=1, latch=True)
    reasoner.publish([table])
    try:
        message = rospy.wait_for_message("/tf_static", TFMessage, timeout=30.0)
    finally:
        frames.unregister()
        reasoner.unregister()
    assert [t.child_frame_id for t in message.transforms] == ["world", "table"]


def test_parameter_with_one_name_ends_the_node(ros: Ros) -> None:
    ros.master.set_parameter("/wm/same_frames", ["map"])
    node = ros.program("rosrun", "skiros2_world_model", "world_model_server_node", "__name:=wm")
    assert node.wait() == 78
    assert "expected two names of frames" in node.output
