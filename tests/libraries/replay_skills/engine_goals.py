"""Drives what is recorded in `engine.bag`: the skills of `engine`, and a grasp that is preempted."""

from __future__ import annotations

import threading
from typing import Any

import actionlib
import rospy

from control_msgs.msg import GripperCommandAction, GripperCommandFeedback, GripperCommandResult
from replay_skills.skills import GRIPPER
from skiros2_skill.ros.skill_manager_interface import SkillManagerInterface


def main() -> None:
    rospy.init_node("recorded_client")
    accepted = threading.Event()

    def take(handle: Any) -> None:
        handle.set_accepted()
        handle.publish_feedback(GripperCommandFeedback(0.07, 0.0, False, False))
        accepted.set()

    def cancel(handle: Any) -> None:
        handle.set_canceled(GripperCommandResult())

    server = actionlib.ActionServer(GRIPPER, GripperCommandAction, take, cancel, auto_start=False)
    server.start()
    manager = SkillManagerInterface("/test_robot", rospy.get_name())
    for label in ("engine_run", "weighed_wait", "watched_run"):
        manager.run([manager.get_skill(label)]).wait()
    grasp = manager.run([manager.get_skill("grasp")])
    accepted.wait(5.0)
    rospy.sleep(0.3)
    grasp.cancel()
    grasp.wait()


if __name__ == "__main__":
    main()
