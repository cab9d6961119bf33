"""Node programs that are interrupted while they start."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from support.packages import ROOT, source_folders

PROGRAMS = sorted(program for package in source_folders() for program in package.parent.glob("nodes/*_node"))


@pytest.mark.parametrize("program", PROGRAMS, ids=lambda program: program.name)
def test_program_that_is_interrupted_during_its_imports_ends_without_a_traceback(program: Path, tmp_path: Path) -> None:
    (tmp_path / "rospy.py").write_text("import time\nprint('importing', flush=True)\ntime.sleep(100)\n")
    (tmp_path / "rosgraph.py").write_text("import rospy\n")
    env = {**os.environ, "PYTHONPATH": os.pathsep.join(map(str, [tmp_path, *source_folders()]))}
    command = [sys.executable, str(program)]
    pipe = subprocess.PIPE
    with subprocess.Popen(command, cwd=ROOT, env=env, stdout=pipe, stderr=pipe, text=True) as node:
        assert node.stdout is not None and node.stdout.readline() == "importing\n"
        node.send_signal(signal.SIGINT)
        _, errors = node.communicate()
    assert (node.returncode, errors) == (-signal.SIGINT, "")
