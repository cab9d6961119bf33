"""Nodes survive a simulated clock that is set back, as by a simulation that restarts."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import actionlib
import actionlib.msg
import pytest
import rospy
from actionlib_msgs.msg import GoalStatusArray
from rosgraph_msgs.msg import Clock

from skiros2_common.ros.goal_server import GoalServer
from support.ros import INSTALL, Ros, wait_until


@pytest.fixture
def clock(ros: Ros) -> Iterator[rospy.Publisher]:
    ros.master.set_parameter("/use_sim_time", True)
    publisher = rospy.Publisher("/clock", Clock, queue_size=10, latch=True)
    yield publisher
    publisher.unregister()
    ros.master.delete_parameter("/use_sim_time")


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


class Obedient(GoalServer):
    """An action whose goals succeed at once."""

    def _begin(self, handle: Any) -> None:
        handle.set_accepted()
        handle.set_succeeded(actionlib.msg.TestResult())

    def _unfinished_handles(self) -> Iterable[Any]:
        return ()


@pytest.mark.parametrize("days", [1, -1])
def test_ended_goals_are_listed_as_long_as_usual_when_the_clock_is_set(
    ros: Ros, monkeypatch: pytest.MonkeyPatch, days: int
) -> None:
    kept, now = 1.0, rospy.Time.now
    name = f"obedient_{days % 3}"
    ros.master.set_parameter(f"/{name}/status_list_timeout", 0.0)
    server = Obedient(f"/{name}", actionlib.msg.TestAction, status_kept=kept)
    server.start()
    status = ros.messages(f"/{name}/status", GoalStatusArray)
    client = actionlib.ActionClient(f"/{name}", actionlib.msg.TestAction)
    assert client.wait_for_server(rospy.Duration(10.0))
    client.send_goal(actionlib.msg.TestGoal(1))
    wait_until(lambda: status.all and status.all[-1].status_list, what="a listed goal")
    begin = time.monotonic()
    monkeypatch.setattr(rospy.Time, "now", lambda: now() + rospy.Duration(days * 86_400))
    wait_until(lambda: not status.all[-1].status_list, what="the end of its listing")
    monkeypatch.undo()
    assert time.monotonic() - begin > 0.7 * kept
    client.stop()
    server.close()
