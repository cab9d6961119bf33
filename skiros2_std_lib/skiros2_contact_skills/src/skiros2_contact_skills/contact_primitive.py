"""The base of primitives that move a compliant arm in contact.

Each tick reads the state of the arm and changes its reference, stiffness, wrench or overlay motion; no hook waits. The
driver checks the limits of the wrench at its control rate: when it has stopped, the next tick fails with its reason and
its kind, so that nothing retries it.
However a primitive ends, it leaves the arm at rest and compliant.
"""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Sequence
from contextlib import suppress
from typing import Any

from skiros2_common.core.abstract_skill import State
from skiros2_common.core.errors import Refused, SkirosError
from skiros2_common.core.failure_kind import FailureKind
from skiros2_common.core.primitive import PrimitiveBase
from skiros2_common.core.task_context import current_task
from skiros2_common.core.world_element import Element
from skiros2_contact_skills.arms import give_back, take_arm
from skiros2_contact_skills.fit import Fit, fit_of
from skiros2_contact_skills.held_parts import lost_part
from skiros2_contact_skills.never_regions import check_outside, regions_of
from skiros2_motion.core.arm_abilities import Abilities, abilities_of
from skiros2_motion.core.compliant_arm import ArmState, CompliantArm, KeepsOut, KnowsMass, MeasuresPeak, ResumesControl
from skiros2_motion.core.geometry import Vector, conjugated, rotated
from skiros2_motion.core.impact import DEFAULT_MASS, DEFAULT_STIFFNESS, permitted_speed
from skiros2_motion.core.impedance import MAX_STIFFNESS
from skiros2_motion.core.numbers import finite
from skiros2_motion.core.regions import Region
from skiros2_motion.core.time_scaling import MAX_PERIOD
from skiros2_motion.core.wrench_guard import is_finite
from skiros2_std_skills.core.controller_use import is_left_compliant, is_left_in_order, leave_compliant

log = logging.getLogger(__name__)

#: Progress codes of failures.
NOT_READY = -120
STOPPED = -121
NO_CONTACT = -122
NOT_FOUND = -123
NO_PROGRESS = -124
NOT_REACHED = -125
NOT_HELD = -126
RETRACTED = -127
OVERSHOT = -128
NO_CLICK = -131
WRONG_CLICK = -132
WRONG_SOCKET = -133
NOT_RELEASED = -134

#: Default limits of the measured wrench (N, Nm).
MAX_FORCE, MAX_TORQUE = 40.0, 15.0
#: A peak up to this factor of the limit is reported; one above it fails the motion.
OVERSHOOT = 1.2
#: Of the element of an arm that does not know them: its apparent mass (kg), and the stiffness of its contacts (N/m).
APPARENT_MASS, CONTACT_STIFFNESS = "skiros:ApparentMass", "skiros:ContactStiffness"
#: Time in which the driver has to activate the controller and send a state (s), by the arm's clock, and by the wall
#: clock, which shows that a simulator has died.
READY_TIME, READY_WALL_TIME = 5.0, 15.0
#: Kinds of a stop of the arm.
_STOPS = (FailureKind.LIMIT, FailureKind.SENSOR, FailureKind.SAFETY)


class ContactPrimitive(PrimitiveBase):
    """Base class. A subclass overrides `begin` and `move`.

    :ivar arm: the arm, between start and end.
    :ivar start: state of the arm at the first tick of `move`.
    :ivar regions: that no tool enters, in the base frame.
    :ivar abilities: what the driver does itself, and the measured period of its state; from `begin` on.
    """

    replays_progress = True
    arm: CompliantArm
    start: ArmState
    abilities: Abilities
    regions: list[Region]
    #: Damping factors along and about the axes of the tool.
    damping: tuple[float, ...] = (2.0,) * 6

    def begin(self, state: ArmState) -> None:
        """To override: called once, before the first `move`."""

    def move(self, state: ArmState, dt: float) -> State:
        """To override: one tick. Returns `step`, `success` or `fail`.

        :param dt: time since the last tick, by the arm's clock; at most `MAX_PERIOD` (s).
        """
        raise NotImplementedError(f"{type(self).__name__} has to define move")

    # -- hooks -------------------------------------------------------------------------------------------------

    def onStart(self) -> bool:
        self._waits_since: tuple[float, float] | None = None  # for the arm; None: it is ready
        self._last = self._peak = 0.0
        self._slowed, self._along = "", MAX_STIFFNESS[2]
        self._begun = self._has_arm = self._is_taken = self._resumes = self._was_inactive = False
        self._is_hit = self._succeeded = False
        try:
            self.arm = take_arm(self.wmi, self.element("Robot"), self.element("Arm"), self)
            self._has_arm = True
            self._axes = [*self._limits_of("MaxForceAxes"), *self._limits_of("MaxTorqueAxes")]
            self._task = current_task()
            self._resumes = isinstance(self.arm, ResumesControl) and is_left_compliant(
                self.element("Arm").id, self._task
            )
            self._take_control()
        except SkirosError as error:
            give_back(self)
            return self.startError(f"{self.label_of('Arm')}: {error}", NOT_READY)
        return True

    def _take_control(self) -> None:
        """Activates the controller and sets the limits. If an earlier skill of the task or goal has activated it, it is
        not taken back from somebody else. While it is not known whether the arm has stopped since the success of that
        skill, and after such a stop, nothing is taken: limits would clear the stop. A retreat clears it: it follows a
        failure, if only of a skill that was preempted before it had the arm."""
        arm = self.arm
        if self._resumes and isinstance(arm, ResumesControl):
            if is_left_in_order(self.element("Arm").id) and not self.fails_late:
                found = self._state_before()
                if found is None or (found.stopped and found.kind in _STOPS):
                    return
            arm.resume()
        else:
            found = self._state_before()
            self._was_inactive = found is None or found.kind is FailureKind.CONTROLLER
            arm.begin()
        axes = [self._axes] if any(self._axes) else []  # arms of others may have none
        arm.set_wrench_limits(self.limit, self.number("MaxTorque", MAX_TORQUE), *axes)
        self._is_taken = True

    def _state_before(self) -> ArmState | None:
        """Returns the state before anything is requested."""
        with suppress(Refused):  # by an earlier request
            return self.arm.state()
        return None

    def execute(self) -> State:
        try:
            return self._tick()
        except SkirosError as error:
            return self.fail(f"{self.label_of('Arm')}: {error}", NOT_READY)

    def _tick(self) -> State:
        if not self._is_taken:
            self._take_control()
        state = self.arm.state()
        if state is not None and not state.stopped and not self._is_taken:
            state = None  # the answer has come since: the next tick takes the arm
        if state is not None and not state.stopped and not is_finite(*state.pose, state.wrench, (state.stamp,)):
            state = state._replace(stopped="its state has numbers that are not finite", kind=FailureKind.SENSOR)
        if state is None or (state.stopped and not self._begun and not self._is_final(state.kind)):
            return self._wait(state)
        self._note_peak(state)
        if state.stopped:
            self._is_hit = not self._is_taken
            peak = f" (peak of {self._peak:.1f} N)" if self._peak > self.limit else ""
            return self.fail(f"{self.label_of('Arm')} has stopped: {state.stopped}{peak}", STOPPED, state.kind)
        self._waits_since = None
        if not self._begun:
            lost = lost_part(self.wmi, self.element("Robot"), self.element("Arm")) if self._was_inactive else ""
            if lost:  # the driver may have been restarted
                return self.fail(f"{self.label_of('Arm')} was not compliant; {lost}", NOT_HELD, FailureKind.CONTROLLER)
            self._begun, self.start, self._last = True, state, state.stamp
            self.abilities = abilities_of(self.arm)
            if not self.abilities.limits:
                log.info("%s of %s: %s", self.label_of("Arm"), self.label, self.abilities)
            self.arm.set_damping(self.damping)
            self._keep_out(state)
            self.begin(state)
        dt, self._last = min(max(0.0, state.stamp - self._last), MAX_PERIOD), state.stamp
        result = self.move(state, dt)
        if result is State.Success:
            result = self._judged(self.progress_msg)
        self._succeeded = result is State.Success
        return result

    def _is_final(self, kind: FailureKind) -> bool:
        """Whether waiting does not end a stop that is found at the start."""
        if kind is FailureKind.SAFETY:
            return not self._is_taken  # else `begin` may still recover the robot
        return kind is FailureKind.LIMIT or (kind is FailureKind.CONTROLLER and self._resumes)

    def _keep_out(self, state: ArmState) -> None:
        """Gives the arm the regions that no tool enters.

        :raises WrongValue: a region is not usable, or the tool is in one.
        """
        self.regions = regions_of(self.wmi, self.element("Arm"))
        if isinstance(self.arm, KeepsOut):
            self.arm.set_regions(self.regions)
        elif self.regions:
            names = ", ".join(region.name for region in self.regions)
            log.warning("%s of %s does not keep its tool out of %s", self.label_of("Arm"), self.label, names)
        check_outside(self.regions, f"the tool of {self.label_of('Arm')}", state.pose.position, least=0.0)

    def _wait(self, state: ArmState | None) -> State:
        """Waits until the driver follows commands. Only refused requests are repeated: what has stopped the arm since
        `onStart` is not cleared."""
        now, wall = self.arm.now(), time.monotonic()
        if self._waits_since is None:
            self._waits_since = now, wall
        since, wall_since = self._waits_since
        if now - since < READY_TIME and wall - wall_since < READY_WALL_TIME:
            if state is not None and state.kind is FailureKind.RETRYABLE:
                self.arm.begin()
            return self.step("waiting for the compliant controller")
        reason, kind = (
            (state.stopped, state.kind) if state is not None else ("it does not answer", FailureKind.RETRYABLE)
        )
        return self.fail(f"{self.label_of('Arm')} is not ready after {READY_TIME:g} s: {reason}", NOT_READY, kind)

    def _note_peak(self, state: ArmState) -> None:
        """Keeps the largest force since `begin`, in the parameter `PeakForce` if the skill has it."""
        peak = self.arm.take_peak() if isinstance(self.arm, MeasuresPeak) else 0.0
        if self._begun:
            self._peak = max(self._peak, force_of(state), peak)
            if "PeakForce" in self.params:
                self.params["PeakForce"].values = [self._peak]

    def _judged(self, text: str) -> State:
        """Succeeds, unless the peak of the force was far above the limit; says that it was above, and the slowing."""
        text += f"; {self._slowed}" if self._slowed else ""
        if self._peak <= self.limit:
            return self.success(text)
        text += f"; peak of {self._peak:.1f} N above the limit of {self.limit:g} N"
        return (
            self.success(text) if self._peak <= OVERSHOOT * self.limit else self.fail(text, OVERSHOT, FailureKind.LIMIT)
        )

    def onEnd(self) -> bool:
        if not self._has_arm:
            return True
        try:
            self.arm.end()
            if self._begun or self._is_hit:
                leave_compliant(self.element("Arm").id, self._task, self._succeeded)
        except SkirosError as error:
            self.fail(f"{self.label_of('Arm')}: {error}", NOT_READY)
            return False
        finally:
            give_back(self)
        return True

    def _limits_of(self, key: str) -> list[float]:
        """Returns the limits of three axes; 0 for none."""
        values = self.params[key].values if key in self.params else []
        return finite(values, 3, key) if values else [0.0] * 3

    # -- for subclasses ----------------------------------------------------------------------------------------

    def element(self, key: str) -> Element:
        """Returns the element in a parameter."""
        found: Element = self.params[key].value
        return found

    def value(self, key: str) -> Any:
        """Returns the value of a parameter."""
        return self.params[key].value

    def optional_element(self, key: str) -> Element | None:
        """Returns the element in an optional parameter; None without one."""
        values = self.params[key].values
        return values[0] if values and values[0].getIdNumber() >= 0 else None

    def number(self, key: str, default: float) -> float:
        """Returns the number in a parameter without a default of its own."""
        values = self.params[key].values
        return float(values[0]) if values else default

    def fit(self) -> Fit:
        """Returns how the part of the parameters fits into the bore.

        :raises WrongValue: it does not, or a property in the world model is not usable.
        """
        return fit_of(self.wmi, self.optional_element("Part"), self.optional_element("Bore"))

    def label_of(self, key: str) -> str:
        """Returns the name of the element in a parameter."""
        element = self.element(key)
        return str(element.label or element.id)

    def surface(self) -> Vector:
        """Returns the point of contact: that of the parameter, or else the position of the tool at the start."""
        given = self.params["Surface"].values
        x, y, z = given if len(given) == 3 else self.start.pose.position
        return x, y, z

    def depth(self, state: ArmState) -> float:
        """Returns how far the tool is below the surface, along its axis (m)."""
        return dot(axis_of(state), difference(state.pose.position, self.surface()))

    @property
    def limit(self) -> float:
        """The limit of the measured force (N)."""
        return self.number("MaxForce", MAX_FORCE)

    def permitted(self, speed: float, direction: Vector, preload: float = 0.0, stiffness: float | None = None) -> float:
        """Returns a speed at which a contact stays below the limit of the force (see `skiros2_motion.core.impact`),
        also while the limit is not noticed: the given one, or a lower one, which the result of the motion reports.

        :param speed: that is asked for (m/s).
        :param direction: of the motion, a unit vector in the base frame.
        :param preload: force with which the motion pushes besides (N).
        :param stiffness: of the contact (N/m); None for that of the arm's element.
        """
        element = self.element("Arm")
        stiffness = stiffness or float(element.value_of(CONTACT_STIFFNESS) or DEFAULT_STIFFNESS)
        if isinstance(self.arm, KnowsMass):
            mass = self.arm.apparent_mass(direction)
        else:
            mass = float(element.value_of(APPARENT_MASS) or DEFAULT_MASS)
        late = self.abilities.added_force(1.0, self._along)
        limit = self._limit_along(direction)
        permitted = permitted_speed(limit - preload, mass, stiffness, late)
        if speed <= permitted:
            return speed
        to = f"slowed from {1000 * speed:.0f} to {1000 * permitted:.0f} mm/s"
        self._slowed = f"{to}: {mass:.1f} kg that meet {stiffness:.2g} N/m stay below {limit:g} N"
        if late:
            self._slowed += f", noticed within {1000 * self.abilities.reaction_time:.0f} ms"
        return permitted

    def _limit_along(self, direction: Vector) -> float:
        """Returns the largest force along a direction in the base frame that is within all limits (N)."""
        way = rotated(conjugated(self.start.pose.orientation), direction)
        pairs = zip(self._axes[:3], map(abs, way), strict=True)
        return min([self.limit, *(limit / part for limit, part in pairs if limit and part > limit / self.limit)])

    def set_stiffness(self, along: float, turning: float | None = None) -> None:
        """Sets the stiffness of the parameters, and that along (N/m) and about (Nm/rad) the tool axis."""
        self._along = along
        across, about = self.value("Stiffness"), self.value("RotationalStiffness")
        self.arm.set_stiffness((across, across, along), (about, about, turning or max(about, 30.0)))


def axis_of(state: ArmState) -> Vector:
    """Returns the direction of the tool axis, in the base frame."""
    return rotated(state.pose.orientation, (0.0, 0.0, 1.0))


def pressed(state: ArmState) -> float:
    """Returns the measured force with which the tool presses along its axis (N)."""
    return -dot(axis_of(state), state.wrench[:3])


def force_of(state: ArmState) -> float:
    """Returns the magnitude of the measured force (N)."""
    return math.hypot(*state.wrench[:3])


def forces(state: ArmState) -> str:
    """Formats the measured wrench for a progress message."""
    return f"{force_of(state):.1f} N, {math.hypot(*state.wrench[3:]):.2f} Nm"


def dot(a: Sequence[float], b: Sequence[float]) -> float:
    """Returns the scalar product."""
    return sum(x * y for x, y in zip(a, b, strict=True))


def difference(a: Sequence[float], b: Sequence[float]) -> Vector:
    """Returns a - b."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


def moved(point: Sequence[float], direction: Sequence[float], distance: float) -> Vector:
    """Returns a point that is moved along a direction."""
    x, y, z = (p + d * distance for p, d in zip(point, direction, strict=True))
    return x, y, z
