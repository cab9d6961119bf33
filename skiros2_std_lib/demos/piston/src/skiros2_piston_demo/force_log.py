"""The forces of an insertion over its depth: recorded from the state of the compliant controller."""

from __future__ import annotations

import math
import threading
from pathlib import Path
from typing import Any

import matplotlib
import rospy

from skiros2_sim_msgs.msg import ImpedanceState

matplotlib.use("Agg")
from matplotlib.figure import Figure

#: Depths outside are not part of the insertion (m).
_SHALLOWEST, _DEEPEST = -0.02, 0.065

#: Ends a line of the plot.
_GAP = (math.nan, math.nan, math.nan)


class ForceLog:
    """Records depth and force. Needs an initialised node.

    :param topic: of the controller's state.
    :param rim: height of the rim in the frame of the state (m).
    :param length: distance from the lower end of the part to the tool (m).
    """

    def __init__(self, topic: str, rim: float, length: float) -> None:
        self._offset = rim + length
        self._lock = threading.Lock()
        self._is_recording = False
        self._points: list[tuple[float, float, float]] = []
        self._subscriber = rospy.Subscriber(topic, ImpedanceState, self._on_state, queue_size=100)

    def close(self) -> None:
        """Unsubscribes."""
        self._subscriber.unregister()

    def record(self, is_inserting: bool) -> None:
        """Records while an insertion runs. Another one is another line in the plot."""
        if is_inserting and not self._is_recording:
            with self._lock:
                self._points.append(_GAP)
        self._is_recording = is_inserting

    @property
    def max_force(self) -> float:
        """The largest measured force (N)."""
        with self._lock:
            return max((force for _, _, force in self._points if math.isfinite(force)), default=0.0)

    def save(self, file: Path, limit: float) -> Path:
        """Saves a plot of the forces over the depth, with the limit (N).

        :returns: the file.
        """
        with self._lock:
            points = [p for p in self._points if p is _GAP or _SHALLOWEST < p[0] < _DEEPEST]
        figure = Figure(figsize=(8.0, 4.5))
        axes = figure.add_subplot()
        depths = [1000.0 * depth for depth, _, _ in points]
        axes.plot(depths, [force for _, _, force in points], linewidth=0.8, label="magnitude")
        axes.plot(depths, [along for _, along, _ in points], linewidth=0.8, label="along the axis")
        axes.axhline(limit, color="tab:red", linestyle="--", label="limit")
        axes.set_xlabel("depth below the estimated rim (mm)")
        axes.set_ylabel("force at the wrist (N)")
        axes.legend(loc="center left")
        figure.tight_layout()
        figure.savefig(file, dpi=120)
        return file

    def _on_state(self, message: Any) -> None:
        if not self._is_recording or not message.active:
            return
        force = message.measured_wrench.force
        depth = self._offset - message.pose.position.z
        with self._lock:
            self._points.append((depth, -force.z, math.hypot(force.x, force.y, force.z)))
