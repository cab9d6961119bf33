"""Couplings of joints in PyBullet."""

from __future__ import annotations

from skiros2_common.tools.output import STDERR, discarded

with discarded(STDERR):  # its banner
    import pybullet


class Couplings:
    """Pairs of joints that keep equal positions.

    :param world: number of PyBullet's world.
    """

    def __init__(self, world: int) -> None:
        self._world = {"physicsClientId": world}
        #: Those that have seen no step: asked for their force, the engine ends the process.
        self._new: set[int] = set()

    def add(self, body: int, one: int, other: int, force: float) -> int:
        """Couples two joints of a body. Returns the coupling.

        :param force: largest force (N).
        """
        axis, origin = (1, 0, 0), (0, 0, 0)
        gear: int = pybullet.createConstraint(
            body, one, body, other, pybullet.JOINT_GEAR, axis, origin, origin, **self._world
        )
        pybullet.changeConstraint(gear, gearRatio=-1, erp=0.1, maxForce=force, **self._world)
        self._new.add(gear)
        return gear

    def force(self, coupling: int) -> float:
        """Returns the force on the first joint in the last step (N)."""
        return 0.0 if coupling in self._new else float(pybullet.getConstraintState(coupling, **self._world)[0])

    def after_step(self) -> None:
        """Called after each step."""
        self._new.clear()
