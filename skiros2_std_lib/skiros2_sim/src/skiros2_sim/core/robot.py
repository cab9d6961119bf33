"""A robot in the simulated world: one multibody with base drives and arms."""

from __future__ import annotations

import itertools
import math
import tempfile
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from skiros2_common.core.errors import ConfigurationError, Refused, WrongValue
from skiros2_motion.core.geometry import IDENTITY, Pose, Quaternion, Vector, angle_between
from skiros2_motion.core.numbers import finite
from skiros2_sim.core.arm import Arm
from skiros2_sim.core.bullet import Bullet, Joint
from skiros2_sim.core.robot_model import BASE_LINK, DRIVES, TILT, ArmModel, RobotModel, upright
from skiros2_sim.core.scene_spec import RobotSpec
from skiros2_sim.core.wrist_sensor import SensorModel

#: Maximum force (N) and torque (Nm) of the base drives: a person can stop the base.
_DRIVE_FORCE = 600.0
_DRIVE_TORQUE = 300.0


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

    def __init__(self, bullet: Bullet, spec: RobotSpec, model: RobotModel, visuals: bool = True) -> None:
        self.id = spec.id
        self.name = spec.name
        self.spec = spec
        self.mobile = model.mobile
        #: The URDF of the whole robot, with full paths of meshes.
        self.urdf = model.urdf
        self._bullet = bullet
        self.body = _load(bullet, spec, model, visuals)
        self._root_inverse = _root_inverse(bullet, self.body)
        #: Index of each link by name; -1 for the first link.
        self.links: dict[str, int] = {bullet.getBodyInfo(self.body)[0].decode(): -1}
        #: The moving joints by name, without the base drives.
        self.joints: dict[str, Joint] = {}
        self._drives: list[int] = []
        names: dict[str, Joint] = {}
        for index in range(bullet.getNumJoints(self.body)):
            joint = Joint.of(bullet.getJointInfo(self.body, index))
            self.links[joint.child] = index
            names[joint.name] = joint
            if joint.moves and joint.name not in DRIVES:
                self.joints[joint.name] = joint
        if self.mobile:
            self._drives = [names[name].index for name in DRIVES]
        self._link_names = {index: name for name, index in self.links.items()}
        self._drive = _Drive()
        dofs = [joint.index for joint in names.values() if joint.moves]
        self.arms = {arm.spec.id: Arm(bullet, self.body, arm, names, self.links, dofs) for arm in model.arms}
        self.base_links = [self.links[name] for name in model.base_links]
        for index in range(-1, len(names)):
            # The engine's damping is missing in its inverse dynamics; joint damping uses the velocity of the previous
            # step, so light links would oscillate.
            bullet.changeDynamics(self.body, index, linearDamping=0.0, angularDamping=0.0, jointDamping=0.0)
        self._let_neighbours_touch(model.arms)
        if self.mobile:
            self._start_drives()
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
        index = self.links[name]
        if index < 0:
            centre = self._bullet.getBasePositionAndOrientation(self.body)
            return Pose(*self._bullet.multiplyTransforms(*centre, *self._root_inverse))
        state = self._bullet.getLinkState(self.body, index, computeForwardKinematics=1)
        return Pose(state[4], state[5])

    def link_poses(self) -> dict[str, Pose]:
        """Returns the poses of all link frames from `base_link` on, in the map."""
        found = {BASE_LINK: self.pose()}
        indices = [index for index in self.links.values() if index >= 0]
        states = self._bullet.getLinkStates(self.body, indices, computeForwardKinematics=1) if indices else ()
        by_index = dict(zip(indices, states, strict=True))
        for name, index in self.links.items():
            if index >= 0 and name not in (BASE_LINK, *DRIVES):
                state = by_index[index]
                found[name] = Pose(state[4], state[5])
        return found

    def joint_positions(self) -> list[float]:
        """Returns the positions of `joints`, in their order (rad, m)."""
        indices = [joint.index for joint in self.joints.values()]
        return [state[0] for state in self._bullet.getJointStates(self.body, indices)] if indices else []

    def velocity(self) -> tuple[float, float, float]:
        """Returns the velocity of the base in its own frame: forward, left (m/s), yaw rate (rad/s)."""
        if not self.mobile:
            return 0.0, 0.0, 0.0
        (_, vx, *_), (_, vy, *_), (yaw, turn, *_) = self._bullet.getJointStates(self.body, self._drives)
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
        place_root(self._bullet, self.body, pose)
        for index in self._drives:
            self._bullet.resetJointState(self.body, index, 0.0, 0.0)

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
        yaw = self._bullet.getJointState(self.body, self._drives[2])[0] if drive.x or drive.y else 0.0
        c, s = math.cos(yaw), math.sin(yaw)
        self._bullet.setJointMotorControlArray(
            self.body,
            self._drives,
            self._bullet.VELOCITY_CONTROL,
            targetVelocities=[c * drive.x - s * drive.y, s * drive.x + c * drive.y, drive.turn],
            forces=[_DRIVE_FORCE, _DRIVE_FORCE, _DRIVE_TORQUE],
        )

    def _let_neighbours_touch(self, arms: Iterable[ArmModel]) -> None:
        """Disables collisions between links that overlap by design: fixed neighbours such as an arm's mount and the
        base, the next link of an arm, and the fingers of a gripper, which their limits stop."""
        fixed_to: dict[int, int] = {-1: -1}
        for index in range(len(self._link_names) - 1):  # parents have smaller indices
            info = self._bullet.getJointInfo(self.body, index)
            fixed_to[index] = index if Joint.of(info).moves else fixed_to[info[16]]
        groups: dict[int, set[int]] = {}
        for index, root in fixed_to.items():
            groups.setdefault(root, set()).add(index)
        for arm in arms:
            groups[fixed_to[self.links[arm.mount]]].add(self.joints[arm.joints[0]].index)
        fingers = [{self.joints[name].index for name in arm.fingers} for arm in arms]
        for group in (*groups.values(), *fingers):
            for one, other in itertools.combinations(sorted(group), 2):
                self._bullet.setCollisionFilterPair(self.body, self.body, one, other, 0)

    def _start_drives(self) -> None:
        for index in self._drives:
            self._bullet.changeDynamics(self.body, index, jointDamping=0.0)
        self.before_step()

    def _measured_base(self) -> tuple[Vector, Vector]:
        """Returns the corners of the bounding box of the base's shapes. Moves the robot to the origin meanwhile."""
        pose = root_pose(self._bullet, self.body)
        place_root(self._bullet, self.body, IDENTITY)
        inner = self.pose().position
        boxes = [
            self._bullet.getAABB(self.body, index)
            for index in self.base_links
            if self._bullet.getCollisionShapeData(self.body, index)
        ]
        place_root(self._bullet, self.body, pose)
        low = [min((box[0][i] for box in boxes), default=inner[i]) - inner[i] for i in range(3)]
        high = [max((box[1][i] for box in boxes), default=inner[i]) - inner[i] for i in range(3)]
        return (low[0], low[1], low[2]), (high[0], high[1], high[2])


def root_pose(bullet: Bullet, body: int) -> Pose:
    """Returns the pose of the root frame of a body; PyBullet returns that of its centre of mass."""
    centre = bullet.getBasePositionAndOrientation(body)
    return Pose(*bullet.multiplyTransforms(*centre, *_root_inverse(bullet, body)))


def _root_inverse(bullet: Bullet, body: int) -> tuple[Vector, Quaternion]:
    """Returns the pose of the root frame in the frame of its centre of mass; it is constant."""
    inner = bullet.getDynamicsInfo(body, -1)
    found: tuple[Vector, Quaternion] = bullet.invertTransform(inner[3], inner[4])
    return found


def place_root(bullet: Bullet, body: int, pose: Pose) -> None:
    """Moves the root frame of a body to a pose, at rest."""
    inner = bullet.getDynamicsInfo(body, -1)
    bullet.resetBasePositionAndOrientation(body, *bullet.multiplyTransforms(*pose, inner[3], inner[4]))
    bullet.resetBaseVelocity(body, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))


def load_urdf(
    bullet: Bullet, text: str, pose: Pose, fixed: bool, exact_cylinders: bool = False, visuals: bool = True
) -> int:
    """Loads a URDF. Returns the body id.

    :param exact_cylinders: whether cylinders collide as such, and not as a mesh with a margin of 1 mm.
    :param visuals: whether the body can be seen; its meshes are not read otherwise, which takes most of the time.
    :raises ConfigurationError: PyBullet does not load it.
    """
    # Links of one chain do not collide with each other; an arm collides with the base and with other arms.
    collisions = bullet.URDF_USE_SELF_COLLISION | bullet.URDF_USE_SELF_COLLISION_EXCLUDE_ALL_PARENTS
    if exact_cylinders:
        collisions |= bullet.URDF_USE_IMPLICIT_CYLINDER
    if not visuals:
        collisions |= bullet.URDF_IGNORE_VISUAL_SHAPES
    with tempfile.TemporaryDirectory(prefix="skiros2_sim_") as folder:
        file = Path(folder, "model.urdf")
        file.write_text(text, encoding="utf-8")
        try:
            body: int = bullet.loadURDF(
                str(file),
                basePosition=pose.position,
                baseOrientation=pose.orientation,
                useFixedBase=fixed,
                flags=bullet.URDF_MAINTAIN_LINK_ORDER | bullet.URDF_ENABLE_CACHED_GRAPHICS_SHAPES | collisions,
            )
        except bullet.error as error:
            raise ConfigurationError(f"PyBullet does not load the model: {error}") from None
    return body


def _load(bullet: Bullet, spec: RobotSpec, model: RobotModel, visuals: bool) -> int:
    try:
        return load_urdf(bullet, model.urdf, model.pose, True, visuals=visuals)
    except ConfigurationError as error:
        raise ConfigurationError(f"{spec.id}: {error}") from None
