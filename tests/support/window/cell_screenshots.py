"""Takes the docs' screenshots that need cells of the tests: `python3 -m support.window.cell_screenshots FOLDER`."""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Iterator
from pathlib import Path

from python_qt_binding.QtCore import QPoint, Qt, QTimer
from python_qt_binding.QtGui import QImage
from python_qt_binding.QtTest import QTest
from python_qt_binding.QtWidgets import QApplication

from skiros2_gui.app.widgets.main_widget import MainWidget
from skiros2_gui.app.widgets.theme import LIGHT, apply_theme
from support.window.driver import Driver
from support.window.local_system import LocalSystem
from support.window.press_cell import PressCell
from support.window.screenshots import HEIGHT, WIDTH, save, screenshot, virtual_display
from support.window.teach_cell import TeachCell


def main(folder: str) -> None:
    with virtual_display():
        application = QApplication(["skiros_gui"])
        apply_theme(application, LIGHT)
        save(Path(folder), _screenshots())


def _screenshots() -> Iterator[tuple[str, QImage]]:
    yield "signals", _signals_screenshot()
    yield "teach", _teach_screenshot()


def _signals_screenshot() -> QImage:
    """A force that rises until it exceeds the limit of a skill, in a window without ROS."""
    content = MainWidget(LocalSystem)
    content.resize(WIDTH, HEIGHT)
    content.show()
    cell, driver = PressCell(content.shared), Driver(content)
    begin = time.monotonic()

    def publish() -> None:
        age = time.monotonic() - begin
        cell.publish(5.0 + 4.2 * age + math.sin(9.0 * age), 0.6 * math.cos(3.0 * age) + 0.1 * age)

    sensor = QTimer()
    sensor.timeout.connect(publish)
    try:
        driver.open_tab("Running")
        driver.open_tab("Signals")
        driver.choose("signalSpan", "10 s")
        sensor.start(5)
        cell.press()
        driver.wait_for_row("taskChoice", "press", "failed")
        return screenshot(driver)
    finally:
        sensor.stop()
        content.shut_down()
        content.close()


def _teach_screenshot() -> QImage:
    """A path is being recorded, in a window without ROS."""
    content = MainWidget(LocalSystem)
    content.resize(WIDTH, HEIGHT)
    content.show()
    cell, driver = TeachCell(content.shared), Driver(content)
    try:
        pose = cell.teach("grasp")
        cell.teach("grasp lifting", "skiros:LiftingPose", pose.id)
        cell.teach("approach", PositionX=0.08, PositionZ=0.41)
        driver.open_tab("World model")
        driver.open_tab("Teach")
        driver.choose("sceneTree", "block")
        driver.wait_for_row("taughtList", "grasp")
        driver.click("teach_release")
        driver.write("teachName", "insert")
        driver.click("teach_record_path")
        driver.wait_until(lambda: "Recording" in driver.widget("teachStatus").text(), "the recording")
        pad = driver.widget("forcePad")
        driver.wait_until(pad.isEnabled, "the pad")
        QTest.mousePress(pad, Qt.LeftButton, Qt.NoModifier, pad.rect().center() + QPoint(20, -35))
        picture = screenshot(driver)
        QTest.mouseRelease(pad, Qt.LeftButton)
        return picture
    finally:
        content.shut_down()
        content.close()


if __name__ == "__main__":
    main(*sys.argv[1:])
