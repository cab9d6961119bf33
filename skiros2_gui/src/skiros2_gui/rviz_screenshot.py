"""Screenshots of rviz in the window; `QWidget.grab` does not capture it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from python_qt_binding.QtGui import QImage
from python_qt_binding.QtWidgets import QApplication

from skiros2_gui.driver import Driver

#: The minimum share of pixels of locations, and of handles.
LOCATIONS, HANDLES = 0.01, 0.00002

#: The time to draw elements whose frames were not known at first (s).
SETTLING_SECONDS = 3.0

_Channel = NDArray[np.int16]


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
