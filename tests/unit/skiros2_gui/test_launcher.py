"""The window opened by `gui:=true`, and its launch node."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path

import pytest

from skiros2_gui.launcher import display_problem, missing_binding, rqt_command
from support.programs import Program
from support.ros import ROOT
from support.window.display import Display

NODE = ROOT / "skiros2_gui/nodes/skiros_gui"
COMMON = [str(ROOT / "skiros2/skiros2_common/src")]
DISPLAY_VARIABLES = ("DISPLAY", "WAYLAND_DISPLAY", "QT_QPA_PLATFORM")


@pytest.fixture
def rqt_modules(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "rqt_gui_py").mkdir()
    (tmp_path / "rqt_gui_py/__init__.py").touch()
    monkeypatch.syspath_prepend(str(tmp_path))


@pytest.fixture
def rqt_package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / "rqt_gui"
    folder.mkdir()
    (folder / "package.xml").write_text("<package><name>rqt_gui</name></package>")
    monkeypatch.setenv("ROS_PACKAGE_PATH", str(tmp_path))


def test_launcher_opens_plugin_if_rqt_is_installed(rqt_modules: None, rqt_package: None) -> None:
    assert rqt_command() == ["rosrun", "rqt_gui", "rqt_gui", "-s", "gui.skiros"]


def test_missing_binding_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    assert missing_binding() == ""
    monkeypatch.setattr("skiros2_gui.launcher.find_spec", lambda name: None)
    assert "python_qt_binding" in missing_binding()


def test_launcher_has_no_plugin_without_rqt(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_PACKAGE_PATH", "")
    assert rqt_command() is None


def test_launcher_has_no_plugin_if_rqt_cannot_be_imported(rqt_package: None) -> None:
    assert rqt_command() is None


@pytest.mark.parametrize(
    ("environment", "problem"),
    [
        ({}, "DISPLAY is not set"),
        ({"DISPLAY": ":9999"}, "the display :9999 (DISPLAY) cannot be opened"),
        ({"DISPLAY": ":9999", "QT_QPA_PLATFORM": "xcb"}, "cannot be opened"),
        ({"QT_QPA_PLATFORM": "offscreen"}, ""),
        ({"WAYLAND_DISPLAY": "wayland-0"}, ""),
    ],
)
def test_display_problem_names_the_reason(
    monkeypatch: pytest.MonkeyPatch, environment: dict[str, str], problem: str
) -> None:
    for name in DISPLAY_VARIABLES:
        monkeypatch.delenv(name, raising=False)
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    assert problem in display_problem()
    assert bool(display_problem()) == bool(problem)


def test_virtual_display_is_available_within_its_context(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in DISPLAY_VARIABLES:
        monkeypatch.delenv(name, raising=False)
    with Display() as display:
        monkeypatch.setenv("DISPLAY", display.name)
        assert display_problem() == ""
    monkeypatch.delenv("DISPLAY")
    assert "DISPLAY is not set" in display_problem()


@pytest.fixture
def launched(tmp_path: Path) -> Iterator[Launched]:
    launched = Launched(tmp_path)
    yield launched
    launched.stop()


class Launched:
    """The launch file's node where rqt is installed: an rqt that prints its arguments and returns a given status."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._programs: list[Program] = []
        (folder / "rqt_gui").mkdir()
        (folder / "rqt_gui/package.xml").write_text("<package><name>rqt_gui</name></package>")
        (folder / "rqt_gui_py.py").touch()

    def start(self, env: Mapping[str, str], status: int = 0, before: str = "") -> Program:
        rosrun = self._folder / "rosrun"
        rosrun.write_text(f"#!/bin/bash\necho rosrun $*\n{before}\nexit {status}\n")
        rosrun.chmod(0o755)
        source = [str(self._folder), str(ROOT / "skiros2_gui/src")]
        full = {
            **{key: value for key, value in os.environ.items() if key not in DISPLAY_VARIABLES},
            "PATH": f"{self._folder}:{os.environ['PATH']}",
            "PYTHONPATH": ":".join([*source, *COMMON, os.environ.get("PYTHONPATH", "")]),
            "ROS_PACKAGE_PATH": str(self._folder),
            **env,
        }
        program = Program([sys.executable, str(NODE), "--launched", "__name:=skiros_gui"], full)
        self._programs.append(program)
        return program

    def stop(self) -> None:
        for program in self._programs:
            program.stop()


def test_launcher_without_display_logs_one_line_and_waits(launched: Launched) -> None:
    program = launched.start({})
    program.wait_for_line("there is no display")
    assert program.running
    assert "rosrun" not in program.output
    program.interrupt()
    program.wait()


def test_closed_window_is_not_reopened(launched: Launched) -> None:
    program = launched.start({"QT_QPA_PLATFORM": "offscreen"})
    program.wait_for_line("the window was closed")
    assert "rosrun rqt_gui rqt_gui -s gui.skiros" in program.output
    assert program.running


def test_failed_window_returns_its_status_to_roslaunch(launched: Launched) -> None:
    assert launched.start({"QT_QPA_PLATFORM": "offscreen"}, status=3).wait() == 3


def test_launcher_waits_for_window_after_interrupt(launched: Launched) -> None:
    closes = "trap 'sleep 0.5; echo closed; exit' INT; echo open; while :; do sleep 0.1; done"
    program = launched.start({"QT_QPA_PLATFORM": "offscreen"}, before=closes)
    program.wait_for_line("^open")
    os.killpg(program.pid, signal.SIGINT)
    assert program.wait() == 0
    assert "closed" in program.output
    assert "Traceback" not in program.output
