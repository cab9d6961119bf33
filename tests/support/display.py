"""An X display that nobody sees, for programs that draw: `with Display() as display: ... env=display.env`."""

from __future__ import annotations

import os
import subprocess
from types import TracebackType
from typing import Any


class Display:
    """An Xvfb of its own, with what programs need to draw with OpenGL on a machine without a graphics card.

    :param size: width and height (px).
    """

    def __init__(self, size: tuple[int, int] = (1280, 900)) -> None:
        self._size = size
        self._server: subprocess.Popen[bytes] | None = None
        #: Its name, such as `:101`.
        self.name = ""

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
        """What is to be seen, as a Pillow image."""
        from PIL import ImageGrab

        return ImageGrab.grab(xdisplay=self.name)

    def __enter__(self) -> Display:
        reader, writer = os.pipe()
        width, height = self._size
        screen = ["-screen", "0", f"{width}x{height}x24", "+extension", "GLX", "-nolisten", "tcp", "-noreset"]
        self._server = subprocess.Popen(
            ["Xvfb", "-displayfd", str(writer), *screen], pass_fds=[writer], stderr=subprocess.DEVNULL
        )
        os.close(writer)
        with os.fdopen(reader) as told:
            number = told.readline().strip()  # Xvfb picks a free one, and tells it when it is ready
        assert number, f"Xvfb ended with status {self._server.wait()}"
        self.name = f":{number}"
        return self

    def __exit__(self, kind: type | None, error: BaseException | None, trace: TracebackType | None) -> None:
        assert self._server is not None
        self._server.terminate()
        self._server.wait()
