"""Stops of a skill manager's tasks: their own connections, and their deadlines."""

from __future__ import annotations

import os
import signal
import socket
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from skiros2_common.core.errors import TimedOut, UnknownName
from skiros2_msgs import srv as srvs
from skiros2_skill.client.manager import ALL, ManagerClient
from skiros2_skill.client.stop_line import StopLine
from skiros2_skill.ros.skill_manager_interface import SkillManagerInterface
from skiros2_world_model.core.wm_errors import WmException
from support.ros import Ros, RosMaster, SharedSystem, wait_until

pytestmark = pytest.mark.timeout(120)

ROBOT = "/test_robot"
TESTS = Path(__file__).resolve().parents[1]


@pytest.fixture(scope="module")
def shared(ros_master: RosMaster) -> Iterator[SharedSystem]:
    with SharedSystem(ros_master, launch) as system:
        yield system


def launch(ros: Ros) -> None:
    path = f"{TESTS}:{ros.master.env['PYTHONPATH']}"
    ros.launch(
        "skiros2", "skiros.launch", gui=False, task_mgr_on=False, libraries_list="[support.hand_skills]",
        primitive_list="[stay]", env={**ros.master.env, "PYTHONPATH": path},
    )  # fmt: skip
    ros.service(f"{ROBOT}/stop", srvs.SkillStop)


@pytest.fixture
def robot(shared: SharedSystem) -> Iterator[SkillManagerInterface]:
    shared.use()
    client = SkillManagerInterface(ROBOT, "tests")
    client.stop_line.keep_open()
    yield client
    client.preempt_all()
    wait_until(lambda: not client.read_tasks(), what="the end of all tasks")
    client.shutdown()
    shared.restore()


def _start(robot: ManagerClient, count: int = 1) -> list[int]:
    return [robot.run([robot.get_skill("stay")]).wait_for_task(30) for _ in range(count)]  # type: ignore[attr-defined]


def _answers(robot: ManagerClient) -> bool:
    try:
        return bool(robot.read_skills())
    except WmException:
        return False


def test_command_that_was_not_answered_in_time_is_never_carried_out(ros: Ros, robot: SkillManagerInterface) -> None:
    (task,) = _start(robot)
    wait_until(lambda: robot.stop_line.is_open, what="the stop line")
    pid = ros.master.node_pid(ROBOT)
    os.kill(pid, signal.SIGSTOP)
    try:
        for line in (robot.stop_line, StopLine(ROBOT)):  # an open connection, and none
            begin = time.monotonic()
            with pytest.raises(TimedOut):
                line.send("tests", "preempt", ALL, 0.5)
            assert time.monotonic() - begin < 5.0
    finally:
        os.kill(pid, signal.SIGCONT)
    wait_until(lambda: robot.stop_line.is_open, what="the stop line")
    assert robot.stop_line.send("tests", "", ALL) == []  # a connection that was made later has been served
    assert [nodes[0].id for nodes in robot.read_tasks()] == [task]
    assert robot.stop_line.send("tests", "preempt", ALL) == [task]


def test_stop_does_not_wait_for_silent_connections(ros: Ros, robot: SkillManagerInterface) -> None:
    (task,) = _start(robot)
    wait_until(lambda: robot.stop_line.is_open, what="the stop line")
    host, port = ros.master.service_address(f"{ROBOT}/stop")
    with socket.create_connection((host, port)):  # the node reads its header before it accepts others
        assert robot.stop_line.send("tests", "preempt", task) == [task]


@pytest.mark.long
def test_restarted_manager_is_stopped(ros: Ros, shared: SharedSystem) -> None:
    shared.stop()
    launch(ros)
    robot = SkillManagerInterface(ROBOT, "tests")
    robot.stop_line.keep_open()
    wait_until(lambda: robot.stop_line.is_open, what="the stop line")
    old = ros.master.node_pid(ROBOT)
    os.kill(old, signal.SIGKILL)
    wait_until(lambda: _answers(robot) and ros.master.node_pid(ROBOT) != old, what="the new manager")
    (task,) = _start(robot)
    assert robot.command("preempt", task) == task
    robot.shutdown()


def test_stop_of_an_unknown_task_or_manager_is_refused(robot: SkillManagerInterface) -> None:
    with pytest.raises(Exception, match="no task 77 is here") as refused:
        robot.command("preempt", 77)
    assert refused.value.code == UnknownName.code  # type: ignore[attr-defined]
    with pytest.raises(UnknownName):
        StopLine("/nobody").send("tests", "preempt", ALL)
