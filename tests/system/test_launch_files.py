"""How the launch files start nodes: what ends a launch, what is started anew, and where output is shown."""

from __future__ import annotations

import os
import signal
from pathlib import Path
from typing import Any

import pytest

from support.programs import Program
from support.ros import INSTALL, Ros, wait_until

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


def launch(ros: Ros, package: Path, deploy: bool = True, env: dict[str, str] | None = None, **nodes: str) -> Program:
    """Launches shell scripts as nodes, in the way the project's launch files start theirs."""
    tags = ""
    for name, script in nodes.items():
        program = package / name
        program.write_text(f"#!/bin/bash\n{script}\n")
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


def test_a_node_that_finds_a_mistake_in_the_configuration_ends_the_whole_launch(ros: Ros, package: Path) -> None:
    program = launch(ros, package, good="exec sleep 100", bad="echo 'no such scene: x.ttl' >&2; exit 78")
    program.wait()
    assert program.output.count("no such scene: x.ttl") == 1
    assert "restarting process" not in program.output


def test_a_node_that_crashes_is_started_anew(ros: Ros, package: Path) -> None:
    program = launch(ros, package, one="echo run $$; exec sleep 100")
    first = int(program.wait_for_line(r"^run (\d+)")[1])
    os.kill(first, signal.SIGKILL)
    second = int(program.wait_for_line(rf"^run (?!{first}\b)(\d+)")[1])
    assert second != first


def test_at_the_end_of_a_launch_a_node_has_the_time_to_clean_up(ros: Ros, package: Path) -> None:
    cleans_up = "trap 'sleep 0.3; echo cleaned up; exit' INT; echo up; while :; do sleep 0.1; done"
    program = launch(ros, package, one=cleans_up)
    program.wait_for_line("^up")
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


def test_without_deploy_a_node_shows_its_output_in_a_window_of_its_own(
    ros: Ros, package: Path, xterm: dict[str, str], tmp_path: Path
) -> None:
    program = launch(ros, package, deploy=False, env=xterm, talker="echo words; exec sleep 100")
    window = tmp_path / "talker.window"
    wait_until(lambda: window.exists() and "words" in window.read_text(), what="the node's words in its window")
    assert "words" not in program.output


def test_a_mistake_in_the_configuration_is_shown_where_the_launch_was_started(
    ros: Ros, package: Path, xterm: dict[str, str]
) -> None:
    program = launch(ros, package, deploy=False, env=xterm, bad="echo 'no such scene: x.ttl' >&2; exit 78")
    program.wait()
    assert "no such scene: x.ttl" in program.output


def test_without_deploy_and_without_display_the_output_stays_on_the_screen(ros: Ros, package: Path) -> None:
    program = launch(ros, package, deploy=False, env={"DISPLAY": ""}, talker="echo words; exec sleep 100")
    program.wait_for_line("^words")


@pytest.mark.parametrize(
    ("arguments", "culprit"),
    [
        ({"init_scene": "no_such_scene.ttl"}, "no_such_scene.ttl: cannot be read"),
        ({"workspace_dir": "{folder}", "init_scene": "broken.ttl"}, "broken.ttl, line 2: expected Turtle"),
        ({"workspace_dir": "/no/such/folder"}, "/no/such/folder: there is no such folder"),
        ({"memory_contexts": ["memory no_such_file.ttl"]}, "no_such_file.ttl: cannot be read"),
        ({"libraries_list": ["no_such_library"]}, "library 'no_such_library'"),
        ({"libraries_list": ["skiros2_std_skills"], "primitive_list": ["no_such_skill"]}, "skill 'no_such_skill'"),
        ({"libraries_list": ["skiros2_std_skills"], "skill_list": ["no_such_skill"]}, "skill 'no_such_skill'"),
    ],
    ids=["scene", "Turtle", "workspace", "context", "library", "primitive", "skill"],
)
def test_a_launch_that_names_what_is_not_there_says_so_and_starts_nothing(
    ros: Ros, tmp_path: Path, arguments: dict[str, Any], culprit: str
) -> None:
    (tmp_path / "broken.ttl").write_text("@prefix a: <urn:a#> .\na:b broken .\n")
    if arguments.get("workspace_dir") == "{folder}":
        arguments = {**arguments, "workspace_dir": tmp_path}
    program = ros.launch("skiros2", "skiros.launch", gui=False, **arguments)
    assert program.wait() == 1
    assert program.output.count(culprit) == 1
    assert "process[" not in program.output


def test_without_a_display_the_launch_says_so_in_one_line_and_goes_on(ros: Ros) -> None:
    without = {key: value for key, value in ros.master.env.items() if key not in ("DISPLAY", "QT_QPA_PLATFORM")}
    window = ros.program("rosrun", "skiros2_gui", "skiros_gui", "--launched", env=without)
    window.wait_for_line("there is no display to open the window on")
    assert window.running
