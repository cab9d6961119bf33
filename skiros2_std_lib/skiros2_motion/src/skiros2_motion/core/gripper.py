"""The port of a gripper."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, Protocol


class GripperEvent(NamedTuple):
    """A command to the gripper.

    :param time: since the start of the path, or by the clock of the arms during a recording (s).
    :param width: between the fingers (m).
    :param effort: maximum force (N); 0 for the driver's default.
    """

    time: float
    width: float
    effort: float = 0.0


class Gripper(Protocol):
    """A gripper. Called by the thread that ticks skills; no method blocks."""

    def command(self, width: float, effort: float) -> None:
        """Moves the fingers to a distance (m) with a maximum force (N; 0 for the driver's default)."""
        ...

    def result(self) -> str | None:
        """Returns None while the last command is executed; "" after success, stalled fingers included; otherwise why it
        failed."""
        ...

    def commands(self) -> Sequence[GripperEvent]:
        """Returns the commands by whatever client since this gripper was connected."""
        ...

    def close(self) -> None:
        """Cancels a running command, and disconnects."""
        ...
