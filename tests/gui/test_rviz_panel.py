"""The tab with rviz."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from pytestqt.qtbot import QtBot
from python_qt_binding.QtWidgets import QLabel, QPushButton, QWidget

from skiros2_gui.app.widgets.main_widget import MainWidget
from skiros2_gui.app.window import Window
from skiros2_gui.view3d.widgets import rviz_panel
from skiros2_gui.view3d.widgets.rviz_panel import RvizPanel, rviz_problem
from skiros2_live.core.patch import MASTER, Connection
from support.window.local_system import LocalSystem
from support.window.synchronous import make_window


def set_master(window: Window, is_up: bool) -> None:
    window.post(Connection(MASTER, "http://localhost:11311", is_up, 1.0))
    window.process_events()


@pytest.fixture
def window() -> Iterator[Window]:
    made = make_window(LocalSystem)
    set_master(made, True)
    yield made
    made.system.close()


def button(panel: RvizPanel) -> QPushButton:
    return panel.findChild(QPushButton, "rvizOpen")


def test_window_without_rviz_has_no_3d_tab(qtbot: QtBot, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rviz_panel, "find_spec", lambda _: None)
    assert "python3-rviz" in rviz_problem()
    monkeypatch.undo()
    assert "X11" in rviz_problem(), "this is drawn nowhere"
    main = MainWidget(LocalSystem)
    qtbot.addWidget(main, before_close_func=MainWidget.shut_down)
    assert "3D" not in [main.tabs.tabText(i) for i in range(main.tabs.count())]


def test_panel_is_disabled_without_master(qtbot: QtBot, window: Window, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rviz_panel, "rviz_problem", lambda: "")
    set_master(window, False)
    panel = RvizPanel(window)
    qtbot.addWidget(panel)
    assert not button(panel).isEnabled() and "ROS master" in button(panel).toolTip()
    panel.open()
    assert not panel.is_open
    set_master(window, True)
    assert button(panel).isEnabled()


class Frame(QWidget):
    """Stands in for rviz's window, which draws while it is told to."""

    def __init__(self) -> None:
        super().__init__()
        self.draws = False

    def getManager(self) -> Frame:
        return self

    def startUpdate(self) -> None:
        self.draws = True

    def stopUpdate(self) -> None:
        self.draws = False


def test_rviz_draws_while_visible_and_is_reused(qtbot: QtBot, window: Window, monkeypatch: pytest.MonkeyPatch) -> None:
    frame = Frame()
    monkeypatch.setattr(rviz_panel, "rviz_problem", lambda: "")
    monkeypatch.setattr(rviz_panel, "_reusable", [frame])
    panel = RvizPanel(window)
    qtbot.addWidget(panel)
    panel.show()
    panel.toggle()  # the space bar
    assert panel.is_open and frame.draws and frame.isVisible() and not button(panel).isVisible()
    panel.hide()
    assert not frame.draws
    panel.show()
    assert frame.draws
    set_master(window, False)
    assert "open it again" in panel.findChild(QLabel, "rvizSaid").text()
    panel.close_tab()
    panel.close_tab()
    assert not frame.draws and frame.parent() is None and rviz_panel._reusable == [frame]
