"""A connection to PyBullet, and the joints of its models."""

from __future__ import annotations

import ctypes
import functools
import math
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from typing import Any

from skiros2_common.core.errors import Refused
from skiros2_common.tools.output import STDERR, discarded

with discarded(STDERR):  # its banner
    import pybullet


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


_KINDS = {0: "revolute", 1: "prismatic", 4: "fixed"}


@dataclass(frozen=True)
class Joint:
    """A joint. Positions in rad or m, velocities per second, effort in Nm or N.

    :param index: of the joint and of its child link in PyBullet's model.
    :param child: name of the child link.
    :param lower: -inf (and `upper` inf) for a joint without limits.
    """

    name: str
    index: int
    kind: str
    child: str
    lower: float
    upper: float
    velocity: float
    effort: float

    @property
    def moves(self) -> bool:
        return self.kind != "fixed"

    @classmethod
    def of(cls, info: Sequence[Any]) -> Joint:
        """Creates a joint from the result of PyBullet's `getJointInfo`."""
        lower, upper = float(info[8]), float(info[9])
        if lower >= upper:  # PyBullet's mark of a joint without limits
            lower, upper = -math.inf, math.inf
        return cls(
            name=info[1].decode(),
            index=int(info[0]),
            kind=_KINDS.get(info[2], "other"),
            child=info[12].decode(),
            lower=lower,
            upper=upper,
            velocity=float(info[11]),
            effort=float(info[10]),
        )
