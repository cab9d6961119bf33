"""The force of a hand that drags a tool towards a marker."""

from __future__ import annotations

import math

from skiros2_gui.view3d.dragging import TIMEOUT
from skiros2_motion.core.geometry import Vector

#: Stiffness of the spring between tool and marker (N/m), and its largest force (N).
STIFFNESS, MAX_FORCE = 200.0, 20.0


class HandGuiding:
    """A spring from a tool to its marker, while the marker is dragged. Not thread-safe.

    Times are those of a monotonic clock (s). Without feedback for `TIMEOUT` a drag has ended: the view may be gone.
    """

    def __init__(self) -> None:
        self._marker: Vector | None = None
        self._last_feedback = float("-inf")

    def drag(self, marker: Vector, now: float) -> None:
        """The marker was dragged to a position (m, in the map)."""
        self._marker, self._last_feedback = marker, now

    def hold(self, now: float) -> None:
        """The mouse button is down and the marker does not move."""
        self._last_feedback = now

    def release(self) -> None:
        """The mouse button was released."""
        self._marker = None

    def is_dragged(self, now: float) -> bool:
        """Whether the marker is being dragged."""
        return self._marker is not None and now - self._last_feedback < TIMEOUT

    def force(self, tool: Vector, now: float) -> Vector | None:
        """Returns the force on the tool (N, in the map), `MAX_FORCE` at most; None if the marker is not dragged.

        :param tool: position of the tool (m, in the map).
        """
        if self._marker is None or not self.is_dragged(now):
            return None
        x, y, z = (STIFFNESS * (to - at) for to, at in zip(self._marker, tool, strict=True))
        scale = min(1.0, MAX_FORCE / max(math.hypot(x, y, z), 1e-9))
        return scale * x, scale * y, scale * z
