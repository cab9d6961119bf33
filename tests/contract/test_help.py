"""Each command explains itself: `--help` ends well, in any of the packages."""

from __future__ import annotations

import runpy
import sys
from pathlib import Path

import pytest

from support.ros import ROOT

#: Nodes have no help: they are started by launch files.
PROGRAMS = sorted(
    path
    for pattern in ("skiros2/*/nodes/*", "skiros2_std_lib/*/nodes/*")
    for path in ROOT.glob(pattern)
    if path.is_file() and not path.name.endswith("_node")
)


@pytest.mark.parametrize("program", PROGRAMS, ids=lambda path: f"{path.parts[-3]}/{path.name}")
def test_help_shows_usage_and_what_the_command_does(
    program: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", [str(program), "--help"])
    with pytest.raises(SystemExit) as end:
        runpy.run_path(str(program), run_name="__main__")
    shown = capsys.readouterr().out
    assert end.value.code in (0, None)
    assert shown.startswith("usage: ")
    assert len(shown.split("\n\n")) > 1, shown
