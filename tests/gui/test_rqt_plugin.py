"""The rqt plugin, loaded by tests/support/rqt_host.py."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from pytestqt.qtbot import QtBot

from skiros2_common.core.world_element import Element
from support.ros import ROOT
from support.rqt_host import Instance, RqtHost, provide_rqt
from support.window.local_system import LocalSystem

PACKAGE = ROOT / "skiros2_gui"
#: As `rqt_gui -s gui.skiros`.
NAME = "gui.skiros"


@pytest.fixture
def settings(tmp_path: Path) -> Path:
    return tmp_path / "rqt_gui.ini"


@pytest.fixture
def load(qtbot: QtBot, monkeypatch: pytest.MonkeyPatch, settings: Path) -> Iterator[Callable[..., Instance]]:
    """Loads an instance in an rqt that has just started; its system is in this process."""
    provide_rqt(monkeypatch)
    from skiros2_gui import gui

    monkeypatch.setattr(gui, "RosSystem", LocalSystem)
    instances: list[Instance] = []

    def load(serial_number: int = 1) -> Instance:
        instances.append(RqtHost(PACKAGE / "package.xml", settings).load(NAME, serial_number))
        return instances[-1]

    yield load
    for instance in instances:
        instance.close()


def test_manifests_declare_the_plugin(settings: Path) -> None:
    host = RqtHost(PACKAGE / "package.xml", settings)
    assert host.find(NAME) == "skiros2_gui/Skiros"
    assert host.plugins["skiros2_gui/Skiros"] == {
        "name": "Skiros", "type": "skiros2_gui.gui.Skiros", "base_class_type": "rqt_gui_py::Plugin",
    }  # fmt: skip


def test_plugin_adds_the_window_to_rqt(load: Callable[..., Instance]) -> None:
    instance = load()
    assert instance.widget.isVisible()
    assert [instance.widget.tabs.tabText(i) for i in range(3)] == ["Skills", "Running", "World model"]


def test_each_instance_has_a_system_and_a_title_of_its_own(load: Callable[..., Instance]) -> None:
    first, second = load(1), load(2)
    assert first.widget.system is not second.widget.system
    assert second.widget.windowTitle() == f"{first.widget.windowTitle()} (2)"
    first.close()
    second.widget.tabs.setCurrentIndex(1)
    assert second.widget.tab.isEnabled()


def test_instance_restores_its_own_settings(load: Callable[..., Instance]) -> None:
    first, second = load(1), load(2)
    first.widget.tabs.setCurrentIndex(2)
    second.widget.tabs.setCurrentIndex(1)
    first.close()
    second.close()
    assert [load(number).widget.tabs.currentIndex() for number in (1, 2, 3)] == [2, 1, 0]


@pytest.mark.parametrize("text", ["{", "[1]", '"words"', '{"tabs": 3, "tab": []}', ["a", "b"]])
def test_unreadable_settings_are_skipped(load: Callable[..., Instance], settings: Path, text: object) -> None:
    host = RqtHost(PACKAGE / "package.xml", settings)
    host.settings_of(NAME, 1)[1].set_value("window", text)
    assert load().widget.tabs.currentIndex() == 0


def test_events_after_close_are_ignored(load: Callable[..., Instance], qtbot: QtBot) -> None:
    instance = load()
    system, widget = instance.widget.system, instance.widget
    with qtbot.waitSignal(widget.destroyed):
        instance.close()
    system.set_up(False)
    system.world.add_element(Element("skiros:Product", "too late"))


def test_import_error_without_rqt_names_the_standalone_window(tmp_path: Path) -> None:
    code = "import sys; sys.modules['rqt_gui_py'] = None; import skiros2_gui.gui"
    env = {"PYTHONPATH": str(PACKAGE / "src")}
    done = subprocess.run([sys.executable, "-c", code], env=env, capture_output=True, text=True, check=False)
    assert "ImportError: skiros2_gui.gui is a plugin of rqt" in done.stderr
    assert "rosrun skiros2_gui skiros_gui" in done.stderr
