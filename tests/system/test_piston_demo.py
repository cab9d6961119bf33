"""The demo of the piston cell, as `make demo DEMO=piston` runs it."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from support.programs import Program
from support.ros import install_environment

#: What is true at the end, in the bag and in the simulated world.
PROOF = (
    "at the end: Piston is in Bore 2",
    r"Piston is (59|60)\.\d mm deep in Bore 2",
    "it is tilted by 0",
    "the largest force",
)


@pytest.fixture
def demo(tmp_path: Path, request: pytest.FixtureRequest) -> Iterator[Program]:
    """A run of the demo, with further arguments in `request.param`."""
    environment = {**install_environment(), "HOME": str(tmp_path)}
    environment.pop("ROS_MASTER_URI", None)
    command = ["rosrun", "skiros2_contact_skills", "piston_demo", "--seed", "1", "--folder", str(tmp_path / "demo")]
    command += getattr(request, "param", [])
    program = Program(command, environment, cwd=tmp_path)
    yield program
    program.stop()


@pytest.mark.long
@pytest.mark.timeout(600)
def test_two_arms_insert_the_piston_of_a_displaced_block(demo: Program, tmp_path: Path) -> None:
    status = demo.wait(580)
    assert status == 0, demo.output
    for words in PROOF:
        assert re.search(rf"^  ✓ {words}", demo.output, re.MULTILINE), f"not proven: {words}\n{demo.output}"
    assert "1. take_part" in demo.output and "3. insert_piston" in demo.output
    assert (tmp_path / "demo" / "force_over_depth.png").exists()


@pytest.mark.long
@pytest.mark.parametrize("demo", [["--disturb", "force"]], indirect=True)
@pytest.mark.timeout(600)
def test_goal_ends_at_the_force_limit_until_a_person_sends_it_again(demo: Program) -> None:
    status = demo.wait(580)
    assert status == 0, demo.output
    limit = "No other plan is made, because a limit was exceeded: check the robot, then send the goal again."
    assert demo.output.count("The goal has ended after") == 1
    assert limit in demo.output
    assert "New plan" not in demo.output
    for words in (*PROOF, "the goal ended at the limit until a person sent it again"):
        assert re.search(rf"^  ✓ {words}", demo.output, re.MULTILINE), f"not proven: {words}\n{demo.output}"
