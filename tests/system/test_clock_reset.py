"""Nodes survive a simulated clock that is set back, as by a simulation that restarts."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
import rospy
from actionlib_msgs.msg import GoalStatusArray
from rosgraph_msgs.msg import Clock

from support.ros import INSTALL, Ros, RosMaster, wait_until


@pytest.fixture
def clock(ros_master: RosMaster) -> Iterator[rospy.Publisher]:
    ros_master.set_parameter("/use_sim_time", True)
    publisher = rospy.Publisher("/clock", Clock, queue_size=10, latch=True)
    yield publisher
    publisher.unregister()
    ros_master.delete_parameter("/use_sim_time")


def test_action_servers_survive_a_clock_that_is_reset(clock: rospy.Publisher, ros: Ros, tmp_path: Path) -> None:
    ros.master.set_parameter("/wm/workspace_dir", str(tmp_path))
    clock.publish(Clock(rospy.Time.from_sec(100.0)))
    world_model = ros.program(str(INSTALL / "lib/skiros2_world_model/world_model_server_node"), "__name:=wm")
    world_model.wait_for_line("the world model is ready")
    manager = ros.program(str(INSTALL / "lib/skiros2_task/task_manager_node"), "__name:=tm")
    status = ros.messages("/tm/achieve/status", GoalStatusArray)

    def tick(start: float) -> None:
        """Publishes one simulated second."""
        for step in range(1, 11):
            clock.publish(Clock(rospy.Time.from_sec(start + 0.1 * step)))

    wait_until(lambda: status.all, what="the first status")
    wait_until(lambda: clock.get_num_connections() == 2, what="the connections of the clock")
    for start in (1.0, 2.0, 50.0, 0.5):
        tick(start)
        status.clear()
        wait_until(lambda: len(status.all) >= 2, what="status messages")
    for node in (world_model, manager):
        assert node.running
        assert "Traceback" not in node.output
        assert "MovedBackwards" not in node.output
