"""A learned configuration in production: applied, taken by the skill, proven from the bag and the simulator."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from support.ros import ROOT


@pytest.mark.long
@pytest.mark.timeout(300)
def test_the_applied_configuration_brings_the_block_to_the_goal(tmp_path: Path) -> None:
    path = os.pathsep.join([str(ROOT / "tests"), os.environ.get("PYTHONPATH", "")])
    run = subprocess.run(
        [sys.executable, "-m", "support.produce_push", str(tmp_path)],
        env={**os.environ, "PYTHONPATH": path}, capture_output=True, text=True, timeout=280,
    )  # fmt: skip
    assert run.returncode == 0, run.stdout + run.stderr
    assert run.stdout.count("yes ") == 4
