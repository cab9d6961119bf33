"""A robot in the simulated world: one multibody with base drives and arms."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable
from dataclasses import dataclass

from skiros2_common.core.errors import ConfigurationError, Refused, WrongValue
from skiros2_motion.core.geometry import IDENTITY, Pose, Vector, angle_between
from skiros2_motion.core.numbers import finite
from skiros2_sim.core.arm import Arm
from skiros2_sim.core.physics import Joint, JointState, Part, Physics
from skiros2_sim.core.robot_model import BASE_LINK, DRIVES, TILT, ArmModel, RobotModel, upright
from skiros2_sim.core.scene_spec import RobotSpec
from skiros2_sim.core.wrist_sensor import SensorModel

#: Maximum forces (N) and torque (Nm) of the base drives: a person can stop the base.
_DRIVE_EFFORTS = (600.0, 600.0, 300.0)


@dataclass
class _Drive:
    """Target velocity of the base, in its own frame."""

    x: float = 0.0
    y: float = 0.0
    turn: float = 0.0


class Robot:
    """A robot.

    :param model: its merged model.
    :param visuals: whether it can be seen, by cameras or in a window.
    :raises ConfigurationError: PyBullet does not load the model.
    """

    def __init__(self, physics: Physics, spec: RobotSpec, model: RobotModel, visuals: bool = True) -> None:
        self.id = spec.id
        self.name = spec.name
        self.spec = spec
        self.mobile = model.mobile
        #: The URDF of the whole robot, with full paths of meshes.
        self.urdf = model.urdf
        self._physics = physics
        try:
            self.body = physics.load_urdf(model.urdf, model.pose, True, visuals=visuals)
        except ConfigurationError as error:
            raise ConfigurationError(f"{spec.id}: {error}") from None
        #: Index of each link by name; -1 for the first link.
        self.links: dict[str, int] = {physics.root_link(self.body): -1}
        #: The moving joints by name, without the base drives.
        self.joints: dict[str, Joint] = {}
        self._drives: list[int] = []
        joints = physics.joints(self.body)
        names = {joint.name: joint for joint in joints}
        for joint in joints:
            self.links[joint.child] = joint.index
            if joint.moves and joint.name not in DRIVES:
                self.joints[joint.name] = joint
        if self.mobile:
            self._drives = [names[name].index for name in DRIVES]
        self._link_names = {index: name for name, index in self.links.items()}
        self._drive = _Drive()
        dofs = [joint.index for joint in joints if joint.moves]
        self.arms = {arm.spec.id: Arm(physics, self.body, arm, names, self.links, dofs) for arm in model.arms}
        self.base_links = [self.links[name] for name in model.base_links]
        # The engine's damping is missing in its inverse dynamics; joint damping uses the velocity of the previous
        # step, so light links would oscillate.
        physics.remove_damping(self.body)
        self._let_neighbours_touch(model.arms, joints)
        self.before_step()
        #: Minimum and maximum corner of the bounding box of the base, in the frame of `base_link` (m).
        self.base_box = self._measured_base()
        low, high = self.base_box
        #: Radius of the circle around `base_link` that contains the base (m).
        self.radius = math.hypot(max(-low[0], high[0]), max(-low[1], high[1]))

    def mount_sensors(self, model: SensorModel, seed: int) -> None:
        """Mounts force/torque sensors at the wrists of the arms; see `Arm.mount_sensor`."""
        for arm in self.arms.values():
            arm.mount_sensor(model, seed)

    # -- pose -------------------------------------------------------------------------------------------------

    def pose(self) -> Pose:
        """Pose of `base_link` in the map."""
        return self.link_pose(BASE_LINK)

    def link_name(self, index: int) -> str:
        """Returns the name of a link."""
        return self._link_names[index]

    def link_pose(self, name: str) -> Pose:
        """Returns the pose of a link frame in the map."""
        return self._physics.link_pose(Part(self.body, self.links[name]))

    def link_poses(self) -> dict[str, Pose]:
        """Returns the poses of all link frames from `base_link` on, in the map."""
        found = {BASE_LINK: self.pose()}
        names = [name for name, index in self.links.items() if index >= 0 and name not in (BASE_LINK, *DRIVES)]
        poses = self._physics.link_poses(self.body, [self.links[name] for name in names])
        return found | dict(zip(names, poses, strict=True))

    def joint_positions(self) -> list[float]:
        """Returns the positions of `joints`, in their order (rad, m)."""
        return [state.position for state in self.joint_states()]

    def joint_states(self) -> list[JointState]:
        """Returns the states of `joints`, in their order."""
        return self._physics.joint_states(self.body, [joint.index for joint in self.joints.values()])

    def velocity(self) -> tuple[float, float, float]:
        """Returns the velocity of the base in its own frame: forward, left (m/s), yaw rate (rad/s)."""
        if not self.mobile:
            return 0.0, 0.0, 0.0
        (_, vx, *_), (_, vy, *_), (yaw, turn, *_) = self._physics.joint_states(self.body, self._drives)
        c, s = math.cos(yaw), math.sin(yaw)
        return c * vx + s * vy, -s * vx + c * vy, turn

    def place(self, pose: Pose) -> None:
        """Moves the robot to a pose, at rest. The arms keep their joint positions.

        :raises WrongValue: the pose tilts a mobile robot.
        """
        if self.mobile:
            if angle_between(pose.orientation, upright(pose).orientation) > TILT:
                raise WrongValue(f"{self.id}: a mobile robot stands upright: expected a rotation about z, got {pose}")
            pose = upright(pose)
            self._drive = _Drive()
        self._physics.place(self.body, pose)
        for index in self._drives:
            self._physics.set_joint(self.body, index, 0.0)

    # -- driving ----------------------------------------------------------------------------------------------

    def set_base_velocity(self, vx: float, vy: float = 0.0, wz: float = 0.0) -> None:
        """Sets the target velocity of the base in its own frame: forward, left (m/s), yaw rate (rad/s).

        :raises Refused: the robot is fixed in the map.
        :raises WrongValue: a number is not finite.
        """
        if not self.mobile:
            raise Refused(f"{self.id} has no mobile base")
        self._drive = _Drive(*finite((vx, vy, wz), 3, f"{self.id}: velocities of the base"))

    def before_step(self) -> None:
        """Sets the drive velocities in the map. Called by the world before each step."""
        if not self.mobile:
            return
        drive = self._drive
        yaw = self._physics.joint_states(self.body, self._drives[2:])[0].position if drive.x or drive.y else 0.0
        c, s = math.cos(yaw), math.sin(yaw)
        velocities = [c * drive.x - s * drive.y, s * drive.x + c * drive.y, drive.turn]
        self._physics.drive_velocities(self.body, self._drives, velocities, _DRIVE_EFFORTS)

    def _let_neighbours_touch(self, arms: Iterable[ArmModel], joints: Iterable[Joint]) -> None:
        """Disables collisions between links that overlap by design: fixed neighbours such as an arm's mount and the
        base, the next link of an arm, and the fingers of a gripper, which their limits stop."""
        fixed_to: dict[int, int] = {-1: -1}
        for joint in joints:
            fixed_to[joint.index] = joint.index if joint.moves else fixed_to[joint.parent]
        groups: dict[int, set[int]] = {}
        for index, root in fixed_to.items():
            groups.setdefault(root, set()).add(index)
        for arm in arms:
            groups[fixed_to[self.links[arm.mount]]].add(self.joints[arm.joints[0]].index)
        fingers = [{self.joints[name].index for name in arm.fingers} for arm in arms]
        for group in (*groups.values(), *fingers):
            for one, other in itertools.combinations(sorted(group), 2):
                self._physics.ignore_collisions(Part(self.body, one), Part(self.body, other))

    def _measured_base(self) -> tuple[Vector, Vector]:
        """Returns the corners of the bounding box of the base's shapes. Moves the robot to the origin meanwhile."""
        physics = self._physics
        pose = physics.pose(self.body)
        physics.place(self.body, IDENTITY)
        inner = self.pose().position
        boxes = [physics.bounding_box(part) for part in physics.parts(self.body) if part.link in self.base_links]
        physics.place(self.body, pose)
        low = [min((box[0][i] for box in boxes), default=inner[i]) - inner[i] for i in range(3)]
        high = [max((box[1][i] for box in boxes), default=inner[i]) - inner[i] for i in range(3)]
        return (low[0], low[1], low[2]), (high[0], high[1], high[2])
