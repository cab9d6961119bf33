"""Programs of others run on Debian's own Python, which has ROS but none of the packages from requirements/."""

import os
import subprocess
import sys

import pytest

from support.ros import ROOT

MODULES = sorted(
    line.removeprefix("module ").strip()
    for line in (ROOT / "tests/contract/public_api.txt").read_text().splitlines()
    if line.startswith("module ")
)


@pytest.mark.parametrize("module", [*sorted(set(MODULES)), "skiros2_skill.testing"])
def test_public_module_imports_with_debian_packages_only(module: str) -> None:
    folders = [path for path in sys.path if path.startswith(str(ROOT)) and "/.venv/" not in path]
    done = subprocess.run(
        ["/usr/bin/python3", "-c", f"import {module}"],
        env={**os.environ, "PYTHONPATH": ":".join(folders)},
        stderr=subprocess.PIPE,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
