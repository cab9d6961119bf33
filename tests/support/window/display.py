"""A virtual X display for programs that draw: `with Display() as display: ... env=display.env`."""

from __future__ import annotations

import os
import shutil
import subprocess
from types import TracebackType
from typing import Any, Self

from skiros2_common.core.errors import Refused


class Display:
    """Runs Xvfb on a free display number; a context manager.

    :param size: width and height (px).
    """

    def __init__(self, size: tuple[int, int] = (1280, 900)) -> None:
        self._size = size
        self._server: subprocess.Popen[bytes] | None = None
        #: The value of `DISPLAY`, such as `:101`.
        self.name = ""

    def __enter__(self) -> Self:
        """:raises Refused: Xvfb is not installed, or does not start."""
        if shutil.which("Xvfb") is None:
            raise Refused("there is no display, and Xvfb is not installed; install the package xvfb")
        width, height = self._size
        read, write = os.pipe()
        command = ["Xvfb", "-displayfd", str(write), "-screen", "0", f"{width}x{height}x24"]
        self._server = subprocess.Popen(
            [*command, "+extension", "GLX", "-nolisten", "tcp", "-noreset"],
            pass_fds=[write], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
            start_new_session=True,  # Ctrl-C ends the program first: Qt aborts it without its display
        )  # fmt: skip
        os.close(write)
        with os.fdopen(read) as pipe:  # Xvfb writes its display number when it is ready
            number = pipe.readline().strip()
        if not number:
            raise Refused(f"Xvfb does not start: it ended with {self._server.wait()}")
        self.name = f":{number}"
        return self

    def __exit__(self, kind: type | None, error: BaseException | None, trace: TracebackType | None) -> None:
        if self._server is not None:
            self._server.terminate()
            self._server.wait()

    @property
    def env(self) -> dict[str, str]:
        """The environment of programs that draw with OpenGL on a machine without a graphics card."""
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
