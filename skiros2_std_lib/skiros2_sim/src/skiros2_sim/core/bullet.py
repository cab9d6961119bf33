"""A connection to PyBullet."""

from __future__ import annotations

import ctypes
import functools
import os
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from typing import Any

import pybullet

from skiros2_common.core.errors import Refused


class Bullet:
    """One physics world of PyBullet: `bullet.stepSimulation()` is `pybullet.stepSimulation(physicsClientId=id)`.

    :param gui: whether to show PyBullet's window; possible for one world per process.
    :raises Refused: no window can be opened, or there are too many worlds.
    """

    def __init__(self, gui: bool = False) -> None:
        self._gui = gui
        with _display() if gui else nullcontext():
            self.id: int = pybullet.connect(pybullet.GUI if gui else pybullet.DIRECT)
        if self.id < 0:
            raise Refused(f"PyBullet cannot open {'a window' if gui else 'another world'}")
        if gui:
            for what in (pybullet.COV_ENABLE_GUI, pybullet.COV_ENABLE_SHADOWS):
                pybullet.configureDebugVisualizer(what, 0, physicsClientId=self.id)

    def __getattr__(self, name: str) -> Any:
        found = getattr(pybullet, name)
        if callable(found) and not isinstance(found, type):
            found = functools.partial(found, physicsClientId=self.id)
        self.__dict__[name] = found
        return found

    def show(self, shown: bool) -> None:
        """Enables or disables rendering in the window, if there is one; disabled while many bodies are created."""
        if self._gui:
            pybullet.configureDebugVisualizer(pybullet.COV_ENABLE_RENDERING, int(shown), physicsClientId=self.id)

    def close(self) -> None:
        """Disconnects. Further calls do nothing."""
        if self.id >= 0:
            pybullet.disconnect(physicsClientId=self.id)
            self.id = -1


@contextmanager
def _display() -> Iterator[None]:
    """Keeps an X display open. PyBullet ends the process without one, and a server without a window manager restarts
    when its last client disconnects.

    :raises Refused: there is no display.
    """
    try:
        x11 = ctypes.CDLL("libX11.so.6")
        x11.XOpenDisplay.restype = ctypes.c_void_p
        x11.XCloseDisplay.argtypes = [ctypes.c_void_p]
        display = x11.XOpenDisplay(None)
    except OSError:
        display = None
    if not display:
        raise Refused(f"PyBullet cannot open a window: no X display {os.environ.get('DISPLAY', '')!r}")
    try:
        yield
    finally:
        x11.XCloseDisplay(display)
