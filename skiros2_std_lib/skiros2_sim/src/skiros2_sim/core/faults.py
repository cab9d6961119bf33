"""Faults of robots in the simulated world, injected for tests."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Protocol

from skiros2_common.core.errors import UnknownName, WrongValue
from skiros2_motion.core.geometry import Pose, rotated
from skiros2_sim.core.arm import Arm
from skiros2_sim.core.gripper import Gripper
from skiros2_sim.core.robot import Robot
from skiros2_sim.core.scene_spec import BodySpec, CameraSpec
from skiros2_sim.core.wrist_sensor import Wrench

SLIPPING_GRIPPER = "slipping_gripper"
BLOCKED_PATH = "blocked_path"
LATE_SENSOR = "late_sensor"
SILENT_SENSOR = "silent_sensor"
NAN_SENSOR = "nan_sensor"
FROZEN_SENSOR = "frozen_sensor"
ZERO_SENSOR = "zero_sensor"

_OBSTACLE_SIZE = (0.4, 0.4, 1.0)
_OBSTACLE_COLOUR = (0.9, 0.3, 0.0, 1.0)
_MAX_LAG = 60.0  # s
_MAX_DISTANCE = 20.0  # m
_MAX_DURATION = 1e6  # s
_SPEED = 0.02  # m/s, under which a robot stands


_Distortion = Callable[[Wrench], Wrench]


@dataclass(frozen=True)
class Fault:
    """An active fault.

    :param until: simulated time of its end (s); inf until it is cleared.
    """

    kind: str
    target: str
    value: float
    until: float


@dataclass(frozen=True)
class _Kind:
    """A kind of fault.

    :param targets: returns the ids of elements that it applies to.
    :param what: describes these, for error texts.
    :param default: the value for 0.
    :param most: the maximum value.
    """

    targets: Callable[[], set[str]]
    what: str
    default: float
    most: float
    start: Callable[[str, float], None]
    end: Callable[[str], None]


class FaultyWorld(Protocol):
    """What faults need of a `World`."""

    @property
    def robots(self) -> Mapping[str, Robot]: ...

    @property
    def arms(self) -> Mapping[str, Arm]: ...

    @property
    def grippers(self) -> Mapping[str, Gripper]: ...

    @property
    def cameras(self) -> Mapping[str, CameraSpec]: ...

    @property
    def time(self) -> float: ...

    def add_body(self, spec: BodySpec) -> None: ...

    def remove_body(self, eid: str) -> None: ...


class Faults:
    """The faults of a world. A reset clears them."""

    def __init__(self, world: FaultyWorld) -> None:
        self._world = world
        self._active: dict[tuple[str, str], Fault] = {}
        self._kinds = {
            SLIPPING_GRIPPER: _Kind(
                lambda: set(world.grippers), "a gripper", 0.02, 1.0, self._slip, lambda eid: self._slip(eid, 1.0)
            ),
            BLOCKED_PATH: _Kind(
                lambda: {eid for eid, robot in world.robots.items() if robot.mobile},
                "a mobile robot",
                1.0,
                _MAX_DISTANCE,
                self._block,
                lambda eid: world.remove_body(obstacle_of(eid)),
            ),
            LATE_SENSOR: _Kind(
                lambda: {*world.cameras, *world.arms, *world.robots, *self._bases()},
                "a camera, an arm, a base or a robot",
                0.5,
                _MAX_LAG,
                lambda eid, value: None,
                lambda eid: None,
            ),
            SILENT_SENSOR: _Kind(
                lambda: set(world.arms),
                "an arm",
                1.0,
                1.0,
                lambda eid, value: world.arms[eid].silence_sensor(True),
                lambda eid: world.arms[eid].silence_sensor(False),
            ),
            NAN_SENSOR: self._distortion(NAN_SENSOR, 6.0, lambda arm, value: lambda wrench: _with_nan(wrench, value)),
            FROZEN_SENSOR: self._distortion(FROZEN_SENSOR, 1.0, lambda arm, value: _constant(arm.measured_wrench())),
            ZERO_SENSOR: self._distortion(ZERO_SENSOR, 1.0, lambda arm, value: _constant((0.0,) * 6)),
        }

    @property
    def active(self) -> list[Fault]:
        """The active faults, in the order of their start."""
        return list(self._active.values())

    def set(self, kind: str, target: str, value: float = 0.0, duration: float = 0.0) -> None:
        """Starts a fault; replaces an active one of the same kind and target.

        :param target: id of the element.
        :param value: 0 for the default. Slipping gripper: remaining fraction of its friction, up to 1; blocked path:
            distance of the obstacle from the centre of the robot (m); late sensor: delay (s); NaN sensor: number of
            the force or torque, 1 to 6; silent, frozen and zero sensor: ignored.
        :param duration: s of simulated time; 0 until it is cleared.
        :raises UnknownName: there is no such kind, or it does not apply to the target.
        :raises WrongValue: value or duration is out of range.
        """
        known = self._kind(kind, target)
        if not (math.isfinite(value) and 0 <= value <= known.most):
            raise WrongValue(f"{kind} of {target}: expected a value of 0 to {known.most}, got {value}")
        if not (math.isfinite(duration) and 0 <= duration <= _MAX_DURATION):
            raise WrongValue(f"{kind} of {target}: expected a duration of 0 to {_MAX_DURATION} s, got {duration}")
        self.clear(kind, target)
        known.start(target, value or known.default)
        until = self._world.time + duration if duration else math.inf
        self._active[kind, target] = Fault(kind, target, value or known.default, until)

    def clear(self, kind: str, target: str) -> None:
        """Ends a fault, if it is active.

        :raises UnknownName: there is no such kind, or it does not apply to the target.
        """
        known = self._kind(kind, target)
        if self._active.pop((kind, target), None) is not None:
            known.end(target)

    def update(self) -> None:
        """Ends expired faults. Called by the world before each step."""
        if self._active:
            for fault in self.active:
                if self._world.time >= fault.until:
                    self.clear(fault.kind, fault.target)

    def lag(self, target: str) -> float:
        """Returns the delay of a sensor (s)."""
        fault = self._active.get((LATE_SENSOR, target))
        return fault.value if fault is not None else 0.0

    def _kind(self, kind: str, target: str) -> _Kind:
        if kind not in self._kinds:
            raise UnknownName(f"there is no fault {kind!r}; expected one of: {', '.join(self._kinds)}")
        known = self._kinds[kind]
        targets = known.targets()
        if target not in targets:
            expected = ", ".join(sorted(targets)) or "none"
            raise UnknownName(f"{kind} of {target!r}: expected {known.what}: {expected}")
        return known

    def _distortion(self, kind: str, most: float, distortion: Callable[[Arm, float], _Distortion]) -> _Kind:
        """Returns a fault of the sensor at the wrist of an arm."""
        world = self._world
        return _Kind(
            lambda: set(world.arms),
            "an arm",
            1.0,
            most,
            lambda eid, value: world.arms[eid].distort_sensor(kind, distortion(world.arms[eid], value)),
            lambda eid: world.arms[eid].distort_sensor(kind, None),
        )

    def _bases(self) -> list[str]:
        return [robot.spec.base.id for robot in self._world.robots.values() if robot.spec.base is not None]

    def _slip(self, gripper: str, left: float) -> None:
        self._world.grippers[gripper].set_friction(left)

    def _block(self, target: str, ahead: float) -> None:
        """Puts an obstacle in the robot's direction of travel, or in front of it at rest; never into the robot."""
        robot = self._world.robots[target]
        pose = robot.pose()
        vx, vy, _ = robot.velocity()
        speed = math.hypot(vx, vy)
        way = (vx / speed, vy / speed, 0.0) if speed > _SPEED else (1.0, 0.0, 0.0)
        distance = max(ahead, robot.radius + math.hypot(*_OBSTACLE_SIZE[:2]) / 2)
        dx, dy, _ = rotated(pose.orientation, way)
        x, y, z = pose.position
        at = (x + distance * dx, y + distance * dy, z + _OBSTACLE_SIZE[2] / 2)
        spec = BodySpec(
            obstacle_of(target),
            label="obstacle",
            pose=Pose(at, pose.orientation),
            size=_OBSTACLE_SIZE,
            colour=_OBSTACLE_COLOUR,
        )
        self._world.add_body(spec)


def obstacle_of(robot: str) -> str:
    """Returns the id of the body that blocks the path of a robot."""
    return f"obstacle of {robot}"


def _constant(wrench: Wrench) -> _Distortion:
    return lambda _: wrench


def _with_nan(wrench: Wrench, number: float) -> Wrench:
    fx, fy, fz, tx, ty, tz = (math.nan if i == round(number) else value for i, value in enumerate(wrench, 1))
    return fx, fy, fz, tx, ty, tz
