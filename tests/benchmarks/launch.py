"""From `roslaunch` to ready, beside a `roslaunch` of as many empty rospy nodes."""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path

from benchmarks.measurement import Measurement, paired
from support.programs import Program
from support.ros import RosMaster, wait_until

RUNS = 5
TARGET = 2.0

ROSLAUNCH = ("roslaunch", "--skip-log-check", "--disable-title", "--no-summary")

#: world model, skill manager, task manager
NODES = 3

READY_SERVICES = {"/wm/get", "/test_robot/command"}
READY_TOPICS = {"/tm/task_plan/status"}

EMPTY_NODE = """#!/usr/bin/env python3
import rospy
from std_srvs.srv import Trigger, TriggerResponse

rospy.init_node("empty")
rospy.Service("~ready", Trigger, lambda request: TriggerResponse())
rospy.spin()
"""


def measure(folder: Path) -> Iterator[Measurement]:
    peer_launch = _empty_nodes(folder)
    yield paired(
        "roslaunch skiros.launch to ready",
        lambda: _until([*ROSLAUNCH, "skiros2", "skiros.launch", "gui:=false"], folder, _platform_ready),
        f"roslaunch of {NODES} empty rospy nodes",
        lambda: _until([*ROSLAUNCH, str(peer_launch)], folder, _peer_ready),
        unit="s",
        runs=RUNS,
        target=TARGET,
    )


def _platform_ready(master: RosMaster) -> bool:
    return master.services() >= READY_SERVICES and master.topics() >= READY_TOPICS


def _peer_ready(master: RosMaster) -> bool:
    return master.services() >= {f"/empty_{number}/ready" for number in range(NODES)}


def _until(command: list[str], folder: Path, ready: Callable[[RosMaster], bool]) -> float:
    """The time from starting the command to the condition (s). roslaunch starts the master, too."""
    master = RosMaster(Path(tempfile.mkdtemp(dir=folder)))
    env = {**master.env, "ROS_PACKAGE_PATH": f"{folder}:{master.env['ROS_PACKAGE_PATH']}"}
    start = time.perf_counter()
    program = Program([*command[:1], "-p", str(master.port), *command[1:]], env, cwd=master.home)
    try:
        wait_until(lambda: _asked(ready, master), timeout=60, what="the nodes to be ready")
        return time.perf_counter() - start
    finally:
        program.stop()


def _asked(ready: Callable[[RosMaster], bool], master: RosMaster) -> bool:
    try:
        return ready(master)
    except OSError:
        return False  # no master yet


def _empty_nodes(folder: Path) -> Path:
    """A launch file of empty nodes that run with the interpreter of ours."""
    package = folder / "empty_nodes"
    package.mkdir()
    script = package / "empty"
    script.write_text(EMPTY_NODE.replace("#!/usr/bin/env python3", f"#!{sys.executable}", 1))
    script.chmod(0o755)
    (package / "package.xml").write_text(
        "<package><name>empty_nodes</name><version>0.0.0</version><description>peer</description>"
        "<maintainer email='nobody@example.org'>nobody</maintainer><license>none</license></package>"
    )
    launch = package / "empty.launch"
    nodes = "".join(
        f'<node name="empty_{number}" pkg="empty_nodes" type="empty" respawn="true" output="screen"/>'
        for number in range(NODES)
    )
    static = (
        '<node name="map_to_world" pkg="tf2_ros" type="static_transform_publisher" respawn="true"'
        ' args="0 0 0 0 0 0 map world"/>'
    )
    launch.write_text(f"<launch>{nodes}{static}</launch>")
    return launch
