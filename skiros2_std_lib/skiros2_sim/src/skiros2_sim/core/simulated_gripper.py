"""A gripper in the simulated world of this process. The thread that steps the world calls it."""

from __future__ import annotations

from collections.abc import Sequence

from skiros2_motion.core.gripper import GripperEvent
from skiros2_motion.core.motion import State
from skiros2_sim.core import gripper as fingers
from skiros2_sim.core.world import World


class SimulatedGripper:
    """Adapter of `Gripper`.

    :param commands: the commands of all clients of this gripper, which share the list.
    """

    def __init__(self, world: World, gripper: fingers.Gripper, commands: list[GripperEvent]) -> None:
        self._world, self._gripper = world, gripper
        self._motion: fingers.GripperMotion | None = None
        self._commands, self._first = commands, len(commands)

    def command(self, width: float, effort: float) -> None:
        self._commands.append(GripperEvent(self._world.time, width, effort))
        self._motion = fingers.GripperMotion(self._gripper, width, effort)
        self._world.motions.add(self._motion)

    def result(self) -> str | None:
        outcome = self._motion.outcome if self._motion is not None else None
        if outcome is None:
            return None
        return "" if outcome.state is State.SUCCEEDED else outcome.text

    def commands(self) -> Sequence[GripperEvent]:
        return tuple(self._commands[self._first :])

    def close(self) -> None:
        if self._motion is not None:
            self._motion.cancel()
