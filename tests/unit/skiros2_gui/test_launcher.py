"""Which window `gui:=true` opens."""

from pathlib import Path

import pytest

import skiros2_gui
from skiros2_gui.launcher import window_command


@pytest.fixture
def plugin(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "gui.py").touch()
    monkeypatch.setattr(skiros2_gui, "__path__", [str(tmp_path)])


@pytest.fixture
def rqt(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / "rqt_gui"
    folder.mkdir()
    (folder / "package.xml").write_text("<package><name>rqt_gui</name></package>")
    monkeypatch.setenv("ROS_PACKAGE_PATH", str(tmp_path))


def test_the_rqt_plugin_where_rqt_is_installed(plugin: None, rqt: None) -> None:
    assert window_command() == ["rosrun", "rqt_gui", "rqt_gui", "-s", "gui.skiros"]


def test_none_without_rqt(plugin: None, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_PACKAGE_PATH", "")
    assert window_command() is None


def test_none_without_the_plugin(rqt: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(skiros2_gui, "__path__", [str(tmp_path / "empty")])
    assert window_command() is None
