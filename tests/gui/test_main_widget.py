"""The main widget: tabs, status, errors, keys."""

from __future__ import annotations

import json
import threading
from collections.abc import Iterator

import pytest
from pytestqt.qtbot import QtBot
from python_qt_binding.QtCore import QEvent, Qt
from python_qt_binding.QtGui import QGuiApplication, QKeyEvent, QPalette
from python_qt_binding.QtWidgets import (
    QApplication,
    QLabel,
    QLineEdit,
    QPushButton,
    QTextBrowser,
    QTreeWidget,
    QWidget,
)

from skiros2_common.core.errors import Refused
from skiros2_gui.app.events import ConnectionChanged
from skiros2_gui.app.widgets import main_widget
from skiros2_gui.app.widgets.main_widget import MainWidget
from skiros2_gui.app.widgets.theme import palette_of
from skiros2_skill.client.description import Step
from support.window.driver import Driver
from support.window.local_system import LocalSystem
from unit.skiros2_gui.lab_skills import break_down, fetch, furnish


@pytest.fixture
def window(qtbot: QtBot) -> Iterator[MainWidget]:
    made = MainWidget(LocalSystem)
    qtbot.addWidget(made, before_close_func=MainWidget.shut_down)
    made.show()
    yield made


def test_window_has_its_tabs(window: MainWidget) -> None:
    titles = [window.tabs.tabText(i) for i in range(window.tabs.count())]
    assert titles == ["Skills", "Running", "World model", "Learning"]


def test_tab_is_disabled_while_the_world_model_is_down(window: MainWidget, qtbot: QtBot) -> None:
    page = window.pages[2]
    assert page.tab.isEnabled()
    window.system.set_up(False)
    qtbot.waitUntil(lambda: not page.tab.isEnabled())
    assert "has been missing since" in page.banner.text()
    assert window.status.parts[0].text() == "✕ world model"
    window.system.set_up(True)
    qtbot.waitUntil(page.tab.isEnabled)
    assert page.banner.text() == ""


def test_error_is_shown_copied_dismissed_and_kept(window: MainWidget, qtbot: QtBot) -> None:
    def refuse() -> None:
        raise Refused("there is no file pick.ttl in the workspace")

    bar = window.error_bar
    assert not bar.isVisible()
    window.shared.jobs.run(refuse, activity="loading the scene")
    qtbot.waitUntil(bar.isVisible)
    text = "loading the scene: there is no file pick.ttl in the workspace"
    assert bar.text.text() == text
    bar.copy_button.click()
    assert QGuiApplication.clipboard().text() == text
    bar.close_button.click()
    assert not bar.isVisible()
    bar.history_button.click()
    history = window.error_bar.history
    assert history.toPlainText().splitlines()[0].endswith(text)
    history.close()


def test_error_bar_shows_the_first_line_and_keeps_the_rest(window: MainWidget) -> None:
    window.shared.problems.report("starting pick of /robot", "KeyError: 'To' (pick.py, line 7)\nTraceback:\n  ...")
    bar = window.error_bar
    assert bar.text.text() == "starting pick of /robot: KeyError: 'To' (pick.py, line 7)"
    assert "Traceback" in bar.text.toolTip()
    bar.copy_button.click()
    assert "Traceback" in QGuiApplication.clipboard().text()


@pytest.mark.qt_no_exception_capture
def test_uncaught_exception_is_shown(window: MainWidget) -> None:
    window.tabs.currentChanged.connect(lambda index: 1 // 0)
    window.tabs.setCurrentIndex(1)
    assert "ZeroDivisionError" in window.error_bar.text.text()


def test_failing_handler_does_not_affect_others(window: MainWidget) -> None:
    received = []
    window.shared.subscribe(ConnectionChanged, lambda event: event.missing)  # type: ignore[attr-defined]
    window.shared.subscribe(ConnectionChanged, received.append)
    window.shared.publish(ConnectionChanged())
    assert received == [ConnectionChanged()]
    assert window.shared.problems.newest is not None


def test_busy_sign_is_visible_during_a_job(window: MainWidget, qtbot: QtBot) -> None:
    gate = threading.Event()
    window.shared.jobs.run(lambda: gate.wait(10), activity="loading the scene")
    qtbot.waitUntil(window.status.bar.isVisible)
    qtbot.waitUntil(lambda: window.status.busy.text() == "loading the scene…")  # the window may still read it
    gate.set()
    qtbot.waitUntil(lambda: not window.status.bar.isVisible())
    assert window.status.busy.text() == ""


def test_stop_does_not_wait_for_an_inspection_that_blocks(
    window: MainWidget, qtbot: QtBot, monkeypatch: pytest.MonkeyPatch
) -> None:
    furnish(window.system.world)
    robot = window.system.add_manager("/robot", [fetch])
    is_asked, gate = threading.Event(), threading.Event()

    def inspect(task_id: int, node_id: int) -> None:
        is_asked.set()
        assert gate.wait(10)
        raise Refused("it took too long")

    monkeypatch.setattr(robot, "inspect", inspect)
    running = window.pages[1].tab
    window.tabs.setCurrentIndex(1)
    times = json.dumps({"key": "Times", "description": "", "specType": 0, "type": "int", "values": [2]})
    robot.command("start", -1, [Step("skiros:Fetch", "fetch", params=[times])])
    qtbot.waitUntil(lambda: running.presenter.frame is not None and bool(running.presenter.running()), timeout=20_000)
    running.presenter.select(1)
    qtbot.waitUntil(is_asked.is_set, timeout=20_000)
    try:
        stop = running.findChild(QPushButton, "stopButton")
        qtbot.waitUntil(stop.isEnabled)
        qtbot.mouseClick(stop, Qt.LeftButton)
        qtbot.waitUntil(lambda: running.presenter.run.latest.has_ended, timeout=9_000)
    finally:
        gate.set()


def test_exception_of_a_skill_is_shown_before_the_traceback(window: MainWidget, qtbot: QtBot) -> None:
    robot = window.system.add_manager("/robot", [break_down])
    Driver(window).open_tab("Tasks")
    robot.command("start", -1, [Step("skiros:Break", "break_down")])
    tasks = window.findChild(QTreeWidget, "taskList")
    qtbot.waitUntil(lambda: tasks.topLevelItemCount() == 1 and "failed" in tasks.topLevelItem(0).text(1))
    said = tasks.topLevelItem(0).text(5)
    assert "KeyError: 'sloow' (" in said
    assert said.endswith(", in execute).")
    window.tabs.setCurrentIndex(1)
    running = window.pages[1].tab
    qtbot.waitUntil(lambda: running.presenter.run is not None and running.presenter.run.latest.has_ended)
    note = window.findChild(QLabel, "taskNote")
    qtbot.waitUntil(lambda: "KeyError: 'sloow' (" in note.text())
    assert "Traceback" not in note.text()
    assert "Traceback" in note.toolTip()
    details = window.findChild(QTextBrowser, "nodeDetails")
    qtbot.waitUntil(lambda: "KeyError" in details.toPlainText())
    lines = [line.strip() for line in details.toPlainText().splitlines()]
    error = next(number for number, line in enumerate(lines) if "KeyError: 'sloow' (" in line)
    assert error < lines.index("Traceback (most recent call last):")
    assert "font-weight:600" in details.toHtml().split("KeyError")[0].rpartition("<span")[2]


class Other(QWidget):
    """A tab that records its calls."""

    title = "Other"
    needs = ()

    def __init__(self, window: object) -> None:
        super().__init__()
        self.calls: list[object] = []
        self.line = QLineEdit(self)
        self.plain = QWidget(self)
        self.plain.setFocusPolicy(Qt.StrongFocus)

    def settings(self) -> dict[str, object]:
        return {"kept": 3}

    def restore(self, settings: dict[str, object]) -> None:
        self.calls.append(settings["kept"])

    def find(self) -> None:
        self.calls.append("find")

    def toggle(self) -> None:
        self.calls.append("toggle")

    def close_tab(self) -> None:
        self.calls.append("closed")


@pytest.fixture
def other(qtbot: QtBot, monkeypatch: pytest.MonkeyPatch) -> Iterator[MainWidget]:
    monkeypatch.setattr(main_widget, "TABS", (Other, Other))
    monkeypatch.setattr(main_widget, "LAST_TABS", ())
    made = MainWidget(LocalSystem)
    qtbot.addWidget(made, before_close_func=MainWidget.shut_down)
    made.show()
    qtbot.waitActive(made)
    yield made


def test_keys_reach_the_current_tab(other: MainWidget, qtbot: QtBot) -> None:
    other.tabs.setCurrentIndex(1)
    tab = other.pages[1].tab
    tab.plain.setFocus()
    qtbot.keyClick(tab.plain, Qt.Key_Space)
    qtbot.keyClick(tab.plain, Qt.Key_F, Qt.ControlModifier)
    qtbot.mouseClick(tab.line, Qt.LeftButton)
    qtbot.keyClick(tab.line, Qt.Key_Space)
    assert tab.calls == ["toggle", "find"]
    assert tab.line.text() == " "
    assert other.pages[0].tab.calls == []


def test_space_edits_no_text_that_the_user_did_not_enter(other: MainWidget, qtbot: QtBot) -> None:
    tab = other.pages[0].tab
    button = QPushButton(tab)
    button.show()
    tab.line.setText("(at robot shelf)")
    button.setFocus()
    tab.line.setFocus(Qt.TabFocusReason)  # as Qt does when the focused widget is disabled
    tab.line.selectAll()
    qtbot.keyClick(tab.line, Qt.Key_Space)
    assert tab.line.text() == "(at robot shelf)"
    assert tab.calls == ["toggle"]


def test_space_edits_text_that_was_entered_with_the_tab_key_or_is_being_typed(other: MainWidget, qtbot: QtBot) -> None:
    tab = other.pages[0].tab
    tab.line.setFocus()
    qtbot.keyClicks(tab.line, "a b")
    assert tab.line.text() == "a b"
    tab.plain.setFocus()
    QWidget.setTabOrder(tab.plain, tab.line)
    qtbot.keyClick(tab.plain, Qt.Key_Tab)
    assert tab.line.hasFocus()
    tab.line.end(False)
    qtbot.keyClick(tab.line, Qt.Key_Space)
    assert tab.line.text() == "a b "
    assert tab.calls == []


def test_held_key_toggles_once(other: MainWidget, qtbot: QtBot) -> None:
    tab = other.pages[0].tab
    tab.plain.setFocus()
    for is_repeated in (False, True, True):
        event = QKeyEvent(QEvent.KeyPress, Qt.Key_Space, Qt.NoModifier, " ", is_repeated)
        QApplication.sendEvent(tab.plain, event)
    assert tab.calls == ["toggle"]


def test_settings_are_restored_and_invalid_ones_reported(other: MainWidget) -> None:
    other.tabs.setCurrentIndex(1)
    kept = other.settings()
    assert kept == {"tab": "Other", "tabs": {"Other": {"kept": 3}}}
    other.restore(kept)
    assert other.pages[0].tab.calls == [3]
    for nonsense in ({}, {"tabs": 3, "tab": []}, {"tabs": {"Other": [1]}}):
        other.restore(nonsense)
    assert other.shared.problems.newest is None
    other.restore({"tabs": {"Other": {}}})
    assert "restoring the settings of Other" in other.error_bar.text.text()


def test_no_events_are_delivered_after_shutdown(other: MainWidget) -> None:
    received = []
    other.shared.subscribe(ConnectionChanged, received.append)
    other.shut_down()
    other.shut_down()
    assert other.pages[0].tab.calls == ["closed"]
    other.system.set_up(False)
    QApplication.processEvents()
    assert received == []


def test_failing_tab_does_not_keep_others_open(other: MainWidget, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(other.pages[0].tab, "close_tab", lambda: 1 // 0)
    other.shut_down()
    assert other.pages[1].tab.calls == ["closed"]


def test_colours_follow_the_palette(window: MainWidget) -> None:
    def ground() -> int:
        return window.pages[0].banner.palette().color(QPalette.Window).lightness()

    window.setPalette(palette_of(dark=True))
    assert window.tabs.palette().color(QPalette.Window).lightness() < 128
    assert ground() < 128
    window.setPalette(palette_of(dark=False))
    assert ground() > 128
