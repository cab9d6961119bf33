"""The commands of the section "The services by hand" in docs/world_model.md, with their output."""

from __future__ import annotations

import doctest
import re
from pathlib import Path

import pytest

from skiros2_msgs import srv as srvs
from support.ros import Ros

pytestmark = pytest.mark.timeout(240)

DOCUMENT = Path(__file__).resolve().parents[2] / "docs/world_model.md"
OPTIONS = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE


def code() -> list[str]:
    text = DOCUMENT.read_text().split("## The services by hand\n")[1]
    section = re.split(r"^## ", text, flags=re.MULTILINE)[0]
    return re.findall(r"^```\n(.*?)^```", section, re.MULTILINE | re.DOTALL)


@pytest.mark.long
def test_services_return_the_documented_results(ros: Ros, tmp_path: Path) -> None:
    start, *blocks = code()
    _, package, file, *arguments = start.split()
    given = dict(argument.split(":=") for argument in arguments)
    ros.launch(package, file, workspace_dir=str(tmp_path), **given)
    ros.service("/wm/ontology/query", srvs.WoQuery)
    for block in blocks:
        for command, wanted in re.findall(r"^\$ (.*)\n((?:(?!\$ ).*\n)*)", block, re.MULTILINE):
            program = ros.program("bash", "-c", command)
            program.wait(60.0)
            printed = program.output + "\n"
            assert doctest.OutputChecker().check_output(wanted, printed, OPTIONS), f"{command}\n\ngot:\n{printed}"
