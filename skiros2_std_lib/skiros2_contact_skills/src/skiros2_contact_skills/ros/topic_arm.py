"""A compliant arm whose driver has the topics and services of a profile."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import rospy
from std_srvs.srv import Trigger

from skiros2_common.core.errors import SkirosError, UnknownName
from skiros2_common.core.failure_kind import FailureKind
from skiros2_contact_skills.core.state_force import MAX_RATE, ForceAdapter, StateForce
from skiros2_contact_skills.ros.controllers import Controllers
from skiros2_contact_skills.ros.driver_calls import DriverCalls, call, message_class, reconfigure
from skiros2_contact_skills.ros.driver_topics import DriverTopics
from skiros2_contact_skills.ros.profiles import Profile, Reading, along_base
from skiros2_contact_skills.ros.reading_guard import NOISY, ReadingGuard, Reason
from skiros2_motion.core.arm_abilities import Abilities, StatePeriod
from skiros2_motion.core.compliant_arm import (
    ArmState,
    Wrench,
    checked_limits,
    checked_reference,
    turned_wrench,
)
from skiros2_motion.core.force_control import ForceGoal
from skiros2_motion.core.geometry import IDENTITY, Pose, Vector, composed, conjugated, inverted, rotation_of
from skiros2_motion.core.impedance import MAX_DAMPING_FACTOR, MAX_STIFFNESS, MAX_WRENCH, STIFFNESS, checked
from skiros2_motion.core.reference_lead import bounded_reference
from skiros2_motion.core.regions import kept_out
from skiros2_motion.core.spiral import SpiralGoal, TimedSpiral
from skiros2_motion.core.state_age import StateAge
from skiros2_motion.core.wrench_guard import Limits, is_finite, limited_wrench
from skiros2_std_reasoners.ros.transforms import Transforms

log = logging.getLogger(__name__)

#: Period with which `state` sends a commanded wrench again (s): drivers may let it expire.
REFRESH = 0.2
#: Age of the measured wrench from which the tool of a stiff driver is held where it is (s, by the arm's clock).
BLIND = 0.1
#: Number of states by which their period is measured when the arm is taken.
MEASURED_STATES = 5
#: Minimum stiffness with which a wrench becomes an offset of the reference (N/m, Nm/rad), and maximum offset (m, rad).
_LEAST_STIFFNESS, _MAX_OFFSET = (50.0,) * 3 + (5.0,) * 3, 0.15
_ZERO: Wrench = (0.0,) * 6
#: Largest damping factor that other drivers are known to take.
_MOST_DAMPING = 2.0


class TopicArm(ForceAdapter):
    """Adapter of `CompliantArm` to a profile.

    A thread of its own sends commands and calls services, in their order. What the driver lacks is done here: a spiral
    is added to the reference at each `state`; without a topic for it, a wrench becomes an offset of the reference, by
    the stiffness; the limits are checked at each message of the state, and above one the arm holds its current pose;
    so it does when a number of the state is not finite, or the noisy wrench no longer changes. With limits, the lead of
    the reference is bounded (`reference_lead`). A stiff driver gets its pose and no wrench while its sensor is silent.
    Damping factors have no effect on a driver without them.

    :param names: names of the controllers (`compliant`, `position`), values of the other fields of the templates, and
        any name of the profile that differs.
    :param mount: pose of the arm in the profile's `base_frame`, if that is not the frame of the arm.
    :raises ConfigurationError: a message or a service of the driver is not installed, or the sensor has to be noisy.
    """

    FORCE_RATE = MAX_RATE

    def __init__(self, profile: Profile, names: Mapping[str, str], mount: Pose = IDENTITY) -> None:
        self._profile, self._names, self._mount = profile, names, mount
        self._controller = names["compliant"]
        self._topics = DriverTopics(profile, names)
        self._name, self._format = self._topics.name, self._topics.format
        self._base, self._tool = self._name("base_frame"), self._name("tool_frame")
        self._lock = threading.RLock()
        self._transforms = Transforms()
        self._transforms.listen()
        self._reading: Reading | None = None
        self._age, self._messages, self._stamp = StateAge(rospy.get_time), 0, 0.0
        self._problem = ""
        self._stop: Reason | None = None
        #: Whether the reference that was sent is nearer than the wanted one, and a stiff driver's sensor is silent.
        self._is_bounded = self._is_blind = False
        self._is_active = False
        self._controllers = Controllers(self._name("switch"), self._name("controllers"), names)
        self._needed, self._period = 0, StatePeriod()
        self._limits = Limits()
        self._zero = _ZERO
        self._stiffness: Sequence[float] = STIFFNESS
        self._stiffness_sent: Sequence[float] = ()
        self._wrench, self._wrench_sent = _ZERO, 0.0
        self._reference: Pose | None = None
        self._overlay = TimedSpiral()
        self._force = StateForce(self.FORCE_RATE)
        kind = message_class(profile.state[1])
        self._topic = names.get("state", self._format(profile.state[0]))
        self._guard = ReadingGuard(self._topic, names.get("sensor", NOISY) == NOISY, profile.is_stiff)
        self._subscriber = rospy.Subscriber(self._topic, kind, self._on_state, queue_size=1, tcp_nodelay=True)
        self._calls = DriverCalls(self._controller)

    def close(self) -> None:
        """Closes the connections. The arm is not commanded."""
        self._calls.close()
        self._subscriber.unregister()
        self._topics.close()

    # -- the port ---------------------------------------------------------------------------------------------------

    def now(self) -> float:
        with self._lock:  # the clock of the stamps, which is that of the driver
            return float(self._stamp + self._age.seconds if self._messages else rospy.get_time())

    def state(self) -> ArmState | None:
        now = self.now()
        with self._lock:
            reading, refused = self._reading, self._calls.problem
            if self._calls.is_waiting or (not (refused or self._problem) and self._messages < self._needed):
                return None
            if reading is None:
                why = refused or (self._stop.text if self._stop else self._problem)
                return ArmState(IDENTITY, _ZERO, now, why) if why else None
            late = f"no {self._topic} for {age:.1f} s" if (age := self._age.overdue()) else ""
            reason = why_stopped(refused, self._stop, reading.stopped, self._problem or late)
            if reason is None and not self._is_active:
                reason = Reason(f"controller {self._controller} is not active", FailureKind.CONTROLLER)
            wrench = without_zero(reading, self._zero)
            stamp = self._stamp
        if reason is not None:
            return ArmState(reading.pose, wrench, stamp, reason.text, reason.kind)
        self._refresh(now)
        return ArmState(reading.pose, wrench, stamp)

    def begin(self, takes_back: bool = True) -> None:
        with self._lock:
            self._calls.problem, self._stop = "", None
            self._reference = None
            self._overlay.clear()
            self._force.set_goal(None)
            self._wrench, self._stiffness_sent = _ZERO, ()
        self._calls.request(lambda: self._activate(takes_back))

    def resume(self) -> None:
        self.begin(takes_back=False)

    def end(self) -> None:
        with self._lock:
            reading = self._reading
            if reading is None or self._calls.problem or self._stop or reading.stopped:
                return
            self._wrench, self._reference = _ZERO, reading.pose
            self._overlay.clear()
            self._force.set_goal(None)
        self._calls.later(self._send_wrench)
        self._calls.later(self._send_reference)

    def set_reference(self, pose: Pose) -> None:
        reference = checked_reference(pose)
        with self._lock:
            if self._stop:  # until limits are set again; the state has the reason
                return
            self._reference = reference
            self._force.refresh()
        self._calls.later(self._send_reference)

    def set_stiffness(self, translational: Vector, rotational: Vector) -> None:
        values = checked("stiffness", (*translational, *rotational), MAX_STIFFNESS, lowest=0.0)
        kind = self._profile.stiffness
        with self._lock:
            before, self._stiffness = self._stiffness, kind.effective(values)
        if kind.service and before != self._stiffness:
            self._calls.later(lambda: reconfigure(self._format(kind.service), kind.values(values)))
        self._calls.later(self._send_stiffness)

    def set_damping(self, factors: Sequence[float]) -> None:
        values = checked("damping factor", factors, (MAX_DAMPING_FACTOR,) * 6, lowest=0.0)
        values = [min(value, _MOST_DAMPING) for value in values]
        self._calls.later(lambda: self._topics.send_damping(self._on_driver_axes(values)))

    def set_wrench(self, force: Vector, torque: Vector = (0.0, 0.0, 0.0)) -> None:
        fx, fy, fz, tx, ty, tz = checked("wrench", (*force, *torque), MAX_WRENCH)
        with self._lock:
            if self._stop:
                return
            self._wrench = (fx, fy, fz, tx, ty, tz)
        self._calls.later(self._send_wrench)

    def set_force_control(self, goal: ForceGoal | None) -> None:
        with self._lock:
            if not self._stop:
                self._force.set_goal(goal)

    def start_spiral(self, spiral: SpiralGoal) -> None:
        with self._lock:
            if not self._stop:
                self._overlay.start(spiral, self.now())

    def stop_overlay(self) -> None:
        with self._lock:
            self._overlay.stop()

    def set_wrench_limits(self, force: float, torque: float, axes: Sequence[float] = ()) -> None:
        limits = checked_limits(force, torque, axes)
        with self._lock:
            self._limits, self._stop = limits, None
            self._guard.restart()

    def zero_sensor(self) -> None:
        self._calls.request(self._zero_sensor)

    def abilities(self) -> Abilities:
        with self._lock:
            period = self._period.longest
        takes_wrench, takes_damping = self._topics.takes("wrench"), self._topics.takes("damping")
        return Abilities(False, takes_wrench, False, takes_damping, period, self._force.rate(period))

    @property
    def has_state(self) -> bool:
        """Whether the driver has sent a state."""
        return self._reading is not None

    # -- what is measured -------------------------------------------------------------------------------------------

    def _on_state(self, message: Any) -> None:
        """Called by the subscriber's thread with each message."""
        try:
            reading = self._profile.read(message, self._pose_of, self._tool)
        except (SkirosError, AttributeError, ValueError) as error:
            with self._lock:
                if self._problem != str(error):
                    log.warning("%s", error)
                self._problem = str(error)
            return
        with self._lock:
            self._age.receive()
            self._period.add(time.monotonic())
            self._stamp = message.header.stamp.to_sec() or rospy.get_time()
            self._messages += 1
            reason = self._guard.check(reading, self._zero, self._limits, float(rospy.get_time()))
            if is_finite(*reading.pose, reading.wrench):  # the last pose that is known is held otherwise
                self._reading, self._problem = reading, ""
            stops = reason is not None and self._stop is None
            if stops:
                self._stop, self._wrench = reason, _ZERO
                self._overlay.clear()
                self._force.set_goal(None)
                self._reference = self._reading.pose if self._reading is not None else None
            moves = stops or (reason is None and self._regulates())
        if stops:  # at once, before what is queued
            self._send_wrench()
        if moves:
            self._send_reference()

    def _regulates(self) -> bool:
        """Notes the measured force, and returns whether it moves the reference."""
        assert self._reading is not None
        state = ArmState(self._reading.pose, without_zero(self._reading, self._zero), self._stamp)
        return self._force.update(state, self._reference, self._stiffness[:3]) is not None

    def _pose_of(self, frame: str) -> Pose:
        found = self._transforms.find(self._base, frame)
        if found is None:
            raise UnknownName(f"tf has no transform from {self._base} to {frame or 'an empty frame'} ({self._topic})")
        return composed(inverted(self._mount), found)

    # -- commands, by the thread of commands ------------------------------------------------------------------------

    def _activate(self, takes_back: bool = True) -> None:
        """Waits for the driver, recovers it and switches to the compliant controller; or only sees if that runs."""
        self._topics.connect()
        if takes_back and self._reading is not None and self._reading.stopped:
            self._topics.recover()
        self._await_states(self._controllers.activate() if takes_back else self._controllers.is_active())

    def _check_active(self) -> None:
        """Notices that somebody else has switched off the controller."""
        self._is_active = self._is_active and self._controllers.is_active()

    def _await_states(self, is_active: bool = True) -> None:
        """Has `state` wait for new states: the next one may have been on its way, and the period is measured."""
        with self._lock:
            self._is_active = is_active
            self._needed = self._messages + MEASURED_STATES
            self._period.restart()

    def _zero_sensor(self) -> None:
        if self._name("zero"):
            call(self._name("zero"), Trigger)
        with self._lock:
            if self._reading is not None:
                self._zero = turned_wrench(conjugated(self._reading.pose.orientation), self._reading.wrench)

    def _send_reference(self) -> None:
        """Sends the reference with the overlay motion and the offset of the wrench, if these are done here."""
        with self._lock:
            if self._reference is None and self._reading is not None:
                self._reference = self._reading.pose  # once: an offset of the current pose would drift
            if (reference := self._force.sent or self._reference) is None:
                return
            reading = self._reading
            takes_wrench, offset = self._topics.takes("wrench"), self._overlay.offset(self.now())
            wanted = sent = shifted(reference, offset, _ZERO if takes_wrench else self._wrench, self._stiffness)
            if reading is not None:
                wrench = limited(self._wrench, self._limits) if takes_wrench else _ZERO
                wanted = kept_out(wanted, reading.pose, self._stiffness, self.regions)
                sent = bounded_reference(wanted, reading.pose, self._stiffness, wrench, self._limits)
                sent = reading.pose if self._is_blind else sent
            self._is_bounded = sent != wanted or bool(self.regions)
        self._move_to(composed(self._mount, sent))

    def _move_to(self, pose: Pose) -> None:
        """Sends a reference to the driver."""
        self._topics.send_reference(pose)

    def _send_wrench(self) -> None:
        with self._lock:
            wrench, self._wrench_sent = limited(_ZERO if self._is_blind else self._wrench, self._limits), self.now()
        if not self._topics.takes("wrench"):
            self._send_reference()
            return
        self._topics.send_wrench(wrench)

    def _send_stiffness(self) -> None:
        """Sends the stiffness, unless the driver has it."""
        with self._lock:
            values, before = self._on_driver_axes(self._stiffness), self._stiffness_sent
            if before and np.allclose(values, before, rtol=0.02, atol=0.5):
                return
            self._stiffness_sent = values
        self._topics.send_stiffness(values)

    def _on_driver_axes(self, values: Sequence[float]) -> Sequence[float]:
        """Returns values along the axes of the tool as the driver takes them."""
        if not self._profile.stiffness.along_base or (reading := self._reading) is None:
            return values
        return along_base(composed(self._mount, reading.pose).orientation, values)

    def _refresh(self, now: float) -> None:
        """Sends again what would expire, and what moves."""
        if self._profile.stiffness.along_base:  # the tool may have turned
            self._send_stiffness()
        with self._lock:
            was_blind, self._is_blind = self._is_blind, self._profile.is_stiff and self._age.seconds > BLIND
            turned = was_blind != self._is_blind
            resend = turned or (any(self._wrench) and not 0.0 <= now - self._wrench_sent < REFRESH)
            is_moving = turned or self._overlay.is_moving or self._is_bounded
        if self._controllers.is_due():
            self._calls.later(self._check_active)
        if resend:
            self._send_wrench()
        if is_moving:
            self._send_reference()


def why_stopped(refused: str, stop: Reason | None, driver: str, problem: str) -> Reason | None:
    """Returns why an arm does not follow commands; None if it does.

    :param refused: reason of a refused request; "" without one.
    :param stop: of the adapter.
    :param driver: why the driver has stopped; "" if it has not.
    :param problem: why the state is unknown; "" if it is known.
    """
    text = refused or (stop.text if stop else driver or problem)
    if not text:
        return None
    if stop:
        return Reason(text, stop.kind)
    return Reason(text, FailureKind.SAFETY if driver else FailureKind.RETRYABLE if refused else FailureKind.SENSOR)


def without_zero(reading: Reading, zero: Wrench) -> Wrench:
    """Returns the wrench of a reading without the zero of the sensor, which is along the axes of the tool."""
    turned = turned_wrench(reading.pose.orientation, zero)
    fx, fy, fz, tx, ty, tz = (a - b for a, b in zip(reading.wrench, turned, strict=True))
    return fx, fy, fz, tx, ty, tz


def shifted(reference: Pose, offset: Sequence[float], wrench: Wrench, stiffness: Sequence[float]) -> Pose:
    """Returns a reference with an offset (m, in its frame), and with that which exerts a wrench by the stiffness."""
    shift = [
        min(max(f / max(k, least), -_MAX_OFFSET), _MAX_OFFSET)
        for f, k, least in zip(wrench, stiffness, _LEAST_STIFFNESS, strict=True)
    ]
    x, y, z = (a + b for a, b in zip(offset, shift[:3], strict=True))
    return composed(reference, Pose((x, y, z), rotation_of(shift[3:])))


def limited(wrench: Wrench, limits: Limits) -> Wrench:
    """Returns a wrench that is shortened to the limits."""
    fx, fy, fz, tx, ty, tz = limited_wrench(np.array(wrench), limits).tolist()
    return fx, fy, fz, tx, ty, tz
