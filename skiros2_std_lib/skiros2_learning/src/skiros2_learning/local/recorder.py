"""Records what rewards read, while the world is stepped."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping

from skiros2_common.core.world_model_port import WorldModelPort
from skiros2_learning.core.episode_record import EpisodeRecord
from skiros2_learning.core.sections import UnknownNames, near
from skiros2_motion.core.geometry import Pose
from skiros2_sim.core.arm import Arm
from skiros2_sim.core.world import World

#: Distances of pairs are measured up to this one (m).
_FAR = 1.0
_SERIES = ("force", "torque", "measured_force", "measured_torque", "power")


class Recorder:
    """Takes a sample at each call of `sample`, and the extremes of forces and torques at each step.

    :param ids: of all elements of the scene, by label.
    :param fixed: poses in the map of elements without a body, such as goals, by label.
    :param things, pairs, series: what to record; see `rewards.names_used`.
    :raises UnknownNames: a label or a series does not exist.
    """

    outcome: object | None = None  # of a motion of the world: never ends

    def __init__(
        self,
        world: World,
        ids: Mapping[str, str],
        fixed: Mapping[str, Pose],
        things: Collection[str],
        pairs: Collection[tuple[str, str]],
        series: Collection[str],
    ) -> None:
        self._world = world
        self._fixed = fixed
        self._ids = ids
        arms = {label: world.arms[eid] for label, eid in ids.items() if eid in world.arms}
        known = {label for label, eid in ids.items() if eid in world} | set(fixed)
        solid = {label for label, eid in ids.items() if eid in world.bodies or eid in world.grippers}
        possible = {f"{arm}.{quantity}" for arm in arms for quantity in _SERIES}
        problems = {t: f"{t!r} has no shape" for pair in pairs for t in pair if t not in solid}
        problems |= {t: f"nothing with a pose is labelled {t!r}; {near(t, known)}" for t in things if t not in known}
        problems |= {s: f"there is no series {s!r}; {near(s, possible)}" for s in series if s not in possible}
        if problems:
            raise UnknownNames(problems)
        self._things = sorted(things)
        self._pairs = sorted(pairs)
        self._series = sorted(series)
        self._arms: dict[str, Arm] = {name: arms[name.rpartition(".")[0]] for name in self._series}
        self._now: dict[str, list[float]] = {name: [] for name in self._series}
        self._times: list[float] = []
        self._poses: dict[str, list[Pose]] = {label: [] for label in self._things}
        self._values: dict[str, list[float]] = {name: [] for name in self._series}
        self._clearances: dict[tuple[str, str], list[float]] = {pair: [] for pair in self._pairs}
        self._start = world.time

    # -- as a motion of the world ----------------------------------------------------------------------------------

    def update(self, dt: float) -> None:
        """Called before each step: measures the last one."""
        for name in self._series:
            self._now[name].append(self._measure(name))

    def cancel(self) -> None:
        """Does nothing: it moves nothing."""

    # -- samples ---------------------------------------------------------------------------------------------------

    def sample(self) -> None:
        """Takes a sample of the present state."""
        self._times.append(self._world.time - self._start)
        for label in self._things:
            pose = self._fixed[label] if label in self._fixed else self._world.pose_of(self._ids[label])
            self._poses[label].append(pose)
        for name in self._series:
            since = [*self._now[name], self._measure(name)]
            self._values[name].append(math.fsum(since) / len(since) if name.endswith(".power") else max(since))
            self._now[name] = []
        for pair in self._pairs:
            self._clearances[pair].append(self._distance(*pair))

    def record(self, succeeded: bool, reason: str, wmi: WorldModelPort) -> EpisodeRecord:
        """Returns all samples."""
        return EpisodeRecord.of(succeeded, reason, self._times, self._poses, self._values, self._clearances, wmi)

    def _measure(self, name: str) -> float:
        arm, quantity = self._arms[name], name.rpartition(".")[2]
        if quantity == "power":
            return math.fsum(abs(e * v) for e, v in zip(arm.efforts(), arm.velocities(), strict=True))
        wrench = arm.measured_wrench() if quantity.startswith("measured_") else arm.wrench()
        return math.hypot(*(wrench[:3] if quantity.endswith("force") else wrench[3:]))

    def _distance(self, label: str, other: str) -> float:
        one, two = (self._world.part_of(self._ids[each]) for each in (label, other))
        return min(self._world.physics.distance(one, two, _FAR), _FAR)
