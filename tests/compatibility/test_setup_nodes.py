"""Programs and packages that launch files written for SkiROS2 need."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import pytest

from compatibility.rules import rule
from support.ros import INSTALL, ROOT, Ros, wait_until

CELL = """
<launch>
  <param name="robot_description" textfile="{urdf}"/>
  <node name="world_to_map" pkg="tf" type="static_transform_publisher" args="0 0 0 0 0 0 world map 100"/>
  <node name="map_to_base" pkg="tf2_ros" type="static_transform_publisher" args="1 0 0 0 0 0 map base"/>
  <node name="joint_states" pkg="joint_state_publisher" type="joint_state_publisher"/>
  <node name="robot_state" pkg="robot_state_publisher" type="robot_state_publisher"/>
  <node name="relay" pkg="topic_tools" type="relay" args="/joint_states /arm/joint_states"/>
  <include file="$(find skiros2)/launch/skiros.launch">
    <arg name="gui" value="false"/>
    <arg name="workspace_dir" value="$(find skiros2)/owl"/>
  </include>
</launch>
"""

ARM = """
<robot name="arm">
  <link name="base"/><link name="tool"/>
  <joint name="turn" type="continuous"><parent link="base"/><child link="tool"/><axis xyz="0 0 1"/></joint>
</robot>
"""


@pytest.mark.long
@rule(
    "more",
    "Launch files that name nodes of `tf`, `tf2_ros`, `topic_tools`, `robot_state_publisher`, `joint_state_publisher` "
    "and `rviz` start after the set-up",
)
def test_nodes_of_existing_launch_files_are_installed(ros: Ros, tmp_path: Path) -> None:
    from sensor_msgs.msg import JointState
    from tf2_msgs.msg import TFMessage

    urdf, file = tmp_path / "arm.urdf", tmp_path / "cell.launch"
    urdf.write_text(ARM)
    file.write_text(CELL.format(urdf=urdf))
    joints = ros.messages("/arm/joint_states", JointState)
    transforms = ros.messages("/tf", TFMessage)
    program = ros.launch_file(file)
    assert joints.wait_for().name == ["turn"]
    transforms.wait_for(lambda message: message.transforms[0].child_frame_id == "tool")
    transforms.wait_for(lambda message: message.transforms[0].child_frame_id == "map")
    wait_until(lambda: {"/wm", "/test_robot", "/tm", "/map_to_base"} <= ros.master.nodes(), what="the platform's nodes")
    assert "process has died" not in program.output


@rule(
    "more",
    "`rosrun tf tf_echo`, `rosrun tf2_tools echo.py` and `rosrun topic_tools throttle` are installed",
)
def test_command_line_tools_of_transforms_and_topics_are_installed(ros: Ros) -> None:
    for package, tool in (("tf", "tf_echo"), ("tf2_tools", "echo.py"), ("topic_tools", "throttle")):
        asked = ros.run(package, tool)  # without arguments
        asked.wait()
        assert "usage" in asked.output.lower(), asked.output


@rule(
    "more",
    "After `source install/setup.bash`, `python3` and `pytest` import ROS, the platform and its libraries; "
    "`deactivate` undoes it",
)
def test_sourced_shell_has_the_python_that_imports_everything() -> None:
    environment = str(ROOT / ".venv/bin")
    path = ":".join(part for part in os.environ["PATH"].split(":") if part != environment)
    env = {"PATH": path, "HOME": os.environ["HOME"]}
    script = (
        f"source {INSTALL}/setup.bash && python3 -c 'import rospy, rdflib, skiros2_skill, skiros2_std_skills' && "
        "command -v python3 pytest && deactivate && echo $PATH"
    )
    done = subprocess.run(["bash", "-c", script], env=env, capture_output=True, text=True, check=True)
    *found, after = done.stdout.splitlines()
    assert found == [f"{environment}/python3", f"{environment}/pytest"]
    assert environment not in after.split(":")
