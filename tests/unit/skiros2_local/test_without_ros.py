"""The sources work with what `pip install .` brings, and nothing of ROS: tutorial 17, typed in such processes."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from support.ros import ROOT
from support.setups import PIP, link_packages
from support.source import PACKAGES
from support.tutorial import Reader, needs

PAGE = ROOT / "docs/tutorials/17_without_ros.md"
#: As pip writes it; the sources stand in for the installed packages.
PROGRAM = "import sys\nfrom skiros2_local.command import run\nif __name__ == '__main__':\n    sys.exit(run())\n"
pytestmark = pytest.mark.timeout(180)


@pytest.fixture(scope="module")
def env(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """The environment of a shell with the programs `skiros2` and `python3`, which find no other packages."""
    folder = tmp_path_factory.mktemp("plain")
    link_packages(PIP, folder / "site-packages")
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


def test_tutorial_shows_what_happens(env: dict[str, str], tmp_path: Path) -> None:
    assert needs(PAGE).setup == PIP
    with Reader(tmp_path, {**env, "HOME": str(tmp_path)}) as reader:
        reader.follow(PAGE)
