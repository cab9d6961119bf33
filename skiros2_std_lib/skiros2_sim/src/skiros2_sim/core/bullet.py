"""The adapter of `Physics` to PyBullet."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from skiros2_common.core.errors import ConfigurationError
from skiros2_common.tools.output import STDERR, discarded
from skiros2_motion.core.geometry import IDENTITY, Pose, Quaternion, Vector, composed, rotated
from skiros2_sim.core.bullet_connection import connect
from skiros2_sim.core.bullet_couplings import Couplings
from skiros2_sim.core.physics import ContactPoint, Image, Joint, JointState, Part
from skiros2_sim.core.scene_spec import Colour

with discarded(STDERR):  # its banner
    import pybullet

_GRAVITY = (0.0, 0.0, -9.81)
#: Direction and distance (m) of the light; with a smaller distance, the shadow map's border would be visible.
_LIGHT, _LIGHT_DISTANCE = (1.0, 1.0, 2.0), 20.0
#: PyBullet's defaults: the group of movable bodies, which collide with all groups.
_GROUP_AND_MASK = (1, -1)
#: Distance at which contacts end, in sizes of the smaller shape. By default, a peg has 40 contacts in a bore
#: that it fits, nearly all of them with walls at a distance: half of the time of a step. In a short step, only near
#: ones matter.
_CONTACT_END, _NEAR_CONTACT_END = 0.02, 0.001
#: Length of a short step (s).
_SHORT_STEP = 0.001
#: Squared change of a velocity at which the solver ends. With PyBullet's 1e-7, boxes at rest turn by 8 mrad per minute.
_RESIDUAL = 1e-10
#: Half of the edges of the ground (m). A plane is compared with each shape of the world in each step, also in the air:
#: a third of a step with a block of 95 boxes on a table.
_GROUND = (1100.0, 1100.0, 50.0)
#: The distance that the engine uses now.
_contact_ends = [_CONTACT_END]
_KINDS = {pybullet.JOINT_REVOLUTE: "revolute", pybullet.JOINT_PRISMATIC: "prismatic", pybullet.JOINT_FIXED: "fixed"}
#: Position and orientation, as PyBullet returns them.
_Frame = tuple[Vector, Quaternion]


class Bullet:
    """One world of PyBullet.

    :param gui: whether to show PyBullet's window; possible for one world per process.
    :raises Refused: no window can be opened, or there are too many worlds.
    """

    def __init__(self, gui: bool = False) -> None:
        self._gui = gui
        self.id = connect(gui)
        #: Of each call: which world it is for.
        self._world = {"physicsClientId": self.id}
        #: Of each body: the frame of its centre of mass in that of its first link, and the inverse. Both are constant.
        self._inner: dict[int, tuple[_Frame, _Frame]] = {}
        self._couplings = Couplings(self.id)

    # -- time ------------------------------------------------------------------------------------------------------

    def reset(self, dt: float) -> None:
        pybullet.resetSimulation(**self._world)
        pybullet.setGravity(*_GRAVITY, **self._world)
        solver = {"deterministicOverlappingPairs": 1, "solverResidualThreshold": _RESIDUAL}
        pybullet.setPhysicsEngineParameter(fixedTimeStep=dt, **solver, **self._world)
        self._contact_end = _CONTACT_END if dt > _SHORT_STEP else _NEAR_CONTACT_END
        self._inner.clear()

    def step(self) -> None:
        _end_contacts_at(self._contact_end, self.id)
        pybullet.stepSimulation(**self._world)
        self._couplings.after_step()

    def show(self, shown: bool) -> None:
        if self._gui:
            pybullet.configureDebugVisualizer(pybullet.COV_ENABLE_RENDERING, int(shown), **self._world)

    def close(self) -> None:
        if self.id >= 0:
            pybullet.disconnect(**self._world)
            self.id = -1

    # -- bodies ----------------------------------------------------------------------------------------------------

    def add_ground(self, friction: float) -> int:
        seen = pybullet.createVisualShape(
            pybullet.GEOM_BOX,
            halfExtents=(15, 15, 0.01),
            rgbaColor=(0.8, 0.8, 0.78, 1),
            visualFramePosition=(0, 0, _GROUND[2] - 0.01),
            **self._world,
        )
        shape = pybullet.createCollisionShape(pybullet.GEOM_BOX, halfExtents=_GROUND, **self._world)
        body = self._make(0.0, shape, seen, Pose((0.0, 0.0, -_GROUND[2]), IDENTITY.orientation))
        self.set_surface(body, -1, friction)
        return body

    def add_box(self, size: Vector, mass: float, pose: Pose, colour: Colour) -> int:
        half = [edge / 2 for edge in size]
        shape = pybullet.createCollisionShape(pybullet.GEOM_BOX, halfExtents=half, **self._world)
        seen = pybullet.createVisualShape(pybullet.GEOM_BOX, halfExtents=half, rgbaColor=colour, **self._world)
        return self._make(mass, shape, seen, pose)

    def add_mesh(self, file: Path, mass: float, pose: Pose, colour: Colour) -> int:
        mesh: dict[str, Any] = {"shapeType": pybullet.GEOM_MESH, "fileName": str(file), **self._world}
        try:
            flags = 0 if mass else pybullet.GEOM_FORCE_CONCAVE_TRIMESH
            shape = pybullet.createCollisionShape(flags=flags, **mesh)
            seen = pybullet.createVisualShape(rgbaColor=colour, **mesh)
        except pybullet.error as error:
            raise ConfigurationError(f"{file}: PyBullet does not load it: {error}") from None
        return self._make(mass, shape, seen, pose)

    def load_urdf(
        self,
        text: str,
        pose: Pose,
        fixed: bool,
        exact_cylinders: bool = False,
        visuals: bool = True,
        margin: float | None = None,
    ) -> int:
        flags = _urdf_flags(exact_cylinders, visuals)
        body = _load_urdf(text, *pose, useFixedBase=fixed, flags=flags, **self._world)
        if margin is not None:
            pybullet.changeDynamics(body, -1, collisionMargin=margin, **self._world)
        return body

    def remove(self, body: int) -> None:
        pybullet.removeBody(body, **self._world)
        self._inner.pop(body, None)

    def set_surface(
        self,
        body: int,
        link: int,
        friction: float,
        spinning: float | None = None,
        rolling: float | None = None,
        bounce: float | None = None,
        anchored: bool | None = None,
    ) -> None:
        others = {
            "spinningFriction": spinning,
            "rollingFriction": rolling,
            "restitution": bounce,
            "frictionAnchor": anchored,
        }
        given = {name: value for name, value in others.items() if value is not None}
        pybullet.changeDynamics(body, link, lateralFriction=friction, **given, **self._world)

    def remove_damping(self, body: int) -> None:
        for link in range(-1, pybullet.getNumJoints(body, **self._world)):
            pybullet.changeDynamics(body, link, linearDamping=0.0, angularDamping=0.0, jointDamping=0.0, **self._world)

    def ignore_collisions(self, one: Part, other: Part) -> None:
        pybullet.setCollisionFilterPair(one.body, other.body, one.link, other.link, 0, **self._world)

    def _make(self, mass: float, shape: int, seen: int, pose: Pose) -> int:
        body: int = pybullet.createMultiBody(mass, shape, seen, *pose, **self._world)
        return body

    # -- models ----------------------------------------------------------------------------------------------------

    def root_link(self, body: int) -> str:
        name: bytes = pybullet.getBodyInfo(body, **self._world)[0]
        return name.decode()

    def joints(self, body: int) -> list[Joint]:
        count = pybullet.getNumJoints(body, **self._world)
        return [_joint(pybullet.getJointInfo(body, index, **self._world)) for index in range(count)]

    def parts(self, body: int | None = None) -> list[Part]:
        if body is None:
            count = pybullet.getNumBodies(**self._world)
            bodies = [pybullet.getBodyUniqueId(index, **self._world) for index in range(count)]
            return [part for each in bodies for part in self.parts(each)]
        links = range(-1, pybullet.getNumJoints(body, **self._world))
        has_shape = pybullet.getCollisionShapeData
        return [Part(body, link) for link in links if has_shape(body, link, **self._world)]

    def mass(self, part: Part) -> float:
        return float(pybullet.getDynamicsInfo(*part, **self._world)[0])

    # -- where things are ------------------------------------------------------------------------------------------

    def pose(self, body: int) -> Pose:
        centre = pybullet.getBasePositionAndOrientation(body, **self._world)
        return Pose(*pybullet.multiplyTransforms(*centre, *self._inner_of(body)[1]))

    def place(self, body: int, pose: Pose) -> None:
        centre = pybullet.multiplyTransforms(*pose, *self._inner_of(body)[0])
        pybullet.resetBasePositionAndOrientation(body, *centre, **self._world)
        pybullet.resetBaseVelocity(body, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), **self._world)

    def link_pose(self, part: Part) -> Pose:
        if part.link < 0:
            return self.pose(part.body)
        state = pybullet.getLinkState(*part, computeForwardKinematics=1, **self._world)
        return Pose(state[4], state[5])

    def link_poses(self, body: int, links: Sequence[int]) -> list[Pose]:
        if not links:
            return []
        states = pybullet.getLinkStates(body, links, computeForwardKinematics=1, **self._world)
        return [Pose(state[4], state[5]) for state in states]

    def mass_pose(self, part: Part) -> Pose:
        if part.link < 0:
            return Pose(*pybullet.getBasePositionAndOrientation(part.body, **self._world))
        state = pybullet.getLinkState(*part, computeForwardKinematics=1, **self._world)
        return Pose(state[0], state[1])

    def velocity(self, part: Part) -> tuple[Vector, Vector]:
        if part.link < 0:
            linear, angular = pybullet.getBaseVelocity(part.body, **self._world)
            return linear, angular
        state = pybullet.getLinkState(*part, computeLinkVelocity=1, computeForwardKinematics=1, **self._world)
        return state[6], state[7]

    def bounding_box(self, part: Part) -> tuple[Vector, Vector]:
        low, high = pybullet.getAABB(*part, **self._world)
        return low, high

    def _inner_of(self, body: int) -> tuple[_Frame, _Frame]:
        """Return the constant frames of a body; PyBullet's poses of a body are those of its centre of mass."""
        if body not in self._inner:
            info = pybullet.getDynamicsInfo(body, -1, **self._world)
            self._inner[body] = (info[3], info[4]), pybullet.invertTransform(info[3], info[4])
        return self._inner[body]

    # -- joints ----------------------------------------------------------------------------------------------------

    def joint_states(self, body: int, joints: Sequence[int]) -> list[JointState]:
        if not joints:
            return []
        return list(map(JointState._make, pybullet.getJointStates(body, joints, **self._world)))

    def set_joint(self, body: int, joint: int, position: float) -> None:
        pybullet.resetJointState(body, joint, position, **self._world)

    def drive_positions(
        self,
        body: int,
        joints: Sequence[int],
        positions: Sequence[float],
        velocities: Sequence[float],
        efforts: Sequence[float],
    ) -> None:
        pybullet.setJointMotorControlArray(
            body,
            joints,
            pybullet.POSITION_CONTROL,
            targetPositions=positions,
            targetVelocities=velocities,
            forces=efforts,
            **self._world,
        )

    def drive_velocities(
        self, body: int, joints: Sequence[int], velocities: Sequence[float], efforts: Sequence[float]
    ) -> None:
        pybullet.setJointMotorControlArray(
            body,
            joints,
            pybullet.VELOCITY_CONTROL,
            targetVelocities=velocities,
            forces=efforts,
            **self._world,
        )

    def drive_torques(self, body: int, joints: Sequence[int], torques: Sequence[float]) -> None:
        pybullet.setJointMotorControlArray(body, joints, pybullet.TORQUE_CONTROL, forces=torques, **self._world)

    def drive_to(self, body: int, joint: int, position: float, effort: float, speed: float) -> None:
        pybullet.setJointMotorControl2(
            body,
            joint,
            pybullet.POSITION_CONTROL,
            targetPosition=position,
            force=effort,
            maxVelocity=speed,
            **self._world,
        )

    def couple(self, body: int, one: int, other: int, force: float) -> int:
        return self._couplings.add(body, one, other, force)

    def coupling_force(self, coupling: int) -> float:
        return self._couplings.force(coupling)

    def add_force_sensor(self, body: int, joint: int) -> None:
        pybullet.enableJointForceTorqueSensor(body, joint, True, **self._world)

    def mass_matrix(self, body: int, positions: Sequence[float]) -> Sequence[Sequence[float]]:
        found: Sequence[Sequence[float]] = pybullet.calculateMassMatrix(body, positions, **self._world)
        return found

    def bias(self, body: int, positions: Sequence[float], velocities: Sequence[float]) -> Sequence[float]:
        rest = [0.0] * len(positions)
        found: Sequence[float] = pybullet.calculateInverseDynamics(body, positions, velocities, rest, **self._world)
        return found

    # -- contacts --------------------------------------------------------------------------------------------------

    def contacts(self, body: int | None = None) -> list[ContactPoint]:
        return _contact_points(body, self.id)

    def detect_contacts(self) -> None:
        _end_contacts_at(self._contact_end, self.id)
        pybullet.performCollisionDetection(**self._world)

    def forget_contacts(self, body: int, link: int) -> None:
        # with a new proxy in the broad phase they are made again
        pybullet.setCollisionFilterGroupMask(body, link, *_GROUP_AND_MASK, **self._world)

    def push(self, part: Part, force: Vector, torque: Vector) -> None:
        at = self.mass_pose(part).position
        pybullet.applyExternalForce(*part, force, at, pybullet.WORLD_FRAME, **self._world)
        pybullet.applyExternalTorque(*part, torque, pybullet.WORLD_FRAME, **self._world)

    def distance(self, one: Part, other: Part, limit: float) -> float:
        found = pybullet.getClosestPoints(one.body, other.body, limit, one.link, other.link, **self._world)
        return min((float(point[8]) for point in found), default=math.inf)

    def first_hits(self, start: Vector, ends: Sequence[Sequence[float]]) -> list[int]:
        return [hit[0] for hit in pybullet.rayTestBatch([start] * len(ends), ends, **self._world)]

    def render(
        self, pose: Pose, width: int, height: int, field_of_view: float, near: float, far: float, shadow: bool
    ) -> Image:
        view, lens = _view(pose), _lens(field_of_view, width / height, near, far)
        light: dict[str, Any] = {"lightDirection": _LIGHT, "lightDistance": _LIGHT_DISTANCE, "shadow": int(shadow)}
        cpu = pybullet.ER_TINY_RENDERER
        *_, rgba, buffer, mask = pybullet.getCameraImage(
            width, height, view, lens, renderer=cpu, **light, **self._world
        )
        nearness = np.asarray(buffer, np.float32).reshape(height, width)
        # OpenGL's depth buffer: 0 at the near plane, 1 at the far plane
        depth = np.asarray(far * near / (far - (far - near) * nearness), np.float32)
        rgb = np.ascontiguousarray(np.asarray(rgba, np.uint8).reshape(height, width, 4)[:, :, :3])
        return Image(rgb, depth, np.asarray(mask, np.int32).reshape(height, width))


def _contact_points(body: int | None, world: int) -> list[ContactPoint]:
    """Return all contact points, or those of a body, which comes first."""
    if body is not None and not pybullet.getContactPoints(body, physicsClientId=world):
        return []
    # of all: where a requested body is second, the engine swaps the bodies and the normal, but not the friction
    points = map(ContactPoint._make, pybullet.getContactPoints(physicsClientId=world))
    if body is None:
        return list(points)
    return [point if point.body == body else point.swapped() for point in points if body in point[1:3]]


def _end_contacts_at(distance: float, world: int) -> None:
    """Set the distance at which contacts end; the engine has one for all worlds of the process."""
    if _contact_ends[-1] != distance:
        _contact_ends[:] = [distance]
        pybullet.setPhysicsEngineParameter(contactBreakingThreshold=distance, physicsClientId=world)


def _urdf_flags(exact_cylinders: bool, visuals: bool) -> int:
    flags: int = pybullet.URDF_MAINTAIN_LINK_ORDER | pybullet.URDF_ENABLE_CACHED_GRAPHICS_SHAPES
    # Links of one chain do not collide with each other; an arm collides with the base and with other arms.
    flags |= pybullet.URDF_USE_SELF_COLLISION | pybullet.URDF_USE_SELF_COLLISION_EXCLUDE_ALL_PARENTS
    if exact_cylinders:
        flags |= pybullet.URDF_USE_IMPLICIT_CYLINDER
    if not visuals:
        flags |= pybullet.URDF_IGNORE_VISUAL_SHAPES
    return flags


def _load_urdf(text: str, *arguments: Any, **options: Any) -> int:
    """Call PyBullet's `loadURDF` with a text.

    :raises ConfigurationError: PyBullet does not load it.
    """
    with tempfile.TemporaryDirectory(prefix="skiros2_sim_") as folder:
        file = Path(folder, "model.urdf")
        file.write_text(text, encoding="utf-8")
        try:
            body: int = pybullet.loadURDF(str(file), *arguments, **options)
        except pybullet.error as error:
            raise ConfigurationError(f"PyBullet does not load the model: {error}") from None
    return body


def _view(pose: Pose) -> Sequence[float]:
    """Return OpenGL's view matrix of an optical frame."""
    ahead = composed(pose, Pose((0.0, 0.0, 1.0), IDENTITY.orientation)).position
    up = rotated(pose.orientation, (0.0, -1.0, 0.0))
    matrix: Sequence[float] = pybullet.computeViewMatrix(pose.position, ahead, up)
    return matrix


def _lens(field_of_view: float, aspect: float, near: float, far: float) -> Sequence[float]:
    """Return OpenGL's projection matrix."""
    matrix: Sequence[float] = pybullet.computeProjectionMatrixFOV(math.degrees(field_of_view), aspect, near, far)
    return matrix


def _joint(info: Sequence[Any]) -> Joint:
    """Create a joint from the result of PyBullet's `getJointInfo`."""
    lower, upper = float(info[8]), float(info[9])
    if lower >= upper:  # PyBullet's mark of a joint without limits
        lower, upper = -math.inf, math.inf
    return Joint(
        name=info[1].decode(),
        index=int(info[0]),
        kind=_KINDS.get(info[2], "other"),
        child=info[12].decode(),
        lower=lower,
        upper=upper,
        velocity=float(info[11]),
        effort=float(info[10]),
        parent=int(info[16]),
        axis=info[13],
    )
