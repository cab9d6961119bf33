"""`rosrun skiros2_skill lint` without a master and a world model, as in CI."""

from __future__ import annotations

import json
import os
import subprocess
from pathlib import Path

from support.ros import install_environment, run_command

LIBRARIES = Path(__file__).parents[1] / "libraries"


def lint(*arguments: str) -> subprocess.CompletedProcess[str]:
    env = install_environment()
    env["PYTHONPATH"] = os.pathsep.join([str(LIBRARIES), env["PYTHONPATH"]])
    env["ROS_MASTER_URI"] = "http://127.0.0.1:1"  # where nobody is
    command = ["rosrun", "skiros2_skill", "lint", *arguments]
    return run_command(command, env, LIBRARIES)


def test_the_installed_libraries_have_no_faults() -> None:
    done = lint("skiros2_demo_skills", "skiros2_std_skills")
    assert (done.stdout, done.stderr, done.returncode) == ("0 errors, 0 warnings\n", "", 0)


def test_faults_have_a_relative_file_and_line() -> None:
    done = lint("faulty_skills")
    assert done.returncode == 1
    *lines, summary = done.stdout.splitlines()
    assert summary.startswith("5 errors, 31 warnings")
    assert len(lines) == 36
    assert all(line.startswith("faulty_skills/") for line in lines)


def test_findings_as_json() -> None:
    findings = json.loads(lint("faulty_skills", "--json").stdout)
    assert {"severity", "code", "skill", "text", "file", "line", "done"} == set(findings[0])


def test_missing_package_is_a_usage_error() -> None:
    done = lint("nobodys_skills")
    assert done.returncode == 2
    assert done.stderr.startswith("lint: library 'nobodys_skills': there is no Python package of that name; near: ")
