"""A connection to PyBullet."""

from __future__ import annotations

import functools
from typing import Any

import pybullet

from skiros2_common.core.errors import Refused


class Bullet:
    """One physics world of PyBullet: `bullet.stepSimulation()` is `pybullet.stepSimulation(physicsClientId=id)`.

    :param gui: show PyBullet's window; only one world of a process can.
    :raises Refused: there is no window, or there are too many worlds.
    """

    def __init__(self, gui: bool = False) -> None:
        self.id: int = pybullet.connect(pybullet.GUI if gui else pybullet.DIRECT)
        if self.id < 0:
            what = "a window (is DISPLAY set?)" if gui else "another world"
            raise Refused(f"PyBullet cannot open {what}")

    def __getattr__(self, name: str) -> Any:
        found = getattr(pybullet, name)
        if callable(found) and not isinstance(found, type):
            found = functools.partial(found, physicsClientId=self.id)
        self.__dict__[name] = found
        return found

    def close(self) -> None:
        """Ends the world. Closing it twice does nothing."""
        if self.id >= 0:
            pybullet.disconnect(physicsClientId=self.id)
            self.id = -1
