"""The frame of command lines."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from skiros2_common.command_line.command import CommandResult, run_command

PRINTING = """
import sys
from skiros2_common.command_line.command import end, run_command

def work():
    print("x" * 100_000, flush=True)

end(run_command("printing", work, False))
"""


def test_broken_pipe_of_the_work_is_not_taken_for_a_closed_stdout() -> None:
    def work() -> CommandResult:
        raise BrokenPipeError("the engine has died")

    with pytest.raises(BrokenPipeError, match="the engine has died"):
        run_command("plan", work, False)


def test_command_ends_well_when_the_reader_of_its_output_has_gone() -> None:
    reading, writing = os.pipe()
    os.close(reading)
    env = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    done = subprocess.run([sys.executable, "-c", PRINTING], env=env, stdout=writing, stderr=subprocess.PIPE, text=True)
    os.close(writing)
    assert (done.returncode, done.stderr) == (0, "")
