"""Programs explain themselves, and tell their version."""

from __future__ import annotations

import runpy
import sys
import tomllib
import xml.etree.ElementTree as ET

import pytest

from skiros2_common import __version__
from support.packages import package_folders
from support.ros import ROOT

#: Those that launch files call, and the check of a bag; tests of the other commands are beside their own.
PROGRAMS = (
    "skiros2/skiros2_world_model/nodes/check_world",
    "skiros2/skiros2_skill/nodes/check_skills",
    "skiros2_std_lib/demos/pick_and_place/nodes/check_run",
)
#: All.
NODES = sorted(str(path.relative_to(ROOT)) for path in ROOT.glob("skiros2*/**/nodes/*") if path.is_file())


@pytest.mark.parametrize("program", PROGRAMS)
def test_help_shows_usage_and_what_the_command_does(
    program: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", [program, "--help"])
    with pytest.raises(SystemExit) as end:
        runpy.run_path(str(ROOT / program), run_name="__main__")
    shown = capsys.readouterr().out
    assert end.value.code in (0, None)
    assert shown.startswith("usage: ")
    assert len(shown.split("\n\n")) > 1, shown


@pytest.mark.parametrize("program", NODES)
def test_every_program_tells_its_version(
    program: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", [program, "--version"])
    try:
        runpy.run_path(str(ROOT / program), run_name="__main__")
    except SystemExit as end:
        assert end.code in (0, None)
    assert capsys.readouterr().out == f"SkiROS2 {__version__}\n"


def test_versions_agree() -> None:
    packages = [ROOT / folder / "package.xml" for folder in (".", *package_folders().values())]
    assert {ET.parse(path).findtext("version") for path in packages} == {__version__}
    assert tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"] == __version__
