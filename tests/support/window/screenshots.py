"""Takes the docs' screenshots of the window during a run: `python3 -m support.window.screenshots FOLDER`.

Starts the demo with timed motions on its own master, operates the window as a user does, and saves screenshots of the
first start and of each tab. Without a display it uses a virtual one (Xvfb).
"""

from __future__ import annotations

import contextlib
import os
import sys
from collections.abc import Generator, Iterable, Iterator
from pathlib import Path

from python_qt_binding.QtCore import QSettings, Qt
from python_qt_binding.QtGui import QImage
from python_qt_binding.QtWidgets import QApplication

from skiros2_common.command_line.command import Parser
from skiros2_common.core.errors import SkirosError
from skiros2_common.core.processes import Terminated
from skiros2_common.ros.private_system import PrivateSystem
from skiros2_gui.app.ros.system import RosSystem
from skiros2_gui.app.widgets.main_widget import MainWidget
from skiros2_gui.app.widgets.theme import DARK, LIGHT
from skiros2_gui.launcher import display_problem
from skiros2_gui.standalone import StandaloneWindow
from skiros2_gui.view3d.widgets.rviz_panel import rviz_problem
from support.window.display import Display
from support.window.driver import Driver
from support.window.rviz_screenshot import HEIGHT, WIDTH, separate_rviz_screenshot

#: The time to draw pending changes (s).
SETTLING_SECONDS = 0.6
#: The time for each step (s); a busy machine needs longer to start the demo.
TIMEOUT = 180.0
#: Qt's quality value for the highest PNG compression.
SMALLEST = 0

_GOAL = "(skiros:contain demo:Tray-12 skiros:Product-14)"


def main(arguments: list[str]) -> int:
    """Runs the program. Returns the exit status: 0 on success, 1 on failure, 128 + n after signal n."""
    parser = Parser(prog="screenshots", description="Takes screenshots of the window during a run.")
    parser.add_argument("folder", nargs="?", type=Path, default=Path("docs"), help="output folder (%(default)s)")
    folder = parser.parse_args(arguments).folder
    try:
        with virtual_display(), PrivateSystem("screenshots", has_own_home=True) as system:
            system.init_node("skiros_gui")
            # The window ends before the display. Qt would print the exception of a signal and continue.
            with system.signals.deferred(), contextlib.closing(_screenshots(system)) as taken:
                save(folder, taken)
    except Terminated as signal:
        sys.stderr.write("screenshots: stopped; all processes it started have ended\n")
        return 128 + signal.number
    except (SkirosError, OSError) as error:
        sys.stderr.write(f"screenshots: {error}\n")
        return 1
    return 0


def save(folder: Path, screenshots: Iterable[tuple[str, QImage]]) -> None:
    """Saves named screenshots as they are taken, and prints the names of the files.

    :raises OSError: a file cannot be written.
    """
    folder.mkdir(parents=True, exist_ok=True)
    for name, image in screenshots:
        path = folder / f"window_{name}.png"
        if not image.save(str(path), "PNG", SMALLEST):
            raise OSError(f"{path}: the screenshot cannot be written")
        sys.stdout.write(f"{path}\n")
        sys.stdout.flush()


@contextlib.contextmanager
def virtual_display() -> Iterator[None]:
    """Lets this process and its children draw on a virtual display, unless there is one."""
    if not display_problem():
        yield
        return
    with Display((1600, 1000)) as display:
        os.environ.update(display.env)
        yield


def _screenshots(ros: PrivateSystem) -> Generator[tuple[str, QImage], None, None]:
    """Starts the demo and operates the window; yields names and screenshots."""
    application = QApplication(["skiros_gui"])
    settings = QSettings(str(Path.home() / "window.ini"), QSettings.IniFormat)  # of the temporary system
    window = StandaloneWindow(MainWidget(RosSystem), settings)
    driver = Driver(window, TIMEOUT, ros.check)
    window.set_theme(LIGHT)
    window.resize(WIDTH, HEIGHT)
    window.show()
    try:
        driver.wait_until(driver.widget("nextStepCommand").isVisible, "the next step without a world model")
        yield "start", screenshot(driver)
        ros.launch("skiros2_demo_skills", "demo.launch", "gui:=false")
        system = window.content.system
        driver.wait_until(lambda: system.planner and system.scene, "the demo's nodes")
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
        yield "goal", screenshot(driver)
        driver.click("planButton")
        driver.wait_for_row("planView", "place")
        yield "skills", screenshot(driver)
        driver.click("achieveButton")
        driver.open_tab("Running")
        driver.open_tab("Messages")
        driver.wait_until(lambda: _has_message(driver, "close_gripper"), "the messages of pick")
        driver.write("nodeSearch", "pick", Qt.Key_Return)
        driver.open_tab("Node")
        driver.process_for(SETTLING_SECONDS)  # until the manager has sent the details
        yield "running", screenshot(driver)
        window.set_theme(DARK)
        driver.write("nodeSearch", "")
        driver.open_tab("Messages")
        driver.wait_until(lambda: _has_message(driver, "open_gripper"), "the messages of place")
        yield "dark", screenshot(driver)
        window.set_theme(LIGHT)
        driver.open_tab("Skills")
        driver.wait_for_row("planView", "place", "succeeded")
        driver.open_tab("World model")
        driver.choose("sceneTree", "Product A")
        yield "world", screenshot(driver)
        if not rviz_problem():
            yield "rviz", separate_rviz_screenshot(driver, "Product A")
    finally:
        window.close()
        application.processEvents()


def _has_message(driver: Driver, text: str) -> bool:
    """Returns whether the shown goal has a message."""
    return any(text in row for row in driver.rows("messages"))


def screenshot(driver: Driver) -> QImage:
    """Returns a screenshot of a window once it has drawn pending changes."""
    driver.process_for(SETTLING_SECONDS)
    return driver.window.grab().toImage()


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
