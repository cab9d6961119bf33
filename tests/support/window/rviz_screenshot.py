"""Screenshots of rviz in the window; `QWidget.grab` does not capture it.

`python3 -m support.window.rviz_screenshot LABEL FILE` opens a window, selects the element with that label, and saves a
picture of rviz: a crash of rviz ends the process that draws it.
"""

from __future__ import annotations

import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from python_qt_binding.QtCore import QSettings
from python_qt_binding.QtGui import QImage
from python_qt_binding.QtWidgets import QApplication

from skiros2_common.core.processes import end_processes
from skiros2_common.ros.private_system import STOP_TIMEOUT, SystemDown
from skiros2_gui.app.ros.system import RosSystem
from skiros2_gui.app.widgets.main_widget import MainWidget
from skiros2_gui.app.widgets.theme import LIGHT
from skiros2_gui.standalone import StandaloneWindow
from support.window.driver import Driver

#: The size of windows in screenshots (pixels).
WIDTH, HEIGHT = 1280, 800

#: The minimum share of pixels of locations, and of handles.
LOCATIONS, HANDLES = 0.01, 0.00002

#: The time to draw elements whose frames were not known at first (s).
SETTLING_SECONDS = 3.0

_Channel = NDArray[np.int16]


def separate_rviz_screenshot(driver: Driver, label: str) -> QImage:
    """Returns a screenshot of rviz in a window of another process, which is started again once if it crashes.

    :param driver: of a window of this process, which is operated meanwhile.
    :param label: of the selected element.
    :raises SystemDown: there is no picture; the text has the last line of the other process.
    """
    with tempfile.TemporaryDirectory(prefix="skiros2-rviz-") as folder:
        picture, log = Path(folder, "rviz.png"), Path(folder, "rviz.log")
        command = [sys.executable, "-m", "support.window.rviz_screenshot", label, str(picture)]
        status = _run(driver, command, log)
        if status < 0:  # software renderers let rviz crash at times while it starts
            sys.stderr.write(f"rviz has crashed ({_name(status)}); starting it again\n")
            status = _run(driver, command, log)
        if status:
            lines = log.read_text(errors="replace").split("\n")
            last = next((line.strip() for line in reversed(lines) if line.strip()), "its log is empty")
            raise SystemDown(f"there is no picture of rviz, which has ended with {_name(status)}: {last}")
        return QImage(str(picture))


def _run(driver: Driver, command: list[str], log: Path) -> int:
    """Runs a process while the window is operated; returns its exit status, or minus the number of a signal."""
    with log.open("wb") as output:
        process = subprocess.Popen(
            command, stdin=subprocess.DEVNULL, stdout=output, stderr=subprocess.STDOUT, start_new_session=True
        )
    try:
        driver.wait_until(lambda: process.poll() is not None, "the picture of rviz")
    finally:
        end_processes([process], STOP_TIMEOUT)
    return process.returncode


def _name(status: int) -> str:
    return signal.Signals(-status).name if status < 0 else f"status {status}"


def main(label: str, picture: str) -> int:
    """Saves a picture of rviz in a window. Returns the exit status."""
    application = QApplication(["skiros_gui"])
    settings = QSettings(f"{picture}.ini", QSettings.IniFormat)
    window = StandaloneWindow(MainWidget(RosSystem), settings)
    window.set_theme(LIGHT)
    window.resize(WIDTH, HEIGHT)
    window.show()
    driver = Driver(window)
    driver.wait_until(lambda: window.content.system.scene is not None, "the scene")
    driver.open_tab("World model")
    driver.choose("sceneTree", label)
    is_saved = rviz_screenshot(driver).save(picture, "PNG", 0)
    window.close()
    application.processEvents()
    return 0 if is_saved else 1


def rviz_screenshot(driver: Driver) -> QImage:
    """Opens rviz in the window, and takes a screenshot once locations and the selected element's handles are drawn.

    :param driver: of a window on a screen, with the tab of rviz and a movable element selected.
    :raises LookupError: the window has no such tab.
    :raises TimedOut: rviz does not draw them.
    """
    driver.open_tab("3D")
    driver.click("rvizOpen")

    def drawn() -> QImage | None:
        picture = window_screenshot(driver)
        return picture if is_drawn(picture) else None

    driver.wait_until(drawn, "rviz to draw locations and handles")
    driver.process_for(SETTLING_SECONDS)
    return window_screenshot(driver)


def window_screenshot(driver: Driver) -> QImage:
    """Returns a screenshot of the window."""
    screen = QApplication.primaryScreen()
    return screen.grabWindow(driver.window.winId()).toImage()


def is_drawn(picture: QImage) -> bool:
    """Returns whether a screenshot has locations (light green) and handles (pure red and blue)."""
    return (
        share(picture, lambda r, g, b: (g > r + 15) & (g > b + 15)) > LOCATIONS
        and share(picture, lambda r, g, b: (r > 90) & (g < 30) & (b < 30)) > HANDLES
        and share(picture, lambda r, g, b: (b > 90) & (r < 30) & (g < 30)) > HANDLES
    )


def share(picture: QImage, test: Callable[[_Channel, _Channel, _Channel], NDArray[np.bool_]]) -> float:
    """Returns the share of pixels for which a test of red, green and blue (0 to 255) is true."""
    image = picture.convertToFormat(QImage.Format_RGB32)
    bits = image.constBits()
    bits.setsize(image.byteCount())
    pixels = np.frombuffer(bits, np.uint8).reshape(image.height(), -1, 4).astype(np.int16)
    blue, green, red = pixels[..., 0], pixels[..., 1], pixels[..., 2]
    return float(np.mean(test(red, green, blue)))


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
