"""The record of one simulated execution: what rewards are computed from."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from skiros2_common.core.errors import UnknownName
from skiros2_common.core.names import nearest
from skiros2_common.core.world_model_port import WorldModelPort
from skiros2_motion.core.geometry import Pose, Vector

Array = npt.NDArray[np.float64]


@dataclass
class EpisodeRecord:
    """One execution.

    :param succeeded: whether the task ended with success.
    :param reason: why it did not; "" if it did.
    :param duration: simulated time (s).
    :param times: of the samples (s), shape (T,); the first one is 0, the last one `duration`.
    :param positions: of bodies, grippers and locations, by label, in the map (m): shape (T, 3).
    :param orientations: of the same, quaternions (x, y, z, w): shape (T, 4).
    :param series: other values by name, shape (T,): `ARM.force` (N) and `ARM.torque` (Nm) by the contacts of the hand,
        `ARM.measured_force` and `ARM.measured_torque` by the sensor at the wrist, `ARM.power` of the motors (W).
        Forces and torques are the maximum since the last sample; powers their mean.
    :param clearances: the distance (m) of pairs of labels, shape (T,), negative when they overlap; the pairs that
        rewards ask for.
    :param wmi: the world model after the execution.
    """

    succeeded: bool
    reason: str
    duration: float
    times: Array
    positions: Mapping[str, Array]
    orientations: Mapping[str, Array]
    series: Mapping[str, Array]
    clearances: Mapping[tuple[str, str], Array] = field(default_factory=dict)
    wmi: WorldModelPort | None = None

    @classmethod
    def of(
        cls,
        succeeded: bool,
        reason: str,
        times: Sequence[float],
        poses: Mapping[str, Sequence[Pose]],
        series: Mapping[str, Sequence[float]],
        clearances: Mapping[tuple[str, str], Sequence[float]],
        wmi: WorldModelPort,
    ) -> EpisodeRecord:
        """Makes a record of samples, one for each time."""
        return cls(
            succeeded,
            reason,
            times[-1],
            np.array(times),
            {label: np.array([pose.position for pose in taken]) for label, taken in poses.items()},
            {label: np.array([pose.orientation for pose in taken]) for label, taken in poses.items()},
            {name: np.array(values) for name, values in series.items()},
            {pair: np.array(values) for pair, values in clearances.items()},
            wmi,
        )

    def pose(self, label: str, index: int = -1) -> Pose:
        """Returns the true pose of a thing at a sample, in the map.

        :raises UnknownName: it was not recorded.
        """
        x, y, z = map(float, _found(self.positions, label, "thing")[index])
        qx, qy, qz, qw = map(float, self.orientations[label][index])
        return Pose((x, y, z), (qx, qy, qz, qw))

    def position(self, label: str, index: int = -1) -> Vector:
        """Returns the true position of a thing at a sample, in the map (m)."""
        return self.pose(label, index).position

    def distance(self, label: str, other: str) -> float:
        """Returns the distance of the origins of two things at the end (m)."""
        return math.dist(self.position(label), self.position(other))

    def path(self, label: str) -> Array:
        """Returns the positions of a thing, shape (T, 3)."""
        return _found(self.positions, label, "thing")

    def values_of(self, name: str) -> Array:
        """Returns a series, shape (T,)."""
        return _found(self.series, name, "series")


def _found(known: Mapping[str, Array], name: str, kind: str) -> Array:
    if name not in known:
        close = nearest(name, known)
        hint = f"near: {', '.join(close)}" if close else f"there are: {', '.join(sorted(known)) or 'none'}"
        raise UnknownName(f"no {kind} {name!r} was recorded; {hint}")
    return known[name]
