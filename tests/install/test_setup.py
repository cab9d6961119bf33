"""A set-up that cannot get what it needs says in one line what that is, and leaves nothing half-done."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import pytest

from support.ros import ROOT

NO_INDEX = {"PIP_CONFIG_FILE": "/dev/null", "PIP_INDEX_URL": "http://127.0.0.1:9/simple", "PIP_EXTRA_INDEX_URL": ""}


@pytest.fixture
def clone(tmp_path: Path) -> Path:
    folder = tmp_path / "clone"
    subprocess.run(["git", "clone", "--quiet", str(ROOT), str(folder)], check=True)
    return folder


@pytest.fixture
def commands(tmp_path: Path) -> Path:
    """A folder in front of PATH, for commands that stand in for the system's."""
    folder = tmp_path / "bin"
    folder.mkdir()
    return folder


def stand_in(folder: Path, name: str, script: str) -> None:
    (folder / name).write_text(f"#!/bin/sh\n{script}\n")
    (folder / name).chmod(0o755)


def set_up(clone: Path, commands: Path, **env: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [clone / ".ci/setup"],
        env={**os.environ, **env, "PATH": f"{commands}:{os.environ['PATH']}"},
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        check=False,
    )


def test_without_debians_archive_the_packages_are_named_and_none_is_installed(clone: Path, commands: Path) -> None:
    calls = clone / "calls"
    stand_in(commands, "dpkg-query", "true")  # nothing is installed
    stand_in(commands, "sudo", '[ "$1 $2" = "-n true" ] || exec "$@"')
    refused = "Err:7 http://deb.debian.org/debian bookworm/main amd64 catkin all 0.8.10-9"
    stand_in(commands, "apt-get", f'echo "$@" >>"{calls}"; case "$*" in *install*) echo "{refused}"; exit 100 ;; esac')
    done = set_up(clone, commands)
    assert done.returncode != 0
    assert len(done.stderr.splitlines()) == 1
    assert "catkin (no network" in done.stderr
    installs = [call for call in calls.read_text().splitlines() if " install " in call]
    assert installs
    assert all("--download-only" in call for call in installs)
    assert not (clone / ".venv").exists()


def test_who_is_neither_root_nor_has_sudo_is_told_what_root_has_to_do(clone: Path, commands: Path) -> None:
    stand_in(commands, "dpkg-query", "true")
    stand_in(commands, "id", "echo 1000")
    stand_in(commands, "sudo", "exit 1")
    done = set_up(clone, commands)
    assert done.returncode != 0
    assert len(done.stderr.splitlines()) == 1
    assert "neither root nor sudo" in done.stderr
    assert "python3-rospy" in done.stderr


def test_without_the_python_index_the_package_is_named_and_no_environment_is_left(clone: Path, commands: Path) -> None:
    done = set_up(clone, commands, **NO_INDEX)
    assert done.returncode != 0
    assert len(done.stderr.splitlines()) == 1
    assert "could not fetch the Python package rdflib==" in done.stderr
    assert not (clone / ".venv").exists()


def test_an_environment_that_cannot_be_renewed_stays_as_it_was(clone: Path, commands: Path) -> None:
    environment = clone / ".venv"
    environment.mkdir()
    (environment / "requirements.sha256").write_text("of other requirements")
    done = set_up(clone, commands, **NO_INDEX)
    assert done.returncode != 0
    assert (environment / "requirements.sha256").read_text() == "of other requirements"
