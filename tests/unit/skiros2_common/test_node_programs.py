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


def test_collector_runs_in_a_node_but_not_during_its_imports() -> None:
    code = """
import gc
import skiros2_common.ros.quiet_start
assert not gc.isenabled()
from skiros2_common.ros import node
node.rosgraph.is_master_online = lambda: True
node.rospy.init_node = lambda *_, **__: None
node.rospy.get_param = lambda *_: False
node.watch_master = node.handshake_in_threads = lambda: None
node.run_node("tested", lambda: print(gc.isenabled(), gc.get_freeze_count() > 0))
"""
    env = {**os.environ, "PYTHONPATH": os.pathsep.join([*map(str, source_folders()), *sys.path])}
    ended = subprocess.run([sys.executable, "-c", code], cwd=ROOT, env=env, capture_output=True, text=True)
    assert ended.stdout == "True True\n", ended.stderr
