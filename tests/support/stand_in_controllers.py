"""Stand-ins of the compliant controllers of other projects: their topics and services, with a simulated arm behind.

Their messages, which Debian lacks, have the fields that the adapters read.
"""

from __future__ import annotations

import queue
import sys
import threading
import time
import types
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import actionlib
import genpy.dynamic
import numpy as np
import pybullet_data
import rospy
from geometry_msgs.msg import Pose as PoseMessage
from geometry_msgs.msg import PoseStamped, TransformStamped, Vector3, Wrench, WrenchStamped
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import JointState
from std_msgs.msg import Header
from std_srvs.srv import Trigger, TriggerResponse
from tf2_msgs.msg import TFMessage

from control_msgs.msg import FollowJointTrajectoryAction, FollowJointTrajectoryResult
from controller_manager_msgs.msg import ControllerState
from controller_manager_msgs.srv import (
    ListControllers,
    ListControllersResponse,
    SwitchController,
    SwitchControllerResponse,
)
from skiros2_motion.core.geometry import Pose, composed, inverted, rotated
from skiros2_motion.core.motion import State
from skiros2_sim.core.arm_controller import ArmController
from skiros2_sim.core.joint_motion import JointGoal, JointMotion, JointPoint
from skiros2_sim.core.world import World
from skiros2_sim.core.wrist_sensor import SensorModel
from support.simulated_cell import ARM, GRIPPER, ROBOT, bench

PERIOD = 1.0 / 30.0
#: The modes of a Franka arm.
MOVE, REFLEX = 2, 4

_SEPARATOR = "\n" + "=" * 80 + "\nMSG: "
_HEADER = _SEPARATOR + "std_msgs/Header\nuint32 seq\ntime stamp\nstring frame_id\n"
_ERRORS = "bool joint_position_limits_violation\nbool cartesian_reflex\n"
_GOAL_ID = _SEPARATOR + "actionlib_msgs/GoalID\ntime stamp\nstring id\n"
_FRANKA = {
    "franka_msgs/FrankaState": "std_msgs/Header header\nfloat64[6] O_F_ext_hat_K\nfloat64[16] O_T_EE\n"
    "franka_msgs/Errors current_errors\nuint8 robot_mode\n" + _HEADER + _SEPARATOR + "franka_msgs/Errors\n" + _ERRORS,
    "franka_msgs/Errors": _ERRORS,
    "franka_msgs/ErrorRecoveryActionGoal": "std_msgs/Header header\nactionlib_msgs/GoalID goal_id\n"
    "franka_msgs/ErrorRecoveryGoal goal\n" + _HEADER + _GOAL_ID + _SEPARATOR + "franka_msgs/ErrorRecoveryGoal\n",
}
_NUMBER = "string name\nfloat64 value\n"
_CONFIG = "dynamic_reconfigure/DoubleParameter[] doubles\n"
_RECONFIGURE = {
    "dynamic_reconfigure/DoubleParameter": _NUMBER,
    "dynamic_reconfigure/Config": _CONFIG + _SEPARATOR + "dynamic_reconfigure/DoubleParameter\n" + _NUMBER,
}


@contextmanager
def other_packages() -> Iterator[None]:
    """Makes the messages of `franka_msgs` and `dynamic_reconfigure` available in this process."""
    made: dict[str, types.ModuleType] = {}
    for name, text in {**_FRANKA, **_RECONFIGURE}.items():
        package, _, kind = name.partition("/")
        module = made.setdefault(f"{package}.msg", types.ModuleType(f"{package}.msg"))
        setattr(module, kind, genpy.dynamic.generate_dynamic(name, text)[name])
    made["dynamic_reconfigure.srv"] = types.ModuleType("dynamic_reconfigure.srv")
    config = "dynamic_reconfigure/Config config\n" + _SEPARATOR + "dynamic_reconfigure/Config\n"
    config += _RECONFIGURE["dynamic_reconfigure/Config"]
    halves = [
        genpy.dynamic.generate_dynamic(f"dynamic_reconfigure/Reconfigure{half}", config)[
            f"dynamic_reconfigure/Reconfigure{half}"
        ]
        for half in ("Request", "Response")
    ]
    service = type(
        "Reconfigure",
        (),
        {
            "_type": "dynamic_reconfigure/Reconfigure",
            "_md5sum": "bb125d226a21982a4a98760418dc2672",
            "_request_class": halves[0],
            "_response_class": halves[1],
        },
    )
    made["dynamic_reconfigure.srv"].Reconfigure = service  # type: ignore[attr-defined]
    for name in {name.partition(".")[0] for name in made}:
        made[name] = types.ModuleType(name)
    for name, module in made.items():
        parent, _, child = name.partition(".")
        if child:
            setattr(made[parent], child, module)
    sys.modules.update(made)
    try:
        yield
    finally:
        for name in made:
            del sys.modules[name]


class StandIn:
    """A driver: a thread steps the world in real time, and publishes the state 30 times per second."""

    controller_name = "controller"

    def __init__(self) -> None:
        self.world = World(bench(), sensor=SensorModel(force_noise=0.02, torque_noise=0.001))
        self.arm = ArmController(self.world, self.world.robots[ROBOT], self.world.arms[ARM])
        self.running = ""  # the active controller
        self.can_switch = True
        self.is_silent = False
        #: Changes the measured wrench, or the pose of the tool: a fault of the sensors.
        self.distort: Callable[[Any], Any] = lambda wrench: wrench
        self.distort_pose: Callable[[Pose], Pose] = lambda pose: pose
        self.wrenches: list[WrenchStamped] = []
        self.references: list[PoseStamped] = []
        self._mount = self.arm.arm.spec.pose
        self._inbox: queue.SimpleQueue[Callable[[], object]] = queue.SimpleQueue()
        self._ended = threading.Event()
        self._connections: list[Any] = [
            rospy.Service("/controller_manager/switch_controller", SwitchController, self._on_switch),
            rospy.Service("/controller_manager/list_controllers", ListControllers, self._on_list),
        ]
        self.connect()
        self._thread = threading.Thread(target=self._run, name="stand-in of a driver")
        self._thread.start()

    def connect(self) -> None:
        """To override: makes topics and services."""

    def publish(self) -> None:
        """To override: publishes the state."""

    def close(self) -> None:
        self._ended.set()
        self._thread.join()
        for connection in self._connections:
            (connection.shutdown if hasattr(connection, "shutdown") else connection.unregister)()
        self.world.close()

    def push(self, x: float, y: float, z: float, duration: float) -> None:
        """Pushes the hand with a force in the map (N)."""
        self.later(lambda: self.world.push(GRIPPER, (x, y, z), duration=duration))

    def later(self, function: Callable[[], object]) -> None:
        """Calls a function in the thread that steps the world."""
        self._inbox.put(function)

    def subscribe(self, name: str, kind: Any, handle: Callable[[Any], object]) -> None:
        received = lambda message: self.later(lambda: handle(message))  # noqa: E731
        self._connections.append(rospy.Subscriber(name, kind, received, queue_size=10))

    def serve(self, name: str, kind: Any, handle: Callable[[Any], Any]) -> None:
        self._connections.append(rospy.Service(name, kind, handle))

    def topic(self, name: str, kind: Any) -> rospy.Publisher:
        self._connections.append(rospy.Publisher(name, kind, queue_size=10))
        return self._connections[-1]

    def on_reference(self, message: PoseStamped) -> None:
        self.references.append(message)
        p, q = message.pose.position, message.pose.orientation
        if self.arm.compliant:
            self.arm.set_reference(composed(self._mount, Pose((p.x, p.y, p.z), (q.x, q.y, q.z, q.w))))

    def tool(self) -> Pose:
        """Pose of the tool on the arm's base."""
        return self.distort_pose(composed(inverted(self._mount), self.arm.tool_pose()))

    def measured(self) -> Any:
        """The measured wrench of the hand, along the axes of the tool."""
        return self.distort(self.arm.arm.measured_wrench())

    def stiffness(self, names: dict[str, tuple[int, ...]], request: Any) -> Any:
        """Sets the axes of each parameter."""
        values = list(self.arm.stiffness)
        for parameter in request.config.doubles:
            for axis in names[parameter.name]:
                values[axis] = parameter.value
        self.later(lambda: setattr(self.arm, "stiffness", tuple(values)))
        from dynamic_reconfigure.srv import Reconfigure  # type: ignore[import-not-found]

        return Reconfigure._response_class(request.config)

    def _on_switch(self, request: Any) -> SwitchControllerResponse:
        if self.can_switch and request.start_controllers == [self.controller_name]:
            self.running = self.controller_name
            self.later(lambda: self.arm.switch("compliant"))
        return SwitchControllerResponse(True)  # as with BEST_EFFORT

    def _on_list(self, _: Any) -> ListControllersResponse:
        state = "running" if self.running else "stopped"
        return ListControllersResponse([ControllerState(name=self.controller_name, state=state)])

    def _run(self) -> None:
        due = time.monotonic()
        while not self._ended.wait(max(0.0, due - time.monotonic())):
            due = max(due + PERIOD, time.monotonic() - PERIOD)
            while not self._inbox.empty():
                self._inbox.get()()
            self.world.step(8)
            if not self.is_silent:
                self.publish()


class FrankaRos(StandIn):
    """The Cartesian impedance example of franka_ros, with its state controller."""

    controller_name = "cartesian_impedance_example_controller"

    def connect(self) -> None:
        import franka_msgs.msg as messages  # type: ignore[import-not-found]
        from dynamic_reconfigure.srv import Reconfigure

        self.mode = MOVE
        self._message = messages.FrankaState
        self._states = self.topic("/franka_state_controller/franka_states", messages.FrankaState)
        self.subscribe(f"/{self.controller_name}/equilibrium_pose", PoseStamped, self.on_reference)
        recovery = "/franka_control/error_recovery/goal"
        self.subscribe(recovery, messages.ErrorRecoveryActionGoal, lambda _: setattr(self, "mode", MOVE))
        axes = {"translational_stiffness": (0, 1, 2), "rotational_stiffness": (3, 4, 5)}
        name = f"/{self.controller_name}/dynamic_reconfigure_compliance_param_node/set_parameters"
        self.serve(name, Reconfigure, lambda request: self.stiffness(axes, request))

    def publish(self) -> None:
        tool = self.tool()
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = Rotation.from_quat(tool.orientation).as_matrix(), tool.position
        wrench = self.measured()
        in_base = (*rotated(tool.orientation, wrench[:3]), *rotated(tool.orientation, wrench[3:]))
        message = self._message()
        message.header.stamp = rospy.Time.now()
        message.O_T_EE = matrix.T.ravel().tolist()
        message.O_F_ext_hat_K = [-value for value in in_base]  # what the robot exerts
        message.robot_mode = self.mode
        message.current_errors.cartesian_reflex = self.mode == REFLEX
        self._states.publish(message)


class CartesianControllers(StandIn):
    """The compliance controller of FZI's cartesian_controllers, with a force/torque sensor that is turned by 90 degrees
    and mounted 0.1 m behind the tool."""

    controller_name = "my_cartesian_compliance_controller"
    sensor = Pose((0.0, 0.0, -0.1), (0.0, 0.0, 0.5**0.5, 0.5**0.5))

    def connect(self) -> None:
        from dynamic_reconfigure.srv import Reconfigure

        self.tared = 0
        self._measured = self.topic(f"/{self.controller_name}/ft_sensor_wrench", WrenchStamped)
        self._tf = self.topic("/tf", TFMessage)
        self.subscribe(f"/{self.controller_name}/target_frame", PoseStamped, self.on_reference)
        self.subscribe(f"/{self.controller_name}/target_wrench", WrenchStamped, self._on_wrench)
        self.serve(f"/{self.controller_name}/signal_taring", Trigger, self._on_taring)
        axes = {name: (i,) for i, name in enumerate(("trans_x", "trans_y", "trans_z", "rot_x", "rot_y", "rot_z"))}
        name = f"/{self.controller_name}/stiffness/set_parameters"
        self.serve(name, Reconfigure, lambda request: self.stiffness(axes, request))

    def publish(self) -> None:
        tool, now = self.tool(), rospy.Time.now()
        self._tf.publish(TFMessage([_transform(now, "tool0", tool), _transform(now, "sensor", self.sensor, "tool0")]))
        back = inverted(self.sensor)
        wrench = self.measured()
        force, torque = np.array(wrench[:3]), np.array(wrench[3:])
        about_sensor = torque + np.cross(-np.array(self.sensor.position), force)
        turned = [rotated(back.orientation, part.tolist()) for part in (force, about_sensor)]
        message = Wrench(Vector3(*turned[0]), Vector3(*turned[1]))
        self._measured.publish(WrenchStamped(Header(stamp=now, frame_id="sensor"), message))

    def _on_wrench(self, message: WrenchStamped) -> None:
        self.wrenches.append(message)
        f, t = message.wrench.force, message.wrench.torque
        if self.arm.compliant:
            self.arm.set_wrench((f.x, f.y, f.z, t.x, t.y, t.z))

    def _on_taring(self, _: Any) -> TriggerResponse:
        self.tared += 1
        return TriggerResponse(True, "")


class CartesianImpedance(CartesianControllers):
    """Mayr's Cartesian impedance controller and the same sensor: topics only. Its axes are those of the base."""

    controller_name = "CartesianImpedance_trajectory_controller"

    def connect(self) -> None:
        self.stiffnesses: list[WrenchStamped] = []
        self.dampings: list[Wrench] = []
        space = f"/{self.controller_name}"
        self._measured = self.topic("/wrench", WrenchStamped)
        self._tf = self.topic("/tf", TFMessage)
        self.subscribe(f"{space}/reference_pose", PoseStamped, self.on_reference)
        self.subscribe(f"{space}/set_cartesian_stiffness", WrenchStamped, self._on_stiffness)
        self.subscribe(f"{space}/set_damping_factors", Wrench, self.dampings.append)
        self.subscribe(f"{space}/set_cartesian_wrench", WrenchStamped, self._on_wrench)

    def on_reference(self, message: PoseStamped) -> None:
        if message.header.frame_id == "base_link":  # another frame is refused
            super().on_reference(message)

    def _on_stiffness(self, message: WrenchStamped) -> None:
        """The tool points down: its axes are those of the base."""
        self.stiffnesses.append(message)
        f, t = message.wrench.force, message.wrench.torque
        self.arm.stiffness = (f.x, f.y, f.z, t.x, t.y, t.z)


class JointDriver(StandIn):
    """A driver of joints with a force/torque sensor at the tool."""

    controller_name = "position"

    def connect(self) -> None:
        urdf = Path(pybullet_data.getDataPath()) / "franka_panda/panda.urdf"
        rospy.set_param("/robot_description", urdf.read_text())
        self.goals = 0
        self._measured = self.topic("/wrench", WrenchStamped)
        self._tf = self.topic("/tf", TFMessage)
        self._joints = self.topic("/joint_states", JointState)
        kind = FollowJointTrajectoryAction
        self._server = actionlib.SimpleActionServer("/follow_joint_trajectory", kind, self._on_goal, auto_start=False)
        self._server.start()

    def close(self) -> None:
        # the server's topics end with the process: the goals of later drivers are not for this one
        self._server.action_server.started = False
        super().close()

    def publish(self) -> None:
        now, arm = rospy.Time.now(), self.arm.arm
        names = [joint.name.removeprefix("arm/") for joint in arm.joints]
        self._joints.publish(JointState(header=Header(stamp=now), name=names, position=arm.positions()))
        self._tf.publish(TFMessage([_transform(now, "panda_grasptarget", self.tool(), "panda_link0")]))
        wrench = self.measured()
        message = Wrench(Vector3(*wrench[:3]), Vector3(*wrench[3:]))
        self._measured.publish(WrenchStamped(Header(stamp=now, frame_id="panda_grasptarget"), message))

    def _on_goal(self, goal: Any) -> None:
        """Called by the thread of the action server."""
        self.goals += 1
        trajectory = goal.trajectory
        points = tuple(JointPoint(p.time_from_start.to_sec(), tuple(p.positions)) for p in trajectory.points)
        motion = JointMotion(self.arm, JointGoal(tuple(trajectory.joint_names), points))
        self.later(lambda: self.world.motions.add(motion))
        while motion.outcome is None and not self._ended.wait(0.005):
            if self._server.is_preempt_requested():
                self.later(motion.cancel)
        outcome = motion.outcome
        result = FollowJointTrajectoryResult(outcome.code, outcome.text) if outcome is not None else None
        if outcome is not None and outcome.state is State.SUCCEEDED:
            self._server.set_succeeded(result)
        elif outcome is not None and outcome.state is State.PREEMPTED:
            self._server.set_preempted(result)
        else:
            self._server.set_aborted(result)


def _transform(now: rospy.Time, child: str, pose: Pose, parent: str = "base_link") -> TransformStamped:
    made = TransformStamped(Header(stamp=now, frame_id=parent), child, None)
    message = PoseMessage()
    message.orientation.x, message.orientation.y, message.orientation.z, message.orientation.w = pose.orientation
    made.transform.translation = Vector3(*pose.position)
    made.transform.rotation = message.orientation
    return made
