"""The sources work with what pip brings, and nothing of ROS: tutorials 17 and 19, typed in such processes."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from skiros2_common import __version__
from support.ros import ROOT
from support.setups import PIP, PIP_LEARNING, link_packages
from support.source import PACKAGES
from support.tutorial import Reader, needs

PAGE, LEARNING = (ROOT / f"docs/tutorials/{name}.md" for name in ("17_without_ros", "19_learning_without_ros"))
#: As pip writes it; the sources stand in for the installed packages.
PROGRAM = "import sys\nfrom skiros2_local.command import run\nif __name__ == '__main__':\n    sys.exit(run())\n"
pytestmark = pytest.mark.timeout(180)


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
def test_tutorial_of_learning_shows_what_happens(tmp_path: Path) -> None:
    assert needs(LEARNING).setup == PIP_LEARNING
    for module in ("pybullet", "optuna", "sklearn", "matplotlib"):
        pytest.importorskip(module, reason="needs requirements/sim.txt and learning.txt")
    env = {**environment(PIP_LEARNING, tmp_path / "plain"), "HOME": str(tmp_path)}
    with Reader(tmp_path, env) as reader:
        for page in (*needs(LEARNING).all_pages(), LEARNING):
            reader.follow(page)
    package = tmp_path / "my_skills"

    def learn(*words: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(["skiros2", "learn", *words], env=env, cwd=package, capture_output=True, text=True)

    (package / "push.yaml").write_text((package / "weigh.yaml").read_text().replace("Drive", "Push"))
    refused = learn("check", "push.yaml")
    assert refused.returncode == 1
    assert refused.stderr.endswith("; ROS is not installed: skills that use its actions or services are not there\n")
