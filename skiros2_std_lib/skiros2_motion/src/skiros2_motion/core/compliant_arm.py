"""The port of a compliant arm: what contact skills need of a Cartesian impedance controller.

The controller's law is `J' (-K e - D J dq + F)`: the tool is pulled towards a reference pose by a spring with the
stiffness K, and exerts the wrench F. A skill changes reference, stiffness, wrench and overlay motion while the arm
moves; the driver checks the limits of the measured wrench at its own control rate.

Frames: the *base frame* is that of the element `rparts:ArmDevice`, the mount of the arm. The *tool frame* is between
the fingertips, z pointing out of the hand.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, Protocol, runtime_checkable

from skiros2_common.core.errors import WrongValue
from skiros2_common.core.failure_kind import FailureKind
from skiros2_motion.core.force_control import ForceGoal
from skiros2_motion.core.geometry import Pose, Quaternion, Vector, normalized, rotated
from skiros2_motion.core.numbers import finite
from skiros2_motion.core.regions import Region
from skiros2_motion.core.spiral import SpiralGoal
from skiros2_motion.core.wrench_guard import Limits

Wrench = tuple[float, float, float, float, float, float]

#: Seconds of the arm's clock without a state after which `ArmState.stopped` reports a stale state.
STALE = 0.5
#: Maximum distance of a reference from the base frame along each axis (m).
MAX_REACH = 3.0


class ArmState(NamedTuple):
    """The last state of an arm.

    :param pose: of the tool in the base frame (m).
    :param wrench: force (N) and torque about the tool (Nm) that the environment exerts on the hand, along the axes of
        the base frame. The weight of the hand is compensated; that of a held object is zeroed by `zero_sensor`.
    :param stamp: time of measurement (s, of the arm's clock).
    :param stopped: why the driver does not follow commands: an exceeded limit with its value, a refused request, no
        state since some time; "" if it follows. The arm then holds its pose and yields.
    :param kind: of that reason: `LIMIT` an exceeded limit, `SENSOR` a measurement that is missing or wrong,
        `CONTROLLER` the compliant controller is not active, `SAFETY` a robot that is stopped, `RETRYABLE` a refused
        request.
    """

    pose: Pose
    wrench: Wrench
    stamp: float
    stopped: str = ""
    kind: FailureKind = FailureKind.RETRYABLE


class CompliantArm(Protocol):
    """An arm. All methods return at once and are called by the thread that ticks skills.

    Commands take effect in the order of the calls. Numbers that are not finite or out of range are refused with all
    problems and change nothing (`WrongValue`); a request that the driver refuses later is reported in
    `ArmState.stopped`.
    """

    def now(self) -> float:
        """Returns the time of the arm's clock (s): simulated time in a simulation."""
        ...

    def state(self) -> ArmState | None:
        """Returns the last state. None while the driver has not answered all requests (`begin`, `start_spiral`,
        `stop_overlay`, `set_wrench_limits`, `zero_sensor`) and measured since: a state shows their effect."""
        ...

    def begin(self) -> None:
        """Activates the compliant controller, which holds the current pose, and ends a stop at a limit."""
        ...

    def end(self) -> None:
        """Leaves the arm at rest: compliant, the current pose as reference, without wrench and overlay motion. Does
        nothing after a stop: the driver holds the arm already."""
        ...

    def set_reference(self, pose: Pose) -> None:
        """Sets the pose that attracts the tool, in the base frame. It stays until the next one.

        :raises WrongValue: a number is not finite, or out of reach.
        """
        ...

    def set_stiffness(self, translational: Vector, rotational: Vector) -> None:
        """Sets the stiffness along (0 to 2000 N/m) and about (0 to 300 Nm/rad) the axes of the tool frame.

        :raises WrongValue: a number is not finite or out of range.
        """
        ...

    def set_damping(self, factors: Sequence[float]) -> None:
        """Sets six damping factors (0 to 6) along and about the axes of the tool frame. A driver may take less.

        :raises WrongValue: a number is not finite or out of range.
        """
        ...

    def set_wrench(self, force: Vector, torque: Vector = (0.0, 0.0, 0.0)) -> None:
        """Sets the wrench that the tool exerts, in the tool frame: up to 30 N and 10 Nm along and about each axis.
        A driver may let it expire: set it at each tick.

        :raises WrongValue: a number is not finite or out of range.
        """
        ...

    def start_spiral(self, spiral: SpiralGoal) -> None:
        """Adds a spiral to the reference, in place of the current one."""
        ...

    def stop_overlay(self) -> None:
        """Returns to the reference without an overlay motion."""
        ...

    def set_wrench_limits(self, force: float, torque: float, axes: Sequence[float] = ()) -> None:
        """Sets the limits of the measured force (N) and torque (Nm), 0 for none, and ends a stop at a limit.

        :param axes: limits of the magnitude along (N) and about (Nm) x, y, z of the tool frame, 0 for none; () for none
            at all.
        :raises WrongValue: a limit is negative or not finite, or there are not six of the axes.
        """
        ...

    def zero_sensor(self) -> None:
        """Makes the current measured wrench the zero of the following ones. The hand must be free of contact. A driver
        may compensate the weight of the held object from then on."""
        ...


@runtime_checkable
class KnowsMass(Protocol):
    """An arm that knows its inertia."""

    def apparent_mass(self, direction: Vector) -> float:
        """Returns the mass that the tool has in its current pose along a direction, a unit vector in the base frame
        (kg); very large at a singularity."""
        ...


@runtime_checkable
class ResumesControl(Protocol):
    """An arm that notices between two skills that somebody has switched off its compliant controller."""

    def resume(self) -> None:
        """As `begin`, for the next skill of a task: if the compliant controller is not active, it is not activated; the
        state then has the kind `CONTROLLER`."""
        ...


@runtime_checkable
class MeasuresPeak(Protocol):
    """An arm whose driver remembers the largest measured force between two states."""

    def take_peak(self) -> float:
        """Returns the largest magnitude of the measured force since the last call (N)."""
        ...


@runtime_checkable
class KeepsStates(Protocol):
    """An arm that keeps the states between two ticks."""

    def take_states(self) -> list[ArmState]:
        """Returns the states since the last call, the oldest first; at most those of two seconds."""
        ...


@runtime_checkable
class RegulatesForce(Protocol):
    """An arm whose driver regulates forces at its own control rate."""

    def set_force_control(self, goal: ForceGoal | None) -> None:
        """Regulates forces along selected axes; along the others the arm follows its reference. None, `begin`, `end`
        and a stop end it.

        :raises WrongValue: a number is not finite or out of range.
        """
        ...


@runtime_checkable
class KeepsOut(Protocol):
    """An arm that keeps its tool out of regions: by its driver, at the rate of the law, or by its adapter, which moves
    the reference at its states."""

    def set_regions(self, regions: Sequence[Region]) -> None:
        """Sets the regions, in the base frame, in place of those before. They stay after `end`."""
        ...


def checked_reference(pose: Pose) -> Pose:
    """Returns a reference with a normalised orientation.

    :raises WrongValue: a number is not finite, the position is out of reach or the orientation is not a unit
        quaternion; the text lists all problems.
    """
    numbers = finite((*pose.position, *pose.orientation), 7, "reference: position and orientation")
    problems = []
    if max(map(abs, numbers[:3])) > MAX_REACH:
        problems.append(f"position {pose.position} in the base frame: expected up to {MAX_REACH:g} m")
    if not 0.9 < sum(value * value for value in numbers[3:]) < 1.1:
        problems.append(f"orientation {pose.orientation}: expected a unit quaternion")
    if problems:
        raise WrongValue(f"reference: {'; '.join(problems)}")
    return Pose(pose.position, normalized(pose.orientation))


def checked_limits(force: float, torque: float, axes: Sequence[float] = ()) -> Limits:
    """Returns limits of force (N) and torque (Nm), and along and about the axes of the tool.

    :raises WrongValue: one is negative or not finite, or there are neither six of the axes nor none.
    """
    limits = finite((force, torque), 2, "limits of force and torque")
    if min(limits) < 0.0:
        raise WrongValue(f"limits of force and torque {limits}: expected 0 N, 0 Nm or more")
    each = finite(axes, 6, "limits along and about x, y, z of the tool") if len(axes) else []
    if min(each, default=0.0) < 0.0:
        raise WrongValue(f"limits along and about x, y, z of the tool {each}: expected 0 N, 0 Nm or more")
    return Limits(limits[0], limits[1], tuple(each))


def turned_wrench(orientation: Quaternion, wrench: Sequence[float]) -> Wrench:
    """Returns a wrench along the axes of another frame.

    :param orientation: of the frame of the wrench in the other one.
    """
    fx, fy, fz = rotated(orientation, wrench[:3])
    tx, ty, tz = rotated(orientation, wrench[3:])
    return fx, fy, fz, tx, ty, tz
