"""The command `skiros2` in a cell: each command finds it as the one before has left it, and nothing runs in between."""

from __future__ import annotations

import json
import os
import signal
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import pytest

from skiros2_local import command
from support.programs import Program

BOLT, SHELF = "skiros:Product-5", "my_skills:Shelf-3"
INSPECTED = f"(my_skills:Inspected {BOLT})"
#: Another robot of the scene.
SECOND = """
skiros:Scene-0 skiros:contain cora:Robot-8 .
cora:Robot-8 a owl:NamedIndividual, cora:Robot ;
    rdfs:label "my_skills:second" ; skiros:hasStartLocation skiros:Location-2 ; skiros:at skiros:Location-2 .
"""
pytestmark = pytest.mark.timeout(120)


class Printed(NamedTuple):
    """What a command printed, and its exit status."""

    status: int
    out: str
    err: str

    @property
    def lines(self) -> list[str]:
        return self.out.splitlines()


Run = Callable[..., Printed]


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A package made by `skiros2 new --no-ros`, whose skills take no time; the working directory."""
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    monkeypatch.setattr(sys, "path", [*sys.path])
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit):
        command.main(["new", "my_skills", "--no-ros"])
    code = tmp_path / "my_skills/src/my_skills/primitives.py"
    code.write_text(code.read_text().replace("2.0", "0.05"))
    monkeypatch.chdir(tmp_path / "my_skills")
    yield tmp_path / "my_skills"
    for name in [name for name in sys.modules if name.partition(".")[0] == "my_skills"]:
        del sys.modules[name]


@pytest.fixture
def run(package: Path, capsys: pytest.CaptureFixture[str]) -> Run:
    def run(*arguments: str) -> Printed:
        capsys.readouterr()
        try:
            status = command.main(arguments)
        except SystemExit as ended:
            status = int(ended.code or 0)
        return Printed(status, *capsys.readouterr())

    return run


def test_package_has_no_faults_and_passes_its_tests(package: Path, run: Run) -> None:
    assert run("lint", "my_skills").lines == ["0 errors, 0 warnings"]
    for what, name in (("skill", "weigh"), ("reasoner", "mass"), ("scene", "lab")):
        assert run("new", what, name).status == 0
    assert run("lint", "my_skills").lines == ["0 errors, 0 warnings"]
    assert not list(package.glob("**/*.launch"))
    assert "rosrun" not in (package / "README.md").read_text().partition("With ROS")[0]


def test_ros_parts_are_added_later(package: Path, run: Run) -> None:
    assert run("new", "ros", "my_cell").status == 0
    assert "$(find my_skills)/owl" in (package / "launch/my_cell.launch").read_text()
    names = ("package.xml", "CMakeLists.txt", "setup.py", "src/my_skills/action_primitives.py")
    assert [name for name in names if not (package / name).is_file()] == []


def test_skills_are_run_in_sequence_and_the_next_command_finds_their_effects(run: Run) -> None:
    done = run("run", "drive", "TargetLocation=Shelf A", "inspect", "Object=Bolt 1")
    assert done.status == 0, done
    assert done.lines[0] == "task 0 on /my_robot"
    assert '  Location = my_skills:Shelf-3 "Shelf A"' in done.lines
    assert run("get", BOLT, "my_skills:Inspected").lines == ["True"]
    assert run("get", "cora:Robot-1", "skiros:at").lines == [SHELF]
    assert run("achieve", INSPECTED).lines[-1] == "the goal holds already"


def test_goal_is_planned_and_achieved(run: Run) -> None:
    planned = json.loads(run("plan", INSPECTED, "--json").out)
    assert [step["label"] for step in planned["steps"]] == ["drive", "inspect"]
    explained = run("explain", INSPECTED)
    assert explained.status == 0
    done = run("achieve", INSPECTED)
    assert done.status == 0, done
    assert "✓ 2 inspect by /my_robot" in done.out
    assert done.lines[-1].startswith("the goal is reached after")
    assert run("plan", INSPECTED).lines == ["the goal holds already"]


def test_goal_that_no_skill_reaches_says_why(run: Run) -> None:
    refused = run("achieve", "(skiros:Weight skiros:Product-5)")
    assert refused.status == 1
    assert "the goal is not reached" in refused.out
    assert run("plan", "(my_skills:Inspectd skiros:Product-5)").status == 1


def test_failed_task_is_explained_by_a_later_command(run: Run) -> None:
    assert run("why").err == "why: no task has failed or was refused\n"
    failed = run("run", "inspect", "Object=Bolt 1")
    assert failed.status == 1
    assert "RobotAtLocation" in failed.out
    assert run("run", "drive", "TargetLocation=Shelf A").lines[0] == "task 1 on /my_robot"
    later = run("why")
    assert later.lines[0].startswith("inspect did not start: for Location, ")
    assert "task 0 by " in later.out
    assert "RobotAtLocation" in later.out
    assert "has succeeded" in run("why", "1").out
    refused = run("run", "take_picture", "Object=Bolt 1", "Exposure=-1")
    assert refused.status == 1
    assert "Exposure" in refused.err


def test_records_that_cannot_be_read_are_reported(package: Path, run: Run) -> None:
    run("run", "inspect", "Object=Bolt 1")
    (file,) = (package.parent / "home/.skiros2/cells").glob("*/tasks.json")
    file.write_text('{"/my_robot": [{}]}')
    printed = run("why")
    assert "tasks.json cannot be read" in printed.err
    assert "no task has failed" in printed.err


def test_changes_have_authors_and_a_load_starts_again(run: Run) -> None:
    assert run("set", BOLT, "skiros:Weight", "0.2", "--author", "mary").status == 0
    run("run", "drive", "TargetLocation=Shelf A")
    history = run("history").out
    assert " mary " in history
    assert " /my_robot " in history
    assert "Drive" not in history  # the skills are no part of the scene
    assert run("load").status == 0
    assert run("get", "cora:Robot-1", "skiros:at").lines == ["skiros:Location-2"]
    assert "skiros:Weight" not in run("get", BOLT).out


def test_saved_scene_has_the_changes_and_no_skills(package: Path, run: Run) -> None:
    run("set", BOLT, "skiros:Weight", "0.2")
    run("run", "drive", "TargetLocation=Shelf A")
    assert run("save", "later.ttl").status == 0
    saved = (package / "owl/later.ttl").read_text()
    assert "skiros:Weight" in saved
    assert "hasSkill" not in saved
    assert run("validate", "owl/later.ttl").status == 0


def test_changed_scene_file_starts_again(package: Path, run: Run) -> None:
    run("run", "inspect", "Object=Bolt 1")
    run("set", BOLT, "skiros:Weight", "0.2")
    scene = package / "owl/scene.ttl"
    scene.write_text(scene.read_text().replace("Bolt 2", "Bolt 3"))
    printed = run("view")
    assert "has changed: the cell starts again" in printed.err
    assert "Bolt 3" in printed.out
    assert "skiros:Weight" not in run("get", BOLT).out
    assert run("why").status == 1


def test_scene_and_libraries_are_named_from_elsewhere(
    package: Path, run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert run("view").status == 0  # the only scene of a package in this folder
    assert run("lint", "my_skills").status == 0
    (tmp_path / "empty").mkdir()
    monkeypatch.chdir(tmp_path / "empty")
    assert "name a scene with --scene" in run("view").err
    scene = str(package / "owl/scene.ttl")
    named = ("--scene", scene, "--libraries", "my_skills", "--skills", "drive")
    assert [line.split()[0] for line in run("list", *named).lines[2:]] == ["drive"]
    assert run("plan", INSPECTED, *named).status == 1
    assert "there is no such file" in run("view", "--scene", "nowhere.ttl").err
    assert "'dirve': no class of that name" in run("list", "--scene", scene, "--skills", "dirve").err


def test_one_of_several_robots_is_named(package: Path, run: Run) -> None:
    with (package / "owl/scene.ttl").open("a") as scene:
        scene.write(SECOND)
    refused = run("run", "drive", "TargetLocation=Shelf A")
    assert refused.status == 2
    assert "there are 2 skill managers, /my_robot, /second: name one with --robot" in refused.err
    assert run("run", "--robot", "second", "drive", "TargetLocation=Shelf A").status == 0
    assert "the scene has no robot third" in run("list", "--robot", "third").err
    goal = f"(my_skills:Inspected {BOLT}), (my_skills:Inspected skiros:Product-6)"
    assert "of 2 robots" in run("plan", goal).lines[0]


def test_option_without_a_meaning_here_is_refused(run: Run) -> None:
    assert "needs ROS" in run("run", "--detach", "drive", "TargetLocation=Dock").err
    assert "a cell has one" in run("view", "--wm", "other").err


def test_unknown_commands_name_the_nearest(run: Run) -> None:
    for typed, meant in (("tyr", "'try'"), ("acheive", "'achieve'"), ("histroy", "'history'")):
        printed = run(typed)
        assert (printed.status, printed.out) == (2, "")
        assert f"did you mean {meant}?" in printed.err
    assert "rosrun skiros2_skill pause" in run("pause").err
    assert "achieve" in run("--help").out
    for name in ("run", "achieve", "plan", "view"):
        assert "--scene FILE" in run(name, "--help").out


# -- processes ---------------------------------------------------------------------------------------------------------


@pytest.fixture
def driving(package: Path) -> Iterator[Program]:
    """A command whose robot drives for a minute."""
    code = package / "src/my_skills/primitives.py"
    code.write_text(code.read_text().replace("0.05", "60.0"))
    start = "import sys; from skiros2_local.command import run; run()"
    env = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path), "PYTHONUNBUFFERED": "1"}
    words = [sys.executable, "-c", start, "run", "drive", "TargetLocation=Shelf A"]
    program = Program(words, env, package)
    program.wait_for_line("driving")
    yield program
    program.stop()


def test_interrupted_task_is_preempted_and_explained_later(driving: Program, run: Run) -> None:
    driving.interrupt()
    assert driving.wait() == 130
    assert "was preempted" in driving.output
    assert run("get", "cora:Robot-1", "skiros:at").lines == ["skiros:Location-2"]
    assert "preempted" in run("why").out.lower()


def test_others_read_the_cell_while_a_command_uses_it(
    driving: Program, run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("skiros2_common.core.file_lock._TIMEOUT", 0.1)
    assert run("view").status == 0
    assert run("plan", INSPECTED).status == 0
    refused = run("set", BOLT, "skiros:Weight", "0.2")
    assert refused.status == 3
    assert "another command uses the cell of owl/scene.ttl" in refused.err


def test_killed_command_leaves_the_cell_as_it_was(driving: Program, run: Run) -> None:
    driving.signal(signal.SIGKILL)
    driving.wait()
    assert run("set", BOLT, "skiros:Weight", "0.2").status == 0
    assert run("get", "cora:Robot-1", "skiros:at").lines == ["skiros:Location-2"]
