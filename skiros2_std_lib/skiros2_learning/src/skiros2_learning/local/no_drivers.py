"""A simulated world without drivers: for skills that use no actions and services of ROS."""

from __future__ import annotations

from contextlib import AbstractContextManager, nullcontext

from skiros2_sim.core.world import World


class NoDrivers:
    """The part of `LocalDrivers` that needs no ROS."""

    def __init__(self, world: World) -> None:
        self._world = world

    def step(self, count: int) -> None:
        """Makes steps of the world."""
        self._world.step(count)

    def installed(self) -> AbstractContextManager[None]:
        """Returns a context that changes nothing."""
        return nullcontext()
