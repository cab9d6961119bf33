"""Takes screenshots of the window during a run: `PYTHONPATH=tests:$PYTHONPATH python3 -m support.window.screenshots`.

Starts the demo with timed motions on its own master, operates the window as a user does, and saves a screenshot of each
tab. Without a display it uses a virtual one (Xvfb).
"""

from __future__ import annotations

import argparse
import contextlib
import math
import os
import sys
import time
from collections.abc import Iterator
from pathlib import Path

from python_qt_binding.QtCore import QPoint, QSettings, QSize, Qt, QTimer
from python_qt_binding.QtGui import QImage
from python_qt_binding.QtTest import QTest
from python_qt_binding.QtWidgets import QApplication

from skiros2_common.core.errors import SkirosError
from skiros2_common.core.processes import Terminated
from skiros2_common.ros.private_system import START_TIMEOUT, PrivateSystem
from skiros2_gui.app.ros.system import RosSystem
from skiros2_gui.app.widgets.main_widget import MainWidget
from skiros2_gui.app.widgets.theme import DARK, LIGHT
from skiros2_gui.launcher import display_problem
from skiros2_gui.standalone import StandaloneWindow
from skiros2_gui.view3d.widgets.rviz_panel import rviz_problem
from support.display import Display
from support.window.driver import Driver
from support.window.local_system import LocalSystem
from support.window.press_cell import PressCell
from support.window.rviz_screenshot import rviz_screenshot
from support.window.teach_cell import TeachCell

#: The window's size (pixels).
WIDTH, HEIGHT = 1280, 800

#: The time to draw pending changes (s).
SETTLING_SECONDS = 0.6
#: Qt's quality value for the highest PNG compression.
SMALLEST = 0

_GOAL = "(skiros:contain demo:Tray-12 skiros:Product-14)"


def main(arguments: list[str]) -> int:
    """Runs the program. Returns the exit status: 0 on success, 1 on failure, 128 + n after signal n."""
    parser = argparse.ArgumentParser(prog="screenshots", description="Takes screenshots of the window during a run.")
    parser.add_argument("folder", nargs="?", type=Path, default=Path("docs"), help="output folder (%(default)s)")
    folder = parser.parse_args(arguments).folder
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with _display(), PrivateSystem("screenshots", has_own_home=True) as system:
            system.init_node("skiros_gui")
            system.launch("skiros2_demo_skills", "demo.launch", "gui:=false")
            for name, image in _screenshots():
                path = folder / f"window_{name}.png"
                if not image.save(str(path), "PNG", SMALLEST):
                    raise OSError(f"{path}: the screenshot cannot be written")
                sys.stdout.write(f"{path}\n")
    except Terminated as signal:
        sys.stderr.write("screenshots: stopped; all processes it started have ended\n")
        return 128 + signal.number
    except (SkirosError, OSError) as error:
        sys.stderr.write(f"screenshots: {error}\n")
        return 1
    return 0


@contextlib.contextmanager
def _display() -> Iterator[None]:
    """Sets `DISPLAY` of this process and its children to a virtual display, unless there is one."""
    if not display_problem():
        yield
        return
    with Display((1600, 1000)) as display:
        os.environ["DISPLAY"] = display.name
        yield


def _screenshots() -> Iterator[tuple[str, QImage]]:
    """Operates the window; yields names and screenshots."""
    application = QApplication(["skiros_gui"])
    settings = QSettings(str(Path.home() / "window.ini"), QSettings.IniFormat)  # of the temporary system
    window = StandaloneWindow(MainWidget(RosSystem), settings)
    driver = Driver(window)
    window.set_theme(LIGHT)
    window.resize(WIDTH, HEIGHT)
    window.show()
    try:
        system = window.content.system
        driver.wait_until(lambda: system.planner and system.scene, "the demo's nodes", START_TIMEOUT)
        driver.choose("skillTree", "drive")
        driver.choose("param_TargetLocation", "Workstation 1")
        driver.click("startButton")
        driver.wait_for_row("taskList", "drive", "succeeded")
        driver.choose("skillTree", "pick")
        driver.choose("param_Object", "Product A")
        driver.wait_until(lambda: driver.widget("whyNot").text().startswith("Ready"), "a startable skill")
        driver.write("goalLine", _GOAL)
        driver.open_tab("Goal")
        driver.wait_until(lambda: driver.widget("goalObject_0").currentText() == "Product A", "the labels of the goal")
        yield "goal", _screenshot(driver)
        driver.click("planButton")
        driver.wait_for_row("planView", "place")
        yield "skills", _screenshot(driver)
        driver.click("achieveButton")
        driver.open_tab("Running")
        driver.choose("taskChoice", "pick")
        driver.open_tab("Messages")
        driver.wait_for_row("messages", "close_gripper")
        driver.write("nodeSearch", "pick", Qt.Key_Return)
        driver.open_tab("Node")
        yield "running", _screenshot(driver)
        window.set_theme(DARK)
        driver.write("nodeSearch", "")
        driver.wait_for_row("taskChoice", "drive", "running")
        driver.choose("taskChoice", "drive")  # the newest one
        driver.open_tab("Messages")
        driver.wait_for_row("messages", "Driving to Workstation 2")
        yield "dark", _screenshot(driver)
        window.set_theme(LIGHT)
        driver.open_tab("Skills")
        driver.wait_for_row("planView", "place", "succeeded")
        driver.open_tab("World model")
        driver.choose("sceneTree", "Product A")
        yield "world", _screenshot(driver)
        if not rviz_problem():
            yield "rviz", rviz_screenshot(driver)
        yield "signals", _signals_screenshot(window.size())
        yield "teach", _teach_screenshot(window.size())
    finally:
        window.close()
        application.processEvents()


def _signals_screenshot(size: QSize) -> QImage:
    """A force that rises until it exceeds the limit of a skill, in a window without ROS."""
    content = MainWidget(LocalSystem)
    content.resize(size)
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
        return _screenshot(driver)
    finally:
        sensor.stop()
        content.shut_down()
        content.close()


def _teach_screenshot(size: QSize) -> QImage:
    """A path is being recorded, in a window without ROS."""
    content = MainWidget(LocalSystem)
    content.resize(size)
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
        picture = _screenshot(driver)
        QTest.mouseRelease(pad, Qt.LeftButton)
        return picture
    finally:
        content.shut_down()
        content.close()


def _screenshot(driver: Driver) -> QImage:
    driver.process_for(SETTLING_SECONDS)
    return driver.window.grab().toImage()


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
