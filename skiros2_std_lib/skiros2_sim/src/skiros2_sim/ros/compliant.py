"""The topics and services of an arm's controllers, below their names. Those of the compliant one are as in
laboratories."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Sequence

import rospy
from genpy import Message
from geometry_msgs.msg import PoseStamped, Vector3, WrenchStamped
from std_msgs.msg import Header
from std_srvs.srv import Trigger, TriggerRequest, TriggerResponse

from skiros2_common.core.errors import Refused, SkirosError, WrongValue
from skiros2_motion.core.force_control import ForceGoal
from skiros2_motion.core.geometry import composed, inverted
from skiros2_motion.core.spiral import SpiralGoal
from skiros2_sim.core.arm_controller import ArmController
from skiros2_sim.core.robot_model import BASE_LINK
from skiros2_sim.core.scene_spec import ArmSpec, RobotSpec
from skiros2_sim.core.stepper import Stepper
from skiros2_sim.core.world import World
from skiros2_sim.ros.device_server import Device
from skiros2_sim.ros.frames import Frames
from skiros2_sim.ros.messages import pose_from, pose_message, vector_from, wrench_message
from skiros2_sim.ros.publishers import LateTopic, SimulatedClock
from skiros2_sim.ros.services import answered
from skiros2_sim_msgs.msg import ImpedanceState
from skiros2_sim_msgs.srv import (
    OverlayMotion,
    OverlayMotionRequest,
    OverlayMotionResponse,
    SetAxisLimits,
    SetAxisLimitsRequest,
    SetAxisLimitsResponse,
    SetForceControl,
    SetForceControlRequest,
    SetForceControlResponse,
    SetWrenchLimits,
    SetWrenchLimitsRequest,
    SetWrenchLimitsResponse,
)
from skiros2_std_skills.core import driver_names as names

log = logging.getLogger(__name__)

#: Rate of the state and of the sensor at the wrist (Hz of simulated time).
_STATE_RATE = 100


class CompliantArm:
    """The interface of one arm. An invalid command is logged with its reason, and changes nothing.

    :param controllers: controllers of all arms, by id of the arm; replaced by a reset.
    :param device: executes the goals of the arm.
    :param wrench_timeout: time (s) after which a commanded wrench becomes 0; 0 for never.
    """

    def __init__(
        self,
        robot: RobotSpec,
        arm: ArmSpec,
        stepper: Stepper,
        clock: SimulatedClock,
        frames: Frames,
        controllers: dict[str, ArmController],
        device: Device,
        wrench_timeout: float,
    ) -> None:
        self._arm = arm
        self._stepper, self._clock, self._frames = stepper, clock, frames
        self._controllers, self._device = controllers, device
        self._wrench_timeout = wrench_timeout or math.inf
        self._tool = f"{robot.name}/{arm.name}/tool"
        self._base = f"{robot.name}/{BASE_LINK}"
        self._joints = [joint.name for joint in controllers[arm.id].arm.joints]
        space = names.controller_topics(robot.name, arm.name, arm.compliant_controller)
        stiff = names.controller_topics(robot.name, arm.name, arm.position_controller)
        wrist = names.WRIST.format(robot=robot.name, part=arm.name)
        faults = (robot.id, arm.id)
        self._state = LateTopic(f"{space}/state", ImpedanceState, faults)
        self._wrist = LateTopic(f"{wrist}/wrench", WrenchStamped, faults)
        self._subscribers = [
            rospy.Subscriber(f"{space}/{name}", kind, self._logged(f"{space}/{name}", handle), queue_size=1)
            for name, kind, handle in (
                ("reference_pose", PoseStamped, self._on_reference),
                ("set_cartesian_stiffness", WrenchStamped, self._on_stiffness),
                ("set_damping_factors", WrenchStamped, self._on_damping),
                ("set_cartesian_wrench", WrenchStamped, self._on_wrench),
            )
        ]
        self._services = [
            rospy.Service(f"{space}/overlay_motion", OverlayMotion, answered(OverlayMotionResponse, self._on_overlay)),
            rospy.Service(
                f"{space}/set_wrench_limits", SetWrenchLimits, answered(SetWrenchLimitsResponse, self._on_limits)
            ),
            rospy.Service(
                f"{space}/set_axis_limits", SetAxisLimits, answered(SetAxisLimitsResponse, self._on_axis_limits)
            ),
            rospy.Service(
                f"{stiff}/set_wrench_limits",
                SetWrenchLimits,
                answered(SetWrenchLimitsResponse, self._on_position_limits),
            ),
            rospy.Service(
                f"{space}/set_force_control",
                SetForceControl,
                answered(SetForceControlResponse, self._on_force_control),
            ),
            rospy.Service(f"{wrist}/zero", Trigger, self._on_zero),
        ]

    def close(self) -> None:
        """Shuts topics and services down."""
        for subscriber in self._subscribers:
            subscriber.unregister()
        for service in self._services:
            service.shutdown()

    def after_step(self) -> None:
        """Publishes what is due. Called in the stepping thread."""
        if self._stepper.count % (self._stepper.step_rate // _STATE_RATE):
            return
        self._publish()

    def _publish(self) -> None:
        controller = self._controllers[self._arm.id]
        for topic, message, is_measured in (
            (self._state, self._state_message, True),
            (self._wrist, self._wrist_message, controller.sensor_age == 0.0),
        ):
            if topic.has_subscribers and is_measured:
                topic.put(controller.world, message(controller))
            topic.send(controller.world)

    def while_paused(self) -> None:
        """Publishes the last measurements again: the driver lives. Called in the stepping thread."""
        self._publish()

    # -- commands ------------------------------------------------------------------------------------------------

    def _on_reference(self, message: PoseStamped) -> None:
        problems = [] if message.header.frame_id else ["the frame is empty: expected a tf frame"]
        try:
            pose = pose_from(message.pose, "reference")
        except WrongValue as error:
            problems.append(str(error))
        if problems:
            raise WrongValue("; ".join(problems))
        reference = self._frames.reference(message.header.frame_id)

        def put(world: World) -> None:
            if self._device.running is not None:
                raise Refused(f"arm {self._arm.name} is executing a goal; cancel it first")
            controller = self._controllers[self._arm.id]
            base = inverted(controller.robot.pose())
            controller.set_reference(composed(base, composed(reference(world), pose)))

        self._stepper.call(put)

    def _on_stiffness(self, message: WrenchStamped) -> None:
        values = self._values(message, "stiffness")
        self._call(lambda controller: controller.impedance.set_stiffness(values))

    def _on_damping(self, message: WrenchStamped) -> None:
        values = self._values(message, "damping factors")
        self._call(lambda controller: controller.impedance.set_damping_factors(values))

    def _on_wrench(self, message: WrenchStamped) -> None:
        values = self._values(message, "wrench")
        self._call(lambda controller: controller.set_wrench(values, self._wrench_timeout))

    def _on_overlay(self, request: OverlayMotionRequest) -> OverlayMotionResponse:
        if not request.start:
            self._call(lambda controller: controller.stop_overlay())
            return OverlayMotionResponse(ok=True)
        x, y, z = vector_from(request.direction, "direction")
        goal = SpiralGoal(
            request.radius,
            request.path_distance,
            request.path_velocity,
            (x, y, z) if x or y or z else (0.0, 0.0, 1.0),
            request.allow_decrease,
        )
        self._call(lambda controller: controller.start_overlay(goal))
        return OverlayMotionResponse(ok=True)

    def _on_limits(self, request: SetWrenchLimitsRequest) -> SetWrenchLimitsResponse:
        def put(controller: ArmController) -> None:
            controller.set_limits(request.force, request.torque)
            controller.hand.forget()

        self._call(put)
        return SetWrenchLimitsResponse(ok=True, stamp=self._clock.now)

    def _on_force_control(self, request: SetForceControlRequest) -> SetForceControlResponse:
        if not request.start:
            self._call(lambda controller: controller.force.set_goal(None))
            return SetForceControlResponse(ok=True)
        fx, fy, fz = vector_from(request.force, "force")
        x, y, z = vector_from(request.tip, "tip")
        along_x, along_y, along_z = (bool(value) for value in request.axes)
        goal = ForceGoal((fx, fy, fz), (along_x, along_y, along_z), request.speed, request.admittance, (x, y, z))

        def start(controller: ArmController) -> None:
            controller.check_active()
            controller.force.set_goal(goal, self._wrench_timeout)

        self._call(start)
        return SetForceControlResponse(ok=True)

    def _on_axis_limits(self, request: SetAxisLimitsRequest) -> SetAxisLimitsResponse:
        axes = [*vector_from(request.limits.force, "force"), *vector_from(request.limits.torque, "torque")]
        self._call(lambda controller: controller.set_limits(*controller.limits[:2], axes))
        return SetAxisLimitsResponse(ok=True)

    def _on_position_limits(self, request: SetWrenchLimitsRequest) -> SetWrenchLimitsResponse:
        self._call(lambda controller: controller.set_position_limits(request.force, request.torque))
        return SetWrenchLimitsResponse(ok=True)

    def _on_zero(self, _: TriggerRequest) -> TriggerResponse:
        try:
            self._call(ArmController.zero_sensor)
        except SkirosError as error:
            return TriggerResponse(False, str(error))
        return TriggerResponse(True, "")

    def _call(self, function: Callable[[ArmController], None]) -> None:
        """Calls a function with the controller in the stepping thread."""
        self._stepper.call(lambda _: function(self._controllers[self._arm.id]))

    def _values(self, message: WrenchStamped, what: str) -> Sequence[float]:
        """Returns the numbers of a command in the tool frame.

        :raises WrongValue: it is in another frame, or a number is not finite; the text lists all problems.
        """
        problems: list[str] = []
        values: list[float] = []
        frame = message.header.frame_id.lstrip("/")
        if frame not in ("", self._tool):
            problems.append(f"{what} in frame {frame!r}: expected {self._tool!r}, or none")
        for part, along in ((message.wrench.force, "along"), (message.wrench.torque, "about")):
            try:
                values += vector_from(part, f"{what} {along} x, y, z")
            except WrongValue as error:
                problems.append(str(error))
        if problems:
            raise WrongValue("; ".join(problems))
        return values

    def _logged(self, topic: str, handle: Callable[[Message], None]) -> Callable[[Message], None]:
        def on_message(message: Message) -> None:
            try:
                handle(message)
            except SkirosError as error:
                log.warning("%s: a command is refused: %s", topic, error)

        return on_message

    # -- state ---------------------------------------------------------------------------------------------------

    def _state_message(self, controller: ArmController) -> ImpedanceState:
        law, stop, ended = controller.impedance, controller.stop, rospy.Time()
        if stop is not None:
            ended = rospy.Time.from_sec(max(0.0, self._clock.seconds - (controller.world.time - stop.time)))
        return ImpedanceState(
            header=Header(stamp=self._clock.now, frame_id=self._base),
            active=controller.compliant,
            pose=pose_message(controller.tool_pose()),
            reference=pose_message(law.reference),
            position_error=Vector3(*law.error[:3]),
            rotation_error=Vector3(*law.error[3:]),
            commanded_wrench=wrench_message(law.wrench),
            measured_wrench=wrench_message(controller.arm.measured_wrench()),
            wrench_stamp=rospy.Time.from_sec(max(0.0, self._clock.seconds - controller.sensor_age)),
            stiffness=wrench_message(law.stiffness),
            damping_factors=wrench_message(law.damping_factors),
            joints=self._joints,
            joint_torques=law.commanded_torques,
            overlay=controller.overlay is not None,
            force_limit=controller.limits[0],
            torque_limit=controller.limits[1],
            stopped_by=stop.quantity if stop is not None else "",
            stop_value=stop.value if stop is not None else 0.0,
            stop_limit=stop.limit if stop is not None else 0.0,
            stop_stamp=ended,
            peak_force=controller.hand.peak(controller.world.time),
        )

    def _wrist_message(self, controller: ArmController) -> WrenchStamped:
        header = Header(stamp=self._clock.now, frame_id=self._tool)
        return WrenchStamped(header, wrench_message(controller.arm.measured_wrench()))
