"""Pictures of rviz within the window, which other pictures of widgets do not have: it draws past Qt."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from python_qt_binding.QtGui import QImage
from python_qt_binding.QtWidgets import QApplication

from skiros2_gui.testing.driver import PATIENCE, Driver

#: Part of the picture that places take, and handles.
PLACES, HANDLES = 0.01, 0.00002

_Channel = NDArray[np.int16]


def rviz_picture(driver: Driver, patience: float = PATIENCE) -> QImage:
    """Opens rviz in the window, and takes a picture when places and the handles of the selected element are drawn.

    :param driver: of a window on a screen, with the tab of rviz; an element that can be moved is selected in it.
    :param patience: how long rviz may take (s).
    :raises LookupError: the window has no such tab.
    :raises TimedOut: rviz does not draw them.
    """
    driver.open_tab("3D")
    driver.click("rvizOpen")

    def drawn() -> QImage | None:
        picture = window_picture(driver)
        return picture if is_drawn(picture) else None

    return driver.wait_until(drawn, "places and handles drawn by rviz", patience)


def window_picture(driver: Driver) -> QImage:
    """What the screen shows of the window now."""
    screen = QApplication.primaryScreen()
    return screen.grabWindow(driver.window.winId()).toImage()


def is_drawn(picture: QImage) -> bool:
    """Whether a picture has places, which are light green, and the handles of a selected element, of pure colours."""
    return (
        share(picture, lambda r, g, b: (g > r + 15) & (g > b + 15)) > PLACES
        and share(picture, lambda r, g, b: (r > 90) & (g < 30) & (b < 30)) > HANDLES
        and share(picture, lambda r, g, b: (b > 90) & (r < 30) & (g < 30)) > HANDLES
    )


def share(picture: QImage, test: Callable[[_Channel, _Channel, _Channel], NDArray[np.bool_]]) -> float:
    """The part of a picture for which a test of red, green and blue (0 to 255) is true."""
    image = picture.convertToFormat(QImage.Format_RGB32)
    bits = image.constBits()
    bits.setsize(image.byteCount())
    pixels = np.frombuffer(bits, np.uint8).reshape(image.height(), -1, 4).astype(np.int16)
    blue, green, red = pixels[..., 0], pixels[..., 1], pixels[..., 2]
    return float(np.mean(test(red, green, blue)))
