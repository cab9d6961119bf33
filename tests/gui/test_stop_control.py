"""The stop button: it stops everything by a click or Esc, and reports what it has stopped."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from pytestqt.qtbot import QtBot
from python_qt_binding.QtCore import QSettings, Qt
from python_qt_binding.QtTest import QTest
from python_qt_binding.QtWidgets import QApplication, QLineEdit

from skiros2_gui.app.widgets.main_widget import MainWidget
from skiros2_gui.standalone import StandaloneWindow
from skiros2_skill.client.description import Step
from skiros2_skill.testing import describe, stand_in
from support.window.driver import Driver
from support.window.local_system import LocalSystem

work = stand_in(describe("Work"), label="work", execute=lambda s: s.step("working"))


@pytest.fixture
def driver(qtbot: QtBot) -> Iterator[Driver]:
    window = MainWidget(LocalSystem)
    qtbot.addWidget(window, before_close_func=MainWidget.shut_down)
    for name in ("first", "second"):
        window.system.add_manager(f"/{name}", [work], f"skiros:{name}")
    with qtbot.waitActive(window):
        window.show()
    yield Driver(window)


def start_work(driver: Driver, *robots: str) -> None:
    for robot in robots:
        driver.window.system.managers[robot].command("start", -1, [Step("skiros:Work", "work")])
    driver.wait_until(lambda: states(driver) == ["running"] * len(robots), "the tasks")


def states(driver: Driver) -> list[str]:
    return [run.state for run in driver.window.shared.tasks.rows]


def report(driver: Driver) -> str:
    return driver.widget("stopReport").text().partition("  ")[2]


def wait_for_report(driver: Driver, text: str) -> None:
    driver.wait_until(lambda: report(driver) == text, f"the report {text!r}")


def test_click_stops_the_tasks_of_all_robots_and_names_them(driver: Driver) -> None:
    start_work(driver, "/first", "/second")
    driver.click("stopAllButton")
    driver.wait_until(lambda: states(driver) == ["preempted", "preempted"], "the end of the tasks")
    driver.wait_until(lambda: report(driver).startswith("stopped"), "the report")
    assert set(report(driver).removeprefix("stopped ").split(", ")) == {"work of first", "work of second"}


def test_stop_without_tasks_is_reported(driver: Driver) -> None:
    driver.click("stopAllButton")
    assert report(driver) == "nothing was running; all robots were sent a stop"


@pytest.mark.parametrize("tab", ["Skills", "Running", "World model", "Learning"])
def test_button_is_visible_and_esc_stops_in_each_tab(driver: Driver, tab: str) -> None:
    driver.open_tab(tab)
    start_work(driver, "/first")
    assert driver.widget("stopAllButton").isVisible()
    QTest.keyClick(QApplication.focusWidget(), Qt.Key_Escape)
    wait_for_report(driver, "stopped work of first")


def test_esc_stops_while_a_text_is_edited(driver: Driver) -> None:
    start_work(driver, "/first")
    driver.write("skillSearch", "wo")
    QTest.keyClick(driver.widget("skillSearch"), Qt.Key_Escape)
    wait_for_report(driver, "stopped work of first")
    assert driver.widget("skillSearch").text() == "wo"


def test_esc_closes_an_open_list_and_stops_nothing(driver: Driver) -> None:
    start_work(driver, "/first")
    menu = driver.widget("goalEarlier").menu()
    menu.popup(driver.window.mapToGlobal(driver.window.rect().center()))
    driver.wait_until(menu.isVisible, "the menu")
    QTest.keyClick(menu, Qt.Key_Escape)
    driver.wait_until(lambda: not menu.isVisible(), "the menu to close")
    assert states(driver) == ["running"]


def test_esc_ends_the_edit_of_a_cell_and_stops_nothing(driver: Driver) -> None:
    start_work(driver, "/first")
    driver.open_tab("World model")
    driver.choose("sceneTree", "first")
    driver.choose("elementTable", "SkillMgr")
    QTest.keyClick(driver.widget("elementTable"), Qt.Key_Right)
    QTest.keyClick(driver.widget("elementTable"), Qt.Key_F2)
    driver.wait_until(lambda: isinstance(QApplication.focusWidget(), QLineEdit), "the editor of the cell")
    QTest.keyClick(QApplication.focusWidget(), Qt.Key_Escape)
    driver.wait_until(lambda: not isinstance(QApplication.focusWidget(), QLineEdit), "the editor to close")
    assert states(driver) == ["running"]
    QTest.keyClick(QApplication.focusWidget(), Qt.Key_Escape)
    wait_for_report(driver, "stopped work of first")


def test_report_disappears_with_the_next_start(driver: Driver) -> None:
    driver.click("stopAllButton")
    driver.open_tab("Skills")
    driver.choose("skillTree", "work")
    driver.click("startButton")
    driver.wait_until(lambda: driver.widget("stopReport").text() == "", "no report")


def test_esc_stops_in_a_standalone_window_without_focus(qtbot: QtBot, tmp_path: object) -> None:
    settings = QSettings(f"{tmp_path}/window.conf", QSettings.IniFormat)
    window = StandaloneWindow(MainWidget(LocalSystem), settings)
    qtbot.addWidget(window)
    with qtbot.waitActive(window):
        window.show()
    if QApplication.focusWidget() is not None:
        QApplication.focusWidget().clearFocus()
    QTest.keyClick(window, Qt.Key_Escape)
    assert window.content.stop_control.report.text()
