"""The demo of the connector cell, as `make demo DEMO=connector` runs it: one run, in which the plug slips once."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from support.programs import Program
from support.ros import install_environment

#: What is true at the end, in the bag and in the simulated world.
PROOF = (
    "at the end: Power plug is in Power socket",
    r"Power plug is (1[67]|18|19|20)\.\d mm deep in Power socket, after a pull: it is latched",
    "the largest force at the wrist was",
    "somebody pulls Power plug 6 mm out of the fingers",
    r"because plug_in .* no click: peak of",
)


@pytest.fixture
def demo(tmp_path: Path) -> Iterator[Program]:
    environment = {**install_environment(), "HOME": str(tmp_path)}
    environment.pop("ROS_MASTER_URI", None)
    command = ["rosrun", "skiros2_connector_demo", "connector_demo", "--no-pictures"]
    program = Program([*command, "--folder", str(tmp_path / "demo")], environment, cwd=tmp_path)
    yield program
    program.stop()


@pytest.mark.long
@pytest.mark.timeout(600)
def test_two_arms_plug_in_a_connector_that_latches(demo: Program, tmp_path: Path) -> None:
    status = demo.wait(580)
    assert status == 0, demo.output
    for words in PROOF:
        assert re.search(rf"^  ✓ {words}", demo.output, re.MULTILINE), f"not proven: {words}\n{demo.output}"
    assert "1. take_part" in demo.output and "3. connect_plug" in demo.output
    assert "did: take_part, take_part, connect_plug (failed), take_part, connect_plug" in demo.output
    assert (tmp_path / "demo" / "force_over_depth.png").exists()
