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

    :param gui: show PyBullet's window; only one world of a process can.
    :raises Refused: there is no window, or there are too many worlds.
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
        """Draws the world in the window, if there is one, or leaves it as it is while much is made anew."""
        if self._gui:
            pybullet.configureDebugVisualizer(pybullet.COV_ENABLE_RENDERING, int(shown), physicsClientId=self.id)

    def close(self) -> None:
        """Ends the world. Closing it twice does nothing."""
        if self.id >= 0:
            pybullet.disconnect(physicsClientId=self.id)
            self.id = -1


@contextmanager
def _display() -> Iterator[None]:
    """An X display to open a window on, since PyBullet ends the process when there is none. It is held meanwhile: a
    server without a window manager starts anew when its last client goes.

    :raises Refused: there is none.
    """
    try:
        x11 = ctypes.CDLL("libX11.so.6")
        x11.XOpenDisplay.restype = ctypes.c_void_p
        x11.XCloseDisplay.argtypes = [ctypes.c_void_p]
        display = x11.XOpenDisplay(None)
    except OSError:
        display = None
    if not display:
        raise Refused(f"PyBullet cannot open a window: there is no X display {os.environ.get('DISPLAY', '')!r}")
    try:
        yield
    finally:
        x11.XCloseDisplay(display)
