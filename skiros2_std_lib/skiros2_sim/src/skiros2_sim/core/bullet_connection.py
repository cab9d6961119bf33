"""Connections to PyBullet, which has one world for each, and one window for each process."""

from __future__ import annotations

import ctypes
import os
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext

from skiros2_common.core.errors import Refused
from skiros2_common.tools.output import STDERR, discarded

with discarded(STDERR):  # its banner
    import pybullet


def connect(gui: bool) -> int:
    """Create a world. Return its id.

    :raises Refused: no window can be opened, or there are too many worlds.
    """
    with _display() if gui else nullcontext():
        client: int = pybullet.connect(pybullet.GUI if gui else pybullet.DIRECT)
    if client < 0:
        raise Refused(f"PyBullet cannot open {'a window' if gui else 'another world'}")
    if gui:
        for what in (pybullet.COV_ENABLE_GUI, pybullet.COV_ENABLE_SHADOWS):
            pybullet.configureDebugVisualizer(what, 0, physicsClientId=client)
    return client


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
