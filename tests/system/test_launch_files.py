"""Launch files: errors that end a launch, restarts, and the output of nodes."""

from __future__ import annotations

import contextlib
import os
import signal
import socket
import sys
from pathlib import Path
from typing import Any

import pytest
import rosgraph

from skiros2_common.core.world_element import Element
from skiros2_world_model.ros.world_model_interface import WorldModelInterface
from support.programs import Program
from support.ros import INSTALL, Ros, wait_until
from support.window.display import Display

NODE_SH = INSTALL / "share/skiros2/launch/node.sh"


@pytest.fixture
def package(tmp_path: Path) -> Path:
    """A ROS package `some_package` with the executables that a test writes into it."""
    folder = tmp_path / "some_package"
    folder.mkdir()
    (folder / "package.xml").write_text(
        "<package format='2'><name>some_package</name><version>0.0.1</version><description>-</description>"
        "<maintainer email='a@example.org'>a</maintainer><license>-</license></package>"
    )
    return folder


#: A node with a mistake in its configuration.
BAD = f"""#!{sys.executable}
from skiros2_common.core.errors import ConfigurationError
from skiros2_common.ros.node import run_node

def main():
    raise ConfigurationError("no such scene: x.ttl")

run_node("bad", main)
"""


def launch(ros: Ros, package: Path, deploy: bool = True, env: dict[str, str] | None = None, **nodes: str) -> Program:
    """Launches shell scripts as nodes, in the way the project's launch files start theirs."""
    tags = ""
    for name, script in nodes.items():
        program = package / name
        program.write_text(script if script.startswith("#!") else f"#!/bin/bash\n{script}\n")
        program.chmod(0o755)
        tags += (
            f'<node name="{name}" pkg="some_package" type="{name}" respawn="true" output="screen" '
            f"launch-prefix=\"'{NODE_SH}' {str(deploy).lower()}\"/>\n"
        )
    file = package / "all.launch"
    file.write_text(f"<launch>\n{tags}</launch>\n")
    environment = {**ros.master.env, **(env or {})}
    environment["ROS_PACKAGE_PATH"] += f":{package.parent}"
    return ros.launch_file(file, env=environment)


def roslaunch(ros: Ros, package: str, file: str, **arguments: Any) -> Program:
    """Launches with the real roslaunch, not a fork."""
    return ros.launch(package, file, forked=False, **arguments)


def test_configuration_error_of_a_node_ends_the_launch(ros: Ros, package: Path) -> None:
    program = launch(ros, package, good="exec sleep 100", bad=BAD)
    program.wait()
    assert program.output.splitlines()[-1] == "/bad: no such scene: x.ttl"
    assert program.output.count("no such scene: x.ttl") == 2
    assert "restarting process" not in program.output


def test_crashed_node_is_restarted(ros: Ros, package: Path) -> None:
    program = launch(ros, package, one="echo run $$; exec sleep 100")
    first = int(program.wait_for_line(r"run (\d+)$")[1])
    os.kill(first, signal.SIGKILL)
    second = int(program.wait_for_line(rf"run (?!{first}\b)(\d+)$")[1])
    assert second != first


def pid_of(program: Program, node: str) -> int:
    """The process that roslaunch names."""
    return int(program.wait_for_line(rf"process\[{node}-\d+\]: started with pid \[(\d+)\]")[1])


@pytest.mark.parametrize("deploy", [True, False])
def test_process_that_roslaunch_names_is_the_node(
    ros: Ros, package: Path, xterm: dict[str, str], deploy: bool, tmp_path: Path
) -> None:
    program = launch(ros, package, deploy=deploy, env=xterm, one="echo run $$; exec sleep 100")
    pid = pid_of(program, "one")
    wait_until(lambda: f"run {pid}" in (program.output + read(tmp_path / "one.window")), what="the node's line")


def test_kill_of_the_named_process_loses_no_acknowledged_edit(ros: Ros) -> None:
    program = roslaunch(ros, "skiros2", "world_model_server.launch", gui=False, deploy=True)
    pid = pid_of(program, "wm")
    ros.wait_for_node("/wm")
    wm = WorldModelInterface("tester")
    part = Element("skiros:Part", "kept")
    wm.add_element(part)
    os.kill(pid, signal.SIGKILL)
    program.wait_for_line("the world model has recovered from its journal")
    assert WorldModelInterface("tester").get_element(part.id).label == "kept"
    assert not Path(f"/proc/{pid}").exists()


def test_launch_is_not_stopped_by_another_node_at_the_address_of_a_killed_one(ros: Ros) -> None:
    ros.run("skiros2_world_model", "world_model_server_node", name="other")
    wait_until(lambda: "/other/get_loggers" in ros.master.services(), what="the service of the other node")
    host, port = ros.master.service_address("/other/get_loggers")
    address = rosgraph.Master("/tests").lookupNode("/other")
    rosgraph.Master("/wm").registerService("/wm/get_loggers", f"rosrpc://{host}:{port}", address)
    program = roslaunch(ros, "skiros2", "world_model_server.launch", gui=False)
    program.wait_for_line("the world model is ready")
    assert "is already running" not in program.output


@pytest.mark.long
def test_second_launch_ends_with_one_sentence_and_disturbs_nothing(ros: Ros) -> None:
    first = roslaunch(ros, "skiros2", "skiros.launch", gui=False, deploy=True)
    nodes = {"/wm", "/tm", "/test_robot"}
    for node in nodes:
        ros.wait_for_node(node)
    pids = {node: ros.master.node_pid(node) for node in nodes}
    second = roslaunch(ros, "skiros2", "skiros.launch", gui=False, deploy=True)
    second.wait()
    runs = [line for line in second.output.splitlines() if "is already running" in line]
    assert len(runs) == 1
    assert second.output.splitlines()[-1] == runs[0]
    restarted = [line for line in second.output.splitlines() if "restarting process" in line]
    assert not any(node[1:] in line for node in nodes for line in restarted)
    assert "Traceback" not in second.output
    assert first.running
    assert {node: ros.master.node_pid(node) for node in nodes} == pids


@pytest.mark.parametrize(
    "setting", ["http_port", *(pytest.param(name, marks=pytest.mark.long) for name in ("stop_port", "opcua_port"))]
)
def test_launch_ends_with_one_sentence_if_a_port_is_taken(ros: Ros, setting: str, tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        ports = {"http_port": 0, setting: port}
        program = roslaunch(ros, "skiros2_gateway", "gateway.launch", folder=tmp_path, **ports)
        program.wait()
    lines = program.output.splitlines()
    assert lines[-1] == f"/gateway: {setting} {port} on 127.0.0.1: Address already in use"
    assert lines.count(lines[-1]) == 2  # where it happened, and at the end
    assert "restarting process" not in program.output
    assert "Traceback" not in program.output


@pytest.mark.long
def test_launch_of_a_robot_with_a_broken_scene_ends_with_file_line_and_column(ros: Ros, tmp_path: Path) -> None:
    (tmp_path / "broken.ttl").write_text("@prefix a: <urn:a#> .\na:b broken .\n")
    program = roslaunch(
        ros,
        "skiros2",
        "skiros.launch",
        gui=False,
        deploy=True,
        workspace_dir=tmp_path,
        init_scene="broken.ttl",
        robot_name="nobody",
    )
    program.wait()
    assert "the world model is ready with a blank scene: broken.ttl was refused" in program.output
    assert "ready: 1 elements" not in program.output
    last = program.output.splitlines()[-1]
    assert last.startswith(f"/nobody: {tmp_path}/broken.ttl, line 2, column 5: expected Turtle")
    assert last.endswith("; so the scene is blank, without this robot")


def read(file: Path) -> str:
    return file.read_text() if file.exists() else ""


def test_node_can_clean_up_at_the_end_of_a_launch(ros: Ros, package: Path) -> None:
    cleans_up = "trap 'sleep 0.3; echo cleaned up; exit' INT; echo up; while :; do sleep 0.1; done"
    program = launch(ros, package, one=cleans_up)
    program.wait_for_line("up$")  # without ^: it may follow what roslaunch is printing
    program.interrupt()
    assert program.wait() == 0
    assert "cleaned up" in program.output


@pytest.fixture
def xterm(tmp_path: Path) -> dict[str, str]:
    """An environment with a display and an `xterm` that writes its window's title and content to a file."""
    folder = tmp_path / "bin"
    folder.mkdir()
    program = folder / "xterm"
    program.write_text(f'#!/bin/bash\nexec >"{tmp_path}/$2.window" 2>&1\nshift 3\nexec "$@"\n')
    program.chmod(0o755)
    return {"PATH": f"{folder}:{os.environ['PATH']}", "DISPLAY": ":99"}


def test_without_deploy_a_node_has_its_own_output_window(
    ros: Ros, package: Path, xterm: dict[str, str], tmp_path: Path
) -> None:
    program = launch(ros, package, deploy=False, env=xterm, talker="echo words; exec sleep 100")
    window = tmp_path / "talker.window"
    wait_until(lambda: window.exists() and "words" in window.read_text(), what="the node's words in its window")
    assert "words" not in program.output


def test_configuration_error_is_printed_where_the_launch_was_started(
    ros: Ros, package: Path, xterm: dict[str, str]
) -> None:
    program = launch(ros, package, deploy=False, env=xterm, bad=BAD)
    program.wait()
    assert "no such scene: x.ttl" in program.output


def test_without_deploy_and_without_display_the_output_stays_on_the_screen(ros: Ros, package: Path) -> None:
    program = launch(ros, package, deploy=False, env={"DISPLAY": ""}, talker="echo words; exec sleep 100")
    program.wait_for_line("words$")


@pytest.mark.parametrize(
    ("arguments", "culprit"),
    [
        ({"workspace_dir": "/no/such/folder"}, "/no/such/folder: there is no such folder"),
        ({"libraries_list": ["no_such_library"]}, "library 'no_such_library'"),
        ({"libraries_list": ["skiros2_std_skills"], "primitive_list": ["no_such_skill"]}, "skill 'no_such_skill'"),
        ({"libraries_list": ["skiros2_std_skills"], "skill_list": ["no_such_skill"]}, "skill 'no_such_skill'"),
    ],
    ids=["workspace", "library", "primitive", "skill"],
)
def test_launch_with_unknown_names_fails_before_any_node_starts(
    ros: Ros, arguments: dict[str, Any], culprit: str
) -> None:
    program = roslaunch(ros, "skiros2", "skiros.launch", gui=False, **arguments)
    assert program.wait() == 1
    assert "process[" not in program.output
    lines = program.output.splitlines()
    assert culprit in lines[-1]
    assert lines.count(lines[-1]) == 2
    wait_until(lambda: not processes("launch_error", lines[-1]), what="the end of what printed the last line")


@pytest.mark.parametrize(
    ("scene", "culprit"),
    [
        ("no_such_scene.ttl", "no_such_scene.ttl: cannot be read"),
        ("broken.ttl", "broken.ttl, line 2, column 5: expected Turtle"),
    ],
)
def test_launch_with_an_unreadable_scene_warns_and_starts(ros: Ros, tmp_path: Path, scene: str, culprit: str) -> None:
    (tmp_path / "broken.ttl").write_text("@prefix a: <urn:a#> .\na:b broken .\n")
    program = roslaunch(
        ros, "skiros2", "world_model_server.launch", gui=False, deploy=True, workspace_dir=tmp_path, init_scene=scene
    )
    program.wait_for_line(f"WARNING: .*{culprit}")
    program.wait_for_line(f"ERROR.*{culprit}")
    program.wait_for_line("the world model is ready")


def test_reason_of_a_failed_launch_is_its_last_line(ros: Ros) -> None:
    program = roslaunch(ros, "skiros2", "task_mgr.launch", deploy=True, max_replans="many")
    program.wait()
    reason = "/tm: parameter /tm/max_replans is 'many', expected an integer from 0"
    lines = program.output.splitlines()
    assert lines[-1] == reason
    assert lines.count(reason) == 2


def test_check_outside_of_a_launch_prints_its_reason_once(ros: Ros) -> None:
    program = ros.program("rosrun", "skiros2_skill", "check_skills", "[no_such_library]", "[]")
    assert program.wait() == 1
    assert program.output.count("library 'no_such_library'") == 1


def processes(*words: str) -> list[str]:
    """The command lines of the running processes that have all of these words."""
    lines = []
    for entry in Path("/proc").glob("[0-9]*/cmdline"):
        with contextlib.suppress(OSError):
            lines.append(entry.read_bytes().replace(b"\0", b" ").decode(errors="replace"))
    return [line for line in lines if all(word in line for word in words)]


@pytest.mark.long
@pytest.mark.parametrize(
    ("file", "arguments", "nodes"),
    [
        ("skiros.launch", {"gui": False}, {"wm", "test_robot", "tm"}),
        ("world_model_server.launch", {"gui": False}, {"wm"}),
        ("skill_mgr.launch", {}, {"test_robot"}),
        ("task_mgr.launch", {}, {"tm"}),
    ],
)
def test_without_deploy_each_node_has_an_xterm(
    ros: Ros, tmp_path: Path, file: str, arguments: dict[str, Any], nodes: set[str]
) -> None:
    logs = tmp_path / "logs"
    with Display() as display:
        env = {**ros.master.env, **display.env, "ROS_LOG_DIR": str(logs)}
        program = roslaunch(ros, "skiros2", file, deploy=False, env=env, **arguments)

        def windows() -> set[str]:
            return {line.split()[2] for line in processes("xterm -T ", str(logs))}

        wait_until(lambda: windows() == nodes, what=f"windows of {nodes}")
        for node in nodes:
            ros.wait_for_node(f"/{node}")
        program.interrupt()
        assert program.wait() == 0
        wait_until(lambda: not windows(), what="the end of the windows")
    assert "cannot load font" not in program.output


def test_launch_without_a_display_warns_and_continues(ros: Ros) -> None:
    without = {key: value for key, value in ros.master.env.items() if key not in ("DISPLAY", "QT_QPA_PLATFORM")}
    window = ros.program("rosrun", "skiros2_gui", "skiros_gui", "--launched", env=without)
    window.wait_for_line("there is no display to open the window on")
    assert window.running
