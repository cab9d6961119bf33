"""Drives what is recorded in `gripper.bag`: a gripper driver, and goals of tasks side by side, one cancelled."""

from __future__ import annotations

import threading
from typing import Any

import actionlib
import rospy

from control_msgs.msg import GripperCommandAction, GripperCommandFeedback, GripperCommandResult
from replay_skills.skills import GRIPPER
from skiros2_skill.ros.skill_manager_interface import SkillManagerInterface

#: The width at which something is between the fingers (m).
OBJECT = 0.03


def main() -> None:
    rospy.init_node("recorded_client")
    server = actionlib.ActionServer(GRIPPER, GripperCommandAction, _take, auto_start=False)
    server.start()
    manager = SkillManagerInterface("/test_robot", rospy.get_name())
    holders = {label: manager.get_skill(label) for label in ("grasp_and_wait", "grasp", "wait")}
    holders["wait"].ph.specify("Duration", 30.0)
    long = manager.run([holders["wait"]])
    manager.run([holders["grasp_and_wait"]]).wait()
    holders["grasp"].ph.specify("Width", 0.01)
    manager.run([holders["grasp"]]).wait()
    long.cancel()
    long.wait()


def _take(handle: Any) -> None:
    handle.set_accepted()
    threading.Thread(target=_close, args=(handle,), daemon=True).start()


def _close(handle: Any) -> None:
    wanted, width = handle.get_goal().command.position, 0.08
    while width > max(wanted, OBJECT):
        rospy.sleep(0.1)
        width -= 0.02
        handle.publish_feedback(GripperCommandFeedback(width, 0.0, False, False))
    handle.set_succeeded(GripperCommandResult(width, 20.0, width > wanted + 0.01, width <= wanted))


if __name__ == "__main__":
    main()
