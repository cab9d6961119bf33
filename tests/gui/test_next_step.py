"""The bar that says what to do in a system that cannot move a robot yet."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any

import pytest
from pytestqt.qtbot import QtBot
from python_qt_binding.QtGui import QGuiApplication
from python_qt_binding.QtWidgets import QApplication, QDialog

from skiros2_common.core.world_element import Element
from skiros2_gui.app.events import EventQueue
from skiros2_gui.app.next_step import next_step
from skiros2_gui.app.system import part_of
from skiros2_gui.app.widgets.main_widget import MainWidget
from skiros2_live.core.patch import MASTER, WORLD_MODEL, Connection
from support.window.driver import Driver
from support.window.local_system import LocalSystem
from unit.skiros2_gui.lab_skills import note


class SystemWithMaster(LocalSystem):
    """A system whose master may be down."""

    def __init__(self, event_queue: EventQueue) -> None:
        super().__init__(event_queue)
        self.set_master(True)

    def set_master(self, is_up: bool) -> None:
        self._event_queue.put(Connection(MASTER, "http://localhost:11311", is_up, time.time()))


@pytest.fixture
def driver(qtbot: QtBot) -> Iterator[Driver]:
    window = MainWidget(SystemWithMaster)
    qtbot.addWidget(window, before_close_func=MainWidget.shut_down)
    window.show()
    yield Driver(window)


def add_robot(system: Any, label: str) -> None:
    robot = Element("cora:Robot", label)
    robot.addRelation("skiros:Scene-0", "skiros:contain", "-1")
    system.world.add_element(robot)


def wait_for_text(driver: Driver, text: str) -> None:
    shown = driver.widget("nextStepText")
    driver.wait_until(lambda: shown.isVisible() and text in shown.text(), text)


def test_missing_master_and_world_model_come_with_commands(driver: Driver) -> None:
    system = driver.window.system
    system.set_master(False)
    wait_for_text(driver, "Start a system")
    driver.click("nextStepCopy")
    assert QGuiApplication.clipboard().text() == "roslaunch skiros2_demo_skills demo.launch gui:=false"
    assert not driver.widget("nextStepAdd").isVisible()
    system.set_master(True)
    system.set_up(False)
    wait_for_text(driver, "Start the world model")
    assert driver.widget("nextStepCommand").text() == "roslaunch skiros2 skiros.launch gui:=false"


@pytest.mark.parametrize(("button", "title"), [("nextStepLoad", "Load a scene"), ("nextStepAdd", "Add an element")])
def test_buttons_of_an_empty_scene_open_dialogs(driver: Driver, button: str, title: str) -> None:
    wait_for_text(driver, "The scene is empty")
    driver.click(button)
    dialogs = driver.wait_until(
        lambda: [d for d in driver.window.findChildren(QDialog) if d.isVisible()], f"the dialog {title!r}"
    )
    assert [dialog.windowTitle() for dialog in dialogs] == [title]
    assert driver.window.tab.title == "World model"
    dialogs[0].reject()
    QApplication.processEvents()


def test_robot_without_manager_comes_with_the_command_that_starts_one(driver: Driver) -> None:
    system = driver.window.system
    add_robot(system, "demo:mobile_manipulator")
    wait_for_text(driver, "Start the skill manager of mobile_manipulator")
    command = driver.widget("nextStepCommand").text()
    assert "robot_ontology_prefix:=demo robot_name:=mobile_manipulator" in command
    system.add_manager("/mobile_manipulator", [note], robot="demo:mobile_manipulator")
    driver.wait_until(lambda: not driver.widget("nextStep").isVisible(), "the end of the hint")


def test_scene_without_robot_and_robot_without_prefix_are_named(driver: Driver) -> None:
    system = driver.window.system
    product = Element("skiros:Product", "bolt")
    product.addRelation("skiros:Scene-0", "skiros:contain", "-1")
    system.world.add_element(product)
    cell = driver.window.shared.tasks.cell
    driver.wait_until(lambda: part_of(cell, WORLD_MODEL), "the world model")
    step = next_step(system, cell)
    assert step is not None and step.text.startswith("The scene has no robot.")
    add_robot(system, "arm")
    step = next_step(system, cell)
    assert step is not None and "the robot arm: give it a label with a prefix" in step.text
