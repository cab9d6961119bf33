"""The interfaces of compliant controllers of other projects, as data: one profile for each.

Names are templates with the fields `compliant`, the name of the controller, `robot` and `arm`, and `space`, the
namespace of the controller by the rules of this project. Messages are known by the name of their type, and their fields
are read by name: the packages of a driver are needed only where it is used.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from scipy.spatial.transform import Rotation

from skiros2_motion.core.compliant_arm import Wrench, turned_wrench
from skiros2_motion.core.geometry import Pose, Quaternion
from skiros2_std_skills.core.driver_names import LIST_CONTROLLERS, SWITCH_CONTROLLER, WRIST

#: Returns the pose of a tf frame in the base frame.
Lookup = Callable[[str], Pose]


class Reading(NamedTuple):
    """The measurements of a driver.

    :param pose: of the tool in the driver's base frame (m).
    :param wrench: force (N) and torque about the tool (Nm) that the environment exerts on the hand, along the axes of
        that frame.
    :param stopped: why the driver does not follow commands; "" if it does.
    """

    pose: Pose
    wrench: Wrench
    stopped: str = ""


@dataclass(frozen=True)
class Stiffness:
    """How the stiffness is set: by the service `dynamic_reconfigure/Reconfigure`, by a topic, or not at all ("").

    :param parameters: names, each with the axes (0 to 5: along, about x, y, z) that it sets, and its maximum. One for
        several axes is set to the minimum of their values: the arm is never stiffer than wanted.
    :param topic: `geometry_msgs/WrenchStamped` with a value per axis.
    :param along_base: whether stiffness and damping are along the axes of the base, not of the tool.
    """

    service: str
    parameters: Mapping[str, tuple[tuple[int, ...], float]]
    topic: str = ""
    along_base: bool = False

    def values(self, wanted: Sequence[float]) -> dict[str, float]:
        """Returns the values of the parameters for six wanted ones (N/m, Nm/rad)."""
        return {name: min(most, *(wanted[i] for i in axes)) for name, (axes, most) in self.parameters.items()}

    def effective(self, wanted: Sequence[float]) -> list[float]:
        """Returns the six values that the driver then has."""
        values = self.values(wanted)
        found = [0.0] * 6
        for name, (axes, _) in self.parameters.items():
            for axis in axes:
                found[axis] = values[name]
        return found


def _each_axis(along: float, about: float) -> dict[str, tuple[tuple[int, ...], float]]:
    """Returns a parameter for each axis, with its maximum along (N/m) and about (Nm/rad) it."""
    names = ("trans_x", "trans_y", "trans_z", "rot_x", "rot_y", "rot_z")
    return {name: ((axis,), along if axis < 3 else about) for axis, name in enumerate(names)}


def along_base(orientation: Quaternion, values: Sequence[float]) -> list[float]:
    """Returns values along and about the axes of the tool as those of the base: the diagonal of R K R'. What couples
    the axes of a tool that is not aligned with the base is lost.

    :param orientation: of the tool in the base frame.
    """
    squares = Rotation.from_quat(orientation).as_matrix() ** 2
    return [*(squares @ list(values[:3])).tolist(), *(squares @ list(values[3:])).tolist()]


#: For drivers without stiffness: that of `TrajectoryArm`.
_OWN_STIFFNESS = Stiffness("", _each_axis(2000.0, 300.0))


@dataclass(frozen=True)
class Profile:
    """An interface. A topic or service that is "" does not exist: `TopicArm` then does that itself, as far as it can.

    :param state: topic and type of the message that `read` converts.
    :param read: converts a message, with a lookup of tf frames and the name of the tool frame.
    :param base_frame: tf frame of the arm's base.
    :param tool_frame: tf frame between the fingertips, z pointing out of the hand.
    :param reference: topic `geometry_msgs/PoseStamped`, in `base_frame`.
    :param wrench: topic `geometry_msgs/WrenchStamped`: wrench that the tool exerts, in the tool frame.
    :param damping: topic and type (`geometry_msgs/Wrench` or `WrenchStamped`) of the six damping factors.
    :param zero: service `std_srvs/Trigger`, called before the wrench in the state is zeroed.
    :param recovery: topic and type of the goal of an action that recovers from a stop; the goal is empty.
    :param switch: service `controller_manager_msgs/SwitchController`.
    :param controllers: service `controller_manager_msgs/ListControllers`.
    :param action: `control_msgs/FollowJointTrajectory`, for drivers without `reference`.
    :param joint_states: topic `sensor_msgs/JointState`, for these.
    :param description: parameter with the URDF of the robot, for these.
    :param is_stiff: whether a position controller is behind it: without a measured wrench, nothing but the way of the
        tool bounds the force of a contact.
    """

    state: tuple[str, str]
    read: Callable[[Any, Lookup, str], Reading]
    base_frame: str
    tool_frame: str
    reference: str = ""
    stiffness: Stiffness = _OWN_STIFFNESS
    wrench: str = ""
    damping: tuple[str, str] = ("", "")
    zero: str = ""
    recovery: tuple[str, str] = ("", "")
    switch: str = "/controller_manager/switch_controller"
    controllers: str = "/controller_manager/list_controllers"
    action: str = ""
    joint_states: str = ""
    description: str = ""
    is_stiff: bool = False


#: Of franka_msgs/FrankaState.robot_mode: why the arm does not follow.
_FRANKA_MODES = {3: "it is guided by hand", 4: "reflex", 5: "user stop", 6: "automatic error recovery"}


def _read_franka(message: Any, frame: Lookup, tool: str) -> Reading:
    """franka_msgs/FrankaState: `O_T_EE` is column-major; `O_F_ext_hat_K` is the wrench that the robot exerts on the
    environment, along the axes of the base."""
    t = message.O_T_EE
    x, y, z = (float(value) for value in t[12:15])
    rotation = Rotation.from_matrix([[float(t[4 * column + row]) for column in range(3)] for row in range(3)])
    qx, qy, qz, qw = rotation.as_quat().tolist()
    pose = Pose((x, y, z), (qx, qy, qz, qw))
    fx, fy, fz, tx, ty, tz = (-float(value) for value in message.O_F_ext_hat_K)
    stopped = _FRANKA_MODES.get(message.robot_mode, "")
    if stopped:
        errors = message.current_errors
        active = [name for name in errors.__slots__ if getattr(errors, name) is True]
        stopped += f": {', '.join(active)}" if active else ""
    return Reading(pose, (fx, fy, fz, tx, ty, tz), stopped)


def read_sensor(message: Any, frame: Lookup, tool: str) -> Reading:
    """geometry_msgs/WrenchStamped of a force/torque sensor, in its own frame; the pose of the tool is that in tf."""
    pose, sensor = frame(tool), frame(message.header.frame_id)
    fx, fy, fz, tx, ty, tz = turned_wrench(sensor.orientation, wrench_from(message.wrench))
    x, y, z = (a - b for a, b in zip(sensor.position, pose.position, strict=True))
    return Reading(pose, (fx, fy, fz, tx + y * fz - z * fy, ty + z * fx - x * fz, tz + x * fy - y * fx))


def wrench_from(message: Any) -> Wrench:
    """Converts a `geometry_msgs/Wrench` message."""
    f, t = message.force, message.torque
    return f.x, f.y, f.z, t.x, t.y, t.z


#: The profile of arms without one.
STANDARD = "standard"
#: The profiles by name.
PROFILES = {
    # standard messages only, with the names of this project; for arms without a profile
    STANDARD: Profile(
        state=(f"{WRIST.format(robot='{robot}', part='{arm}')}/wrench", "geometry_msgs/WrenchStamped"),
        read=read_sensor,
        reference="{space}/reference_pose",
        base_frame="{robot}/base_link",
        tool_frame="{robot}/{arm}/tool",
        stiffness=Stiffness("", _each_axis(2000.0, 300.0), "{space}/set_cartesian_stiffness"),
        wrench="{space}/set_cartesian_wrench",
        damping=("{space}/set_damping_factors", "geometry_msgs/WrenchStamped"),
        switch=SWITCH_CONTROLLER,
        controllers=LIST_CONTROLLERS,
    ),
    # Mayr: cartesian_impedance_controller/CartesianImpedanceController. Its state has no measured wrench, and is off by
    # default: tf and a sensor are read.
    "cartesian_impedance_controller": Profile(
        state=("/wrench", "geometry_msgs/WrenchStamped"),
        read=read_sensor,
        reference="/{compliant}/reference_pose",
        base_frame="base_link",
        tool_frame="tool0",
        stiffness=Stiffness("", _each_axis(1500.0, 100.0), "/{compliant}/set_cartesian_stiffness", along_base=True),
        wrench="/{compliant}/set_cartesian_wrench",
        damping=("/{compliant}/set_damping_factors", "geometry_msgs/Wrench"),
    ),
    # franka_ros: franka_example_controllers/CartesianImpedanceExampleController
    "franka_ros": Profile(
        state=("/franka_state_controller/franka_states", "franka_msgs/FrankaState"),
        read=_read_franka,
        reference="/{compliant}/equilibrium_pose",
        base_frame="panda_link0",
        tool_frame="panda_hand_tcp",
        stiffness=Stiffness(
            "/{compliant}/dynamic_reconfigure_compliance_param_node/set_parameters",
            {"translational_stiffness": ((0, 1, 2), 400.0), "rotational_stiffness": ((3, 4, 5), 30.0)},
        ),
        recovery=("/franka_control/error_recovery/goal", "franka_msgs/ErrorRecoveryActionGoal"),
    ),
    # drivers of joints, with a force/torque sensor: see `TrajectoryArm`
    "follow_joint_trajectory": Profile(
        state=("/wrench", "geometry_msgs/WrenchStamped"),
        read=read_sensor,
        base_frame="base_link",
        tool_frame="tool0",
        action="/follow_joint_trajectory",
        joint_states="/joint_states",
        description="/robot_description",
        is_stiff=True,
    ),
    # FZI: cartesian_controllers/CartesianComplianceController
    "cartesian_controllers": Profile(
        state=("/{compliant}/ft_sensor_wrench", "geometry_msgs/WrenchStamped"),
        read=read_sensor,
        reference="/{compliant}/target_frame",
        base_frame="base_link",
        tool_frame="tool0",
        stiffness=Stiffness("/{compliant}/stiffness/set_parameters", _each_axis(2000.0, 300.0)),
        wrench="/{compliant}/target_wrench",
        zero="/{compliant}/signal_taring",
        is_stiff=True,
    ),
}
