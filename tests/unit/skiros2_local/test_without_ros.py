"""The sources work with what `pip install .` brings, and nothing of ROS: tutorial 17, typed in such processes."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from skiros2_common import __version__
from support.ros import ROOT
from support.setups import PIP, PIP_LEARNING, link_packages
from support.source import PACKAGES
from support.tutorial import Reader, needs

PAGE = ROOT / "docs/tutorials/17_without_ros.md"
#: As pip writes it; the sources stand in for the installed packages.
PROGRAM = "import sys\nfrom skiros2_local.command import run\nif __name__ == '__main__':\n    sys.exit(run())\n"
pytestmark = pytest.mark.timeout(180)


#: A study of the package that `skiros2 new` makes.
SCENARIO = """
scenario: exposure
scene: owl/scene.ttl
libraries: [my_skills]
task:
  - skill: Drive
    parameters: {TargetLocation: Shelf A}
  - skill: TakePicture
    parameters: {Object: Bolt 1}
variables:
  TakePicture.Exposure: {type: real, range: [1.0, 3.0], unit: s}
objectives:
  time: {sense: minimise, rewards: [{reward: time}]}
budget: {evaluations: 4, initial: 3}
repetitions: 1
seed: 1
"""


@pytest.fixture(scope="module")
def env(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    return environment(PIP, tmp_path_factory.mktemp("plain"))


def environment(setup: str, folder: Path) -> dict[str, str]:
    """The environment of a shell with the programs `skiros2` and `python3`, which find no other packages.

    :param setup: `PIP` or `PIP_LEARNING`.
    """
    link_packages(setup, folder / "site-packages")
    sources = [str(ROOT / source / "src") for source in PACKAGES.values()]
    path = ":".join([*sources, str(folder / "site-packages")])
    (folder / "skiros2.py").write_text(PROGRAM)
    # -sS: without Debian's packages and the user's
    for name, script in (("python3", ""), ("skiros2", f"{folder}/skiros2.py ")):
        program = folder / name
        program.write_text(f'#!/bin/sh\nPYTHONPATH={path} exec {os.path.realpath(sys.executable)} -sS {script}"$@"\n')
        program.chmod(0o755)
    return {"PATH": f"{folder}:/usr/bin:/bin", "LANG": "C.UTF-8", "TERM": "dumb", "PYTHONDONTWRITEBYTECODE": "1"}


def test_nothing_else_is_there(env: dict[str, str], tmp_path: Path) -> None:
    names = ("rospy", "rosgraph", "actionlib", "skiros2_msgs", "yaml", "optuna")
    script = f"from importlib.util import find_spec; print([name for name in {names} if find_spec(name)])"
    found = subprocess.check_output(["python3", "-c", script], env=env, cwd=tmp_path, text=True)
    assert found == "[]\n"


@pytest.mark.long
def test_tutorial_shows_what_happens(env: dict[str, str], tmp_path: Path) -> None:
    assert needs(PAGE).setup == PIP
    with Reader(tmp_path, {**env, "HOME": str(tmp_path)}) as reader:
        reader.follow(PAGE)


def test_version_is_told_by_the_program_and_its_commands(env: dict[str, str], tmp_path: Path) -> None:
    for command in ([], ["run"], ["achieve"], ["plan"], ["history"], ["new"], ["lint"]):
        words = ["skiros2", *command, "--version"]
        shown = subprocess.run(words, env=env, cwd=tmp_path, capture_output=True, text=True)
        assert (shown.stdout, shown.stderr, shown.returncode) == (f"SkiROS2 {__version__}\n", "", 0), command


def test_learning_names_the_extra_that_it_needs(env: dict[str, str], tmp_path: Path) -> None:
    done = subprocess.run(["skiros2", "learn", "--help"], env=env, cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 3
    assert done.stderr.count("\n") == 1
    assert done.stderr.endswith("; it needs: pip install 'skiros2[learning]'\n")


@pytest.mark.long
def test_parameter_is_learned_and_applied_to_the_cell(tmp_path: Path) -> None:
    for module in ("pybullet", "optuna", "sklearn", "matplotlib"):
        pytest.importorskip(module, reason="needs requirements/sim.txt and learning.txt")
    env = {**environment(PIP_LEARNING, tmp_path / "plain"), "HOME": str(tmp_path)}
    package = tmp_path / "my_skills"

    def run(*words: str, status: int = 0) -> str:
        folder = package if package.exists() else tmp_path
        done = subprocess.run(["skiros2", *words], env=env, cwd=folder, capture_output=True, text=True)
        assert done.returncode == status, done.stdout + done.stderr
        return done.stdout + done.stderr

    run("new", "my_skills", "--no-ros")
    (package / "exposure.yaml").write_text(SCENARIO)
    learned = run("learn", "run", "exposure.yaml", "--study", "study", "--workers", "1", "--no-validation")
    best = re.search(r"^ +(\d+)  success 100%, time \S+; TakePicture.Exposure=(\S+)$", learned, re.M)
    assert best, learned
    applied = re.match(
        r"(skiros:ParameterSet-\d+): NOT validated: success 100%, ",
        run("learn", "apply", "study", best[1], "--unvalidated"),
    )
    assert applied
    shown = run("run", "drive", "TargetLocation=Shelf A", "take_picture", "Object=Bolt 1")
    begin, end = (float(time) for time in re.findall(r"^ +(\S+) s  [▶✓] take_picture", shown, re.M))
    assert abs(end - begin - float(best[2])) < 0.25  # s; by default 0.5
    assert run("learn", "remove", applied[1]) == f"{applied[1]} is removed\n"
    (package / "exposure.yaml").write_text(SCENARIO.replace("Drive", "Push"))
    refused = run("learn", "check", "exposure.yaml", status=1)
    assert refused.endswith("; ROS is not installed: skills that use its actions or services are not there\n")
