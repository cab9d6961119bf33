"""Checks that launch files call, and that people type, explain themselves."""

from __future__ import annotations

import runpy
import sys

import pytest

from support.ros import ROOT

#: Those that launch files call, and the check of a bag; tests of the other commands are beside their own.
PROGRAMS = (
    "skiros2/skiros2_world_model/nodes/check_world",
    "skiros2/skiros2_skill/nodes/check_skills",
    "skiros2_std_lib/skiros2_sim_skills/nodes/check_run",
)


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
