"""The standalone window: settings, menu, signals, missing display."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from pytestqt.qtbot import QtBot
from python_qt_binding.QtCore import QSettings
from python_qt_binding.QtWidgets import QApplication

from skiros2_gui import standalone
from skiros2_gui.app.widgets.main_widget import MainWidget
from skiros2_gui.app.widgets.theme import SYSTEM, apply_theme, is_dark
from skiros2_gui.standalone import EndBySignal, StandaloneWindow
from support.window.local_system import LocalSystem

Open = Callable[[], StandaloneWindow]


@pytest.fixture
def settings(tmp_path: Path) -> Path:
    return tmp_path / "window.conf"


@pytest.fixture
def opened(qtbot: QtBot, settings: Path) -> Iterator[Open]:
    font = QApplication.font()

    def make() -> StandaloneWindow:
        window = StandaloneWindow(MainWidget(LocalSystem), QSettings(str(settings), QSettings.IniFormat))
        qtbot.addWidget(window)
        window.show()
        return window

    yield make
    apply_theme(QApplication.instance(), SYSTEM)
    QApplication.setFont(font)


def test_settings_are_restored(opened: Open) -> None:
    first = opened()
    usual = QApplication.font().pointSizeF()
    first.themes["dark"].trigger()
    assert is_dark(first.content)
    first.zoom(1)
    first.zoom(1)
    first.content.tabs.setCurrentIndex(2)
    first.resize(1300, 760)
    first.close()
    apply_theme(QApplication.instance(), SYSTEM)
    font = QApplication.font()
    font.setPointSizeF(usual)
    QApplication.setFont(font)
    second = opened()
    assert is_dark(second.content)
    assert second.themes["dark"].isChecked()
    assert QApplication.font().pointSizeF() == usual + 2
    assert second.content.tabs.currentIndex() == 2
    assert (second.width(), second.height()) == (1300, 760)
    second.zoom(0)
    assert QApplication.font().pointSizeF() == usual


def test_window_closes_if_settings_cannot_be_stored(opened: Open, monkeypatch: pytest.MonkeyPatch) -> None:
    window = opened()
    monkeypatch.setattr(window.content, "settings", lambda: {"not JSON": object()})
    ended = []
    monkeypatch.setattr(window.content.system, "close", lambda: ended.append(True))
    assert window.close()
    assert ended == [True]


@pytest.mark.parametrize("kept", ["not JSON", "[1]", '{"tabs": 1}'])
def test_invalid_settings_are_ignored(opened: Open, settings: Path, kept: str) -> None:
    store = QSettings(str(settings), QSettings.IniFormat)
    for key, value in {"content": kept, "geometry": "x", "theme": "pink", "text_size": "large"}.items():
        store.setValue(key, value)
    store.sync()
    window = opened()
    assert window.isVisible()
    assert window.themes["system"].isChecked()


def test_signal_closes_the_window(opened: Open, qtbot: QtBot) -> None:
    window = opened()
    before = signal.getsignal(signal.SIGINT)
    ends = EndBySignal()
    try:
        os.kill(os.getpid(), signal.SIGINT)
        qtbot.waitUntil(lambda: not window.isVisible())
    finally:
        ends.close()
    assert signal.getsignal(signal.SIGINT) is before


def test_main_without_display_prints_one_line(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("QT_QPA_PLATFORM", "xcb")
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    monkeypatch.delenv("DISPLAY", raising=False)
    assert standalone.main(["skiros_gui"]) == standalone.NO_DISPLAY
    assert capfd.readouterr().err == "skiros_gui: there is no display to open the window on: DISPLAY is not set\n"
    monkeypatch.setenv("DISPLAY", ":9999")
    assert standalone.main(["skiros_gui"]) == standalone.NO_DISPLAY
    assert "the display :9999 (DISPLAY) cannot be opened" in capfd.readouterr().err
