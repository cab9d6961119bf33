"""The bar of stopped robots above the tabs."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from pytestqt.qtbot import QtBot
from python_qt_binding.QtWidgets import QLabel, QPushButton

from skiros2_gui.app.system import clock
from skiros2_gui.app.widgets.main_widget import MainWidget
from skiros2_skill.testing import describe, stand_in
from support.window.driver import Driver
from support.window.local_system import LocalSystem

SINCE = 1e9
CAUSE = "emergency stop by /e_stop: data is True"
REASON = f"Stopped since {clock(SINCE)}: {CAUSE}."

RecoverFromStop = describe("RecoverFromStop")
recover = stand_in(RecoverFromStop, label="recover_from_stop", execute=lambda s: s.step("Waiting for the driver"))
recover_in_vain = stand_in(RecoverFromStop, label="recover_in_vain", execute=lambda s: s.fail("the button is in", -1))
other = stand_in(describe("Other"), label="other")


@pytest.fixture
def window(qtbot: QtBot) -> Iterator[MainWidget]:
    made = MainWidget(LocalSystem)
    qtbot.addWidget(made, before_close_func=MainWidget.shut_down)
    made.show()
    yield made


@pytest.fixture
def driver(window: MainWidget) -> Driver:
    return Driver(window)


def stop(window: MainWidget, *skills: type, name: str = "/robot") -> None:
    window.system.add_manager(name, skills, f"skiros:{name[1:]}")
    window.system.set_stop(name, "emergency_stop", CAUSE, since=SINCE)


def text_of(driver: Driver, name: str) -> str:
    label = driver.window.findChild(QLabel, f"stop_{name}")
    return label.text() if label is not None else ""


def tip_of(driver: Driver, name: str) -> str:
    button = driver.window.findChild(QPushButton, f"recover_{name}")
    return button.toolTip() if button is not None else ""


def test_bar_is_hidden_while_no_robot_is_stopped(window: MainWidget, driver: Driver) -> None:
    stop(window, recover)
    driver.wait_until(window.stop_bar.isVisible, "the bar")
    window.system.set_stop("/robot", "running")
    driver.wait_until(lambda: not window.stop_bar.isVisible(), "no bar")


def test_each_stopped_robot_has_a_line_with_kind_time_and_reasons(window: MainWidget, driver: Driver) -> None:
    stop(window, recover)
    stop(window, recover, name="/other")
    driver.wait_until(lambda: text_of(driver, "robot") == f"/robot: emergency stop. {REASON}", "the first line")
    driver.wait_until(lambda: text_of(driver, "other") == f"/other: emergency stop. {REASON}", "the second line")


def test_button_starts_the_recovery_and_is_disabled_while_it_runs(window: MainWidget, driver: Driver) -> None:
    stop(window, recover)
    driver.wait_until(lambda: window.stop_bar.isVisible(), "the bar")
    driver.click("recover_robot")
    driver.wait_until(lambda: window.shared.tasks.rows, "the task")
    (run,) = window.shared.tasks.rows
    assert run.latest.shape.type(1) == "skiros:RecoverFromStop"
    button = driver.widget("recover_robot")
    assert not button.isEnabled() and button.toolTip() == "/robot is running RecoverFromStop"
    driver.click("stopAllButton")
    driver.wait_until(button.isEnabled, "the button")


def test_line_shows_why_the_recovery_failed(window: MainWidget, driver: Driver) -> None:
    stop(window, recover_in_vain)
    driver.wait_until(lambda: window.stop_bar.isVisible(), "the bar")
    driver.click("recover_robot")
    driver.wait_until(lambda: "the button is in" in text_of(driver, "robot"), "the reason")


def test_button_is_disabled_if_the_robot_offers_no_recovery(window: MainWidget, driver: Driver) -> None:
    stop(window, other)
    tip = "/robot does not offer the skill RecoverFromStop; add it to its skill list"
    driver.wait_until(lambda: tip_of(driver, "robot") == tip, "the reason")
    assert not driver.widget("recover_robot").isEnabled()
