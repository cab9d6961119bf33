"""A virtual X display for programs that draw: `with Display() as display: ... env=display.env`."""

from __future__ import annotations

import os
from typing import Any

from skiros2_gui.display import VirtualDisplay


class Display(VirtualDisplay):
    """With what programs need to draw with OpenGL on a machine without a graphics card.

    :param size: width and height (px).
    """

    def __init__(self, size: tuple[int, int] = (1280, 900)) -> None:
        super().__init__(size)

    @property
    def env(self) -> dict[str, str]:
        """To be added to a program's environment."""
        return {
            "DISPLAY": self.name,
            "QT_QPA_PLATFORM": "xcb",
            "QT_X11_NO_MITSHM": "1",
            "LIBGL_ALWAYS_SOFTWARE": "1",
            "XDG_RUNTIME_DIR": os.environ.get("XDG_RUNTIME_DIR", "/tmp"),
        }

    def grab(self) -> Any:
        """The screen as a Pillow image."""
        from PIL import ImageGrab

        return ImageGrab.grab(xdisplay=self.name)
