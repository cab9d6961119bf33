"""Tutorials in every order: each after only those that it needs, and all in other orders than that of their numbers.

After each, the tests of the package that they make pass. Tutorial 17 is followed in a fresh environment with what
`pip install .` brings, and without ROS.
"""

from __future__ import annotations

import os
import random
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from support.newcomers import PAGES, Newcomer
from support.ros import ROOT, RosMaster
from support.tutorial import Reader, needs

WITHOUT_ROS = ROOT / "docs/tutorials/17_without_ros.md"
#: Of the other orders.
SEEDS = range(int(os.environ.get("ORDERS", "3")))


def follow_all(home: Path, master: RosMaster, pages: list[Path]) -> None:
    with Newcomer(home, master) as newcomer:
        for page in pages:
            newcomer.follow(page)
            newcomer.check_package()


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_tutorial_needs_no_more_than_it_says(ros_master: RosMaster, tmp_path: Path, page: Path) -> None:
    follow_all(tmp_path, ros_master, [*needs(page).all_pages(), page])


@pytest.mark.parametrize("seed", SEEDS)
def test_tutorials_may_be_followed_in_any_order(ros_master: RosMaster, tmp_path: Path, seed: int) -> None:
    order: list[Path] = []
    while len(order) < len(PAGES):
        ready = [page for page in PAGES if page not in order and set(needs(page).pages) <= set(order)]
        # the first order takes the last possible tutorial each time, the others any
        order.append(random.Random(f"{seed} {len(order)}").choice(ready) if seed else ready[-1])
    follow_all(tmp_path, ros_master, order)


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, str]]:
    """The environment of a shell with a fresh virtual environment in which `pip install .` was typed; without ROS."""
    folder = tmp_path_factory.mktemp("plain")
    clone = folder / "skiros2"
    subprocess.run(["git", "clone", "--quiet", str(ROOT), str(clone)], check=True)
    base = getattr(sys, "_base_executable", sys.executable)
    subprocess.run([base, "-m", "venv", str(folder / "venv")], check=True)
    kept = {name: os.environ[name] for name in os.environ if name.startswith(("PIP_", "SSL_", "LANG"))}
    path = f"{folder}/venv/bin:/usr/bin:/bin"
    env = {**kept, "PATH": path, "HOME": str(folder), "TERM": "dumb", "VIRTUAL_ENV": str(folder / "venv")}
    done = subprocess.run(["pip", "install", "--quiet", "."], cwd=clone, env=env, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    yield env


def test_environment_of_pip_has_no_ros(plain: dict[str, str]) -> None:
    for module in ("rospy", "rosgraph", "actionlib", "skiros2_msgs", "rospkg"):
        script = f"import {module}"
        done = subprocess.run(["python3", "-c", script], env=plain, capture_output=True, text=True)
        assert "ModuleNotFoundError" in done.stderr, module


def test_tour_ends_as_expected_with_commands_that_work(plain: dict[str, str], tmp_path: Path) -> None:
    env = {**plain, "HOME": str(tmp_path)}
    done = subprocess.run(["skiros2", "try"], env=env, cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    commands = [line.partition("  # ")[0] for line in done.stdout.partition("\nnext:\n")[2].splitlines()]
    assert len(commands) == 3
    for command in commands:
        subprocess.run(["bash", "-c", command], env=env, cwd=tmp_path, check=True)


def test_tutorial_without_ros_shows_what_happens(plain: dict[str, str], tmp_path: Path) -> None:
    with Reader(tmp_path, {**plain, "HOME": str(tmp_path)}) as reader:
        reader.follow(WITHOUT_ROS)
    done = subprocess.run(
        ["skiros2", "test", "-q"], cwd=tmp_path / "my_skills", env={**plain, "HOME": str(tmp_path)},
        capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
