"""A compliant arm whose driver has the interfaces of `docs/simulation.md`, *The compliant controller*, over ROS.

A thread per arm sends commands in their order: services are called there, so that no tick waits for a driver.
"""

from __future__ import annotations

import logging
import math
import queue
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import rospy
from genpy import Message
from geometry_msgs.msg import Point, PoseStamped, Quaternion, Vector3, Wrench, WrenchStamped
from geometry_msgs.msg import Pose as PoseMessage
from std_msgs.msg import Header
from std_srvs.srv import Trigger

from controller_manager_msgs.srv import SwitchController, SwitchControllerRequest
from skiros2_common.core.errors import Refused, SkirosError, TimedOut
from skiros2_common.core.failure_kind import FailureKind
from skiros2_contact_skills.core.state_force import ForceAdapter, StateForce
from skiros2_contact_skills.ros.profiles import wrench_from
from skiros2_motion.core.arm_abilities import Abilities, StatePeriod
from skiros2_motion.core.compliant_arm import ArmState, checked_limits, checked_reference, turned_wrench
from skiros2_motion.core.force_control import ForceGoal, checked_goal
from skiros2_motion.core.geometry import Pose, Vector, composed, inverted
from skiros2_motion.core.impedance import MAX_DAMPING_FACTOR, MAX_STIFFNESS, MAX_WRENCH, checked
from skiros2_motion.core.regions import kept_out
from skiros2_motion.core.spiral import SpiralGoal
from skiros2_motion.core.state_age import StateAge
from skiros2_motion.core.wrench_guard import SENSOR_AGE, Limits, is_finite, is_limit, violation_text
from skiros2_sim_msgs.msg import ImpedanceState
from skiros2_sim_msgs.srv import (
    OverlayMotion,
    OverlayMotionRequest,
    SetAxisLimits,
    SetAxisLimitsRequest,
    SetForceControl,
    SetForceControlRequest,
    SetWrenchLimits,
    SetWrenchLimitsRequest,
)

log = logging.getLogger(__name__)

#: Time in which the driver must be there, and answer a request (s of wall time).
_CONNECTION_TIME = 5.0
#: Time in which a driver that is there answers for a service that it need not have (s of wall time).
_OPTIONAL_TIME = 0.2
#: Period with which `state` sends a commanded wrench again (s): without that, the driver lets it expire.
_REFRESH = 0.2
_REFUSED = "refuses limits"


class ImpedanceArm(ForceAdapter):
    """Adapter of `CompliantArm`.

    :param name: of the arm, for people.
    :param space: namespace of the compliant controller.
    :param wrist: namespace of the force/torque sensor.
    :param switch: service that switches controllers.
    :param controllers: names of the compliant controller and of the one that it replaces.
    :param mount: pose of the arm's base frame in the frame of the controller's state.
    """

    def __init__(
        self, name: str, space: str, wrist: str, switch: str, controllers: tuple[str, str], mount: Pose
    ) -> None:
        self._name, self._space, self._wrist, self._switch = name, space, wrist, switch
        self._controllers, self._mount = controllers, mount
        self._limits = Limits()
        self._fault = ""
        #: The commanded wrench, and the stamp of the state at which it was sent (s): its driver's clock lets it expire.
        self._wrench: Sequence[float] = ()
        self._wrench_at = 0.0
        #: Whether the driver regulates forces; if not, the loop at its states, and the pose that is wanted besides.
        self._has_loop = self._has_goal = False
        self._force = StateForce()
        self._wanted: Pose | None = None
        self._period = StatePeriod()
        self._lock = threading.Lock()
        self._last: ImpedanceState | None = None
        #: The last pose that is finite, which the arm holds at the end.
        self._finite: PoseMessage | None = None
        self._received, self._age = 0, StateAge(rospy.get_time)
        #: Requests that are not answered, and the number of the state that will show the effect of the last answer.
        self._pending, self._effect = 0, 1
        self._limits_since = rospy.Time()  # earlier states may wait in the driver's queue: they are not counted
        #: The largest force in the last state (N).
        self._peak = 0.0
        self._commands: queue.SimpleQueue[tuple[Callable[[], None], bool]] = queue.SimpleQueue()
        self._topics = {
            topic: rospy.Publisher(f"{space}/{topic}", kind, queue_size=10)
            for topic, kind in (
                ("reference_pose", PoseStamped),
                ("set_cartesian_stiffness", WrenchStamped),
                ("set_damping_factors", WrenchStamped),
                ("set_cartesian_wrench", WrenchStamped),
            )
        }
        self._subscribers = [rospy.Subscriber(f"{space}/state", ImpedanceState, self._on_state, queue_size=1)]
        threading.Thread(target=self._work, name=f"commands of {name}", daemon=True).start()

    def close(self) -> None:
        """Disconnects from the driver. Commands that were given are still sent, if it is there."""
        self._commands.put((self._stop_working, False))
        for subscriber in self._subscribers:
            subscriber.unregister()

    # -- the port ------------------------------------------------------------------------------------------------

    def now(self) -> float:
        with self._lock:
            if self._last is None:
                return float(rospy.get_time())
            return float(self._last.header.stamp.to_sec() + self._age.seconds)

    def state(self) -> ArmState | None:
        with self._lock:
            message, fault = self._last, self._fault
            if fault and message is None:
                raise Refused(f"{self._name}: {fault}")
            if message is None or self._pending or self._received < self._effect:
                return None
        stopped = fault or self._why_stopped(message)
        stamp = message.header.stamp.to_sec()
        if not stopped and any(self._wrench) and not 0.0 <= stamp - self._wrench_at <= _REFRESH:
            self._wrench_at = stamp
            self._publish_wrench("set_cartesian_wrench", self._wrench)
        kind = _kind_of(message, fault) if stopped else FailureKind.RETRYABLE
        return arm_state(message, self._mount, stamp, stopped)._replace(kind=kind)

    def begin(self) -> None:
        self._fault, self._wrench = "", ()
        with self._lock:
            self._wanted = None
            self._force.set_goal(None)
            self._period.restart()
        on, off = self._controllers
        request = SwitchControllerRequest(
            start_controllers=[on], stop_controllers=[off], strictness=SwitchControllerRequest.BEST_EFFORT
        )
        self._request(lambda: call_service(self._switch, SwitchController, request, f"does not switch to {on}"))
        self._request(self._find_loop)
        self.set_wrench_limits(*self._limits)

    def resume(self) -> None:
        if self._last is not None and self._last.active:
            self.begin()
        else:
            self._fault, self._wrench = "", ()

    def end(self) -> None:
        self._wrench = ()
        with self._lock:
            self._force.set_goal(None)
        # in the thread: the pose is then the last one
        self._request(self._rest)

    def set_reference(self, pose: Pose) -> None:
        wanted = checked_reference(pose)
        with self._lock:
            self._wanted = wanted
            self._force.refresh()
            if self._force.is_active or self.regions:  # the next state moves the reference
                return
        reference = composed(self._mount, wanted)
        self._command(lambda: self._publish_reference(reference))

    def set_stiffness(self, translational: Vector, rotational: Vector) -> None:
        self._publish_wrench(
            "set_cartesian_stiffness", checked("stiffness", (*translational, *rotational), MAX_STIFFNESS, lowest=0.0)
        )

    def set_damping(self, factors: Sequence[float]) -> None:
        self._publish_wrench(
            "set_damping_factors", checked("damping factor", factors, (MAX_DAMPING_FACTOR,) * 6, lowest=0.0)
        )

    def set_wrench(self, force: Vector, torque: Vector = (0.0, 0.0, 0.0)) -> None:
        self._wrench, self._wrench_at = checked("wrench", (*force, *torque), MAX_WRENCH), -math.inf
        self._publish_wrench("set_cartesian_wrench", self._wrench)

    def set_force_control(self, goal: ForceGoal | None) -> None:
        if goal is not None:
            checked_goal(goal)
        if self._has_loop:
            self._has_goal, request = goal is not None, force_request(goal)
            service = f"{self._space}/set_force_control"
            self._request(lambda: call_service(service, SetForceControl, request, "does not regulate forces"))
            return
        with self._lock:
            if goal is not None and not self._force.is_active and self._last is not None:
                self._wanted = arm_state(self._last, self._mount, 0.0).pose
            self._force.set_goal(goal)

    def abilities(self) -> Abilities:
        with self._lock:
            period = self._period.longest
            return Abilities(state_period=period, force_rate=math.inf if self._has_loop else self._force.rate(period))

    def start_spiral(self, spiral: SpiralGoal) -> None:
        request = OverlayMotionRequest(
            start=True,
            radius=spiral.radius,
            path_distance=spiral.path_distance,
            path_velocity=spiral.path_velocity,
            direction=Vector3(*spiral.direction),
            allow_decrease=spiral.allow_decrease,
        )
        self._request(lambda: call_service(f"{self._space}/overlay_motion", OverlayMotion, request, "refuses a spiral"))

    def stop_overlay(self) -> None:
        request = OverlayMotionRequest(start=False)
        service = f"{self._space}/overlay_motion"
        self._request(lambda: call_service(service, OverlayMotion, request, "does not stop its overlay motion"))

    def set_wrench_limits(self, force: float, torque: float, axes: Sequence[float] = ()) -> None:
        self._limits = checked_limits(force, torque, axes)
        self._request(self._send_limits)
        if axes:
            more = SetAxisLimitsRequest(Wrench(Vector3(*axes[:3]), Vector3(*axes[3:])))
            self._request(lambda: call_service(f"{self._space}/set_axis_limits", SetAxisLimits, more, _REFUSED))

    def zero_sensor(self) -> None:
        self._request(lambda: call_service(f"{self._wrist}/zero", Trigger, None, "does not zero its sensor"))

    # -- the thread ----------------------------------------------------------------------------------------------

    def _work(self) -> None:
        connected = False
        while True:
            command, is_request = self._commands.get()
            try:
                connected = connected or command == self._stop_working or _await_listeners(self._topics)
                command()
            except _Closed:
                for topic in self._topics.values():
                    topic.unregister()
                return
            except (SkirosError, rospy.ROSException, rospy.ServiceException) as error:
                log.warning("%s: %s", self._name, error)
                self._fault = self._fault or str(error)
            finally:
                if is_request:
                    with self._lock:
                        self._pending -= 1
                        # the next state may have been on its way before the answer
                        self._effect = self._received + 2

    def _send_limits(self) -> None:
        request = SetWrenchLimitsRequest(*self._limits[:2])
        answer = call_service(f"{self._space}/set_wrench_limits", SetWrenchLimits, request, _REFUSED)
        with self._lock:
            self._limits_since = answer.stamp

    def _find_loop(self) -> None:
        """Notes whether the driver regulates forces, and ends that."""
        service = f"{self._space}/set_force_control"
        try:
            rospy.wait_for_service(service, _OPTIONAL_TIME)
        except rospy.ROSException:
            self._has_loop = False
            return
        call_service(service, SetForceControl, force_request(None), "keeps regulating a force")
        self._has_loop, self._has_goal = True, False

    def _rest(self) -> None:
        message = self._last
        if message is None or not message.active or message.stopped_by:
            return
        self._wanted = None
        if self._finite is not None:
            p, q = self._finite.position, self._finite.orientation
            self._publish_reference(Pose((p.x, p.y, p.z), (q.x, q.y, q.z, q.w)))
        self._topics["set_cartesian_wrench"].publish(WrenchStamped())
        if self._has_goal:
            self._find_loop()
        if message.overlay:
            call_service(f"{self._space}/overlay_motion", OverlayMotion, OverlayMotionRequest(), "keeps moving")

    def _publish_reference(self, pose: Pose) -> None:
        message = self._last
        if message is None:
            raise Refused(f"no state on {self._space}/state yet: its frame is not known")
        header = Header(frame_id=message.header.frame_id)
        self._topics["reference_pose"].publish(PoseStamped(header, pose_message(pose)))

    def _publish_wrench(self, topic: str, values: Sequence[float]) -> None:
        message = WrenchStamped(wrench=Wrench(Vector3(*values[:3]), Vector3(*values[3:])))
        self._command(lambda: self._topics[topic].publish(message))

    def _command(self, command: Callable[[], None]) -> None:
        self._commands.put((command, False))

    def _request(self, command: Callable[[], None]) -> None:
        with self._lock:
            self._pending += 1
        self._commands.put((command, True))

    def _stop_working(self) -> None:
        raise _Closed

    # -- state ---------------------------------------------------------------------------------------------------

    def _on_state(self, message: ImpedanceState) -> None:
        with self._lock:
            self._last = message
            if _is_finite(message):
                self._finite = message.pose
            self._age.receive()
            self._period.add(message.header.stamp.to_sec())
            self._received += message.header.stamp >= self._limits_since
            if message.peak_force > self._peak:  # the driver keeps it until limits are set
                self._force.note(message.peak_force)
            self._peak = message.peak_force
            regulated = self._regulated(message)
        if regulated is not None:
            self._publish_reference(composed(self._mount, regulated))

    def _regulated(self, message: ImpedanceState) -> Pose | None:
        """Notes the measured force, and returns the reference that regulates it; None without one."""
        state = arm_state(message, self._mount, message.header.stamp.to_sec())
        if not is_finite(*state.pose, state.wrench):
            return None
        if message.stopped_by or not message.active:
            self._force.set_goal(None)
        stiffness = message.stiffness.force.x, message.stiffness.force.y, message.stiffness.force.z
        sent = self._force.update(state, self._wanted, stiffness)
        wanted = sent if sent or self._force.is_active else self._wanted
        if not self.regions or wanted is None or message.stopped_by or not message.active:
            return sent
        return kept_out(wanted, state.pose, stiffness, self.regions)

    def _why_stopped(self, message: ImpedanceState) -> str:
        late = self._age.overdue()
        if not message.active:
            return f"controller {self._controllers[0]} of arm {self._name} is not active"
        if message.stopped_by:
            value, limit = message.stop_value, message.stop_limit
            if message.stopped_by == SENSOR_AGE:
                return f"the wrench is limited, but was not measured for {value:.3f} s"
            return violation_text(message.stopped_by, value, limit)
        if late:
            return f"no state on {self._space}/state for {late:.1f} s"
        if not _is_finite(message):
            return f"the state on {self._space}/state is not finite"
        if (message.force_limit, message.torque_limit) != self._limits[:2]:
            limits = f"{message.force_limit:g} N and {message.torque_limit:g} Nm"
            return (
                f"the driver has the limits {limits}, not those that were set: it was restarted, or they were changed"
            )
        return ""


def _await_listeners(topics: Mapping[str, rospy.Publisher]) -> bool:
    """Waits until the driver listens to all topics, and returns True: what is published before that is lost.

    :raises TimedOut: it does not.
    """
    deadline = time.monotonic() + _CONNECTION_TIME
    while not rospy.is_shutdown():
        missing = [topic.name for topic in topics.values() if not topic.get_num_connections()]
        if not missing:
            return True
        if time.monotonic() > deadline:
            raise TimedOut(f"no driver listens to {missing[0]}")
        threading.Event().wait(0.02)
    raise _Closed


def call_service(name: str, kind: type, request: Message | None, problem: str) -> Any:
    """Calls a service. Returns its answer.

    :raises Refused: it answers that it has not done it.
    :raises rospy.ROSException: there is no such service.
    """
    rospy.wait_for_service(name, _CONNECTION_TIME)
    call = rospy.ServiceProxy(name, kind)
    answer = call() if request is None else call(request)
    if not getattr(answer, "ok", getattr(answer, "success", True)):
        raise Refused(f"{problem}: {getattr(answer, 'message', '') or name}")
    return answer


def pose_message(pose: Pose) -> PoseMessage:
    """Returns a pose as a message."""
    return PoseMessage(Point(*pose.position), Quaternion(*pose.orientation))


def force_request(goal: ForceGoal | None) -> SetForceControlRequest:
    """Returns the request to regulate forces; None for the one that ends it."""
    if goal is None:
        return SetForceControlRequest(start=False)
    force, tip = Vector3(*goal.force), Point(*goal.tip)
    return SetForceControlRequest(True, force, list(goal.axes), goal.speed, goal.admittance, tip)


def _is_finite(message: ImpedanceState) -> bool:
    """Whether all numbers of a state that skills use are finite."""
    poses = [(p.position.x, p.position.y, p.position.z) for p in (message.pose, message.reference)]
    turns = [(q.x, q.y, q.z, q.w) for q in (message.pose.orientation, message.reference.orientation)]
    return is_finite(*poses, *turns, wrench_from(message.measured_wrench), (message.force_limit, message.torque_limit))


def _kind_of(message: ImpedanceState, fault: str) -> FailureKind:
    """Returns the kind of the failure of a driver that does not follow commands.

    :param fault: of a request that was refused; "" if none was.
    """
    if message.stopped_by:
        return FailureKind.LIMIT if is_limit(message.stopped_by) else FailureKind.SENSOR
    if fault:
        return FailureKind.RETRYABLE
    return FailureKind.SENSOR if message.active else FailureKind.CONTROLLER


def arm_state(message: ImpedanceState, mount: Pose, stamp: float, stopped: str = "") -> ArmState:
    """Converts a state of the driver.

    :param mount: pose of the arm's base frame in the frame of the message.
    :param stamp: s.
    """
    p, q = message.pose.position, message.pose.orientation
    pose = composed(inverted(mount), Pose((p.x, p.y, p.z), (q.x, q.y, q.z, q.w)))
    force, torque = message.measured_wrench.force, message.measured_wrench.torque
    wrench = turned_wrench(pose.orientation, (force.x, force.y, force.z, torque.x, torque.y, torque.z))
    return ArmState(pose, wrench, stamp, stopped)


class _Closed(Exception):
    """Ends the thread."""
