"""The simulated world: things and robots in physics, stepped by its user. One thread at a time."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator
from types import TracebackType

import numpy as np

from skiros2_common.core.errors import ConfigurationError, Refused, SkirosError, UnknownName, WrongValue
from skiros2_sim.core.arm import Arm
from skiros2_sim.core.body import Body
from skiros2_sim.core.bullet import Bullet
from skiros2_sim.core.composing import BASE_LINK, compose
from skiros2_sim.core.contacts import Contact, joined_contacts
from skiros2_sim.core.faults import Faults
from skiros2_sim.core.gripper import Gripper
from skiros2_sim.core.joint import finite
from skiros2_sim.core.motions import Motions
from skiros2_sim.core.placement import move_apart
from skiros2_sim.core.pushes import Pushes
from skiros2_sim.core.robot import Robot
from skiros2_sim.core.scene_spec import BodySpec, CameraSpec, Problem, RobotSpec, SceneSpec
from skiros2_std_reasoners.core.geometry import IDENTITY, Pose, Vector, composed, from_euler, multiplied

#: Steps a second.
RATE = 240
GROUND = "ground"

_FARTHEST = 1000.0  # m; beyond it the floats of the engine are too coarse
_STRONGEST = 1e5  # N or Nm


class World:
    """A scene in physics.

    :param seed: of all that is random; the same seed and the same steps give the same run, bit for bit.
    :param gui: show PyBullet's window.
    :param position_noise: m; how far from their place in the scene things that move may stand at the start, in x and y.
    :param yaw_noise: rad; how far they may be turned.
    :raises WrongValue: the seed is negative, or a noise is no finite number.
    :raises Refused: there is no window to open.

    What cannot be simulated as the scene says is told in `problems`, and the rest is there. `reset` makes all bodies,
    robots, arms and grippers anew: look them up again.
    """

    def __init__(
        self,
        scene: SceneSpec,
        seed: int = 0,
        gui: bool = False,
        position_noise: float = 0.0,
        yaw_noise: float = 0.0,
    ) -> None:
        self.scene = scene
        self.dt = 1.0 / RATE
        self._noise = (*finite((position_noise, yaw_noise), 2, "noise of the world"),)
        self._seed = _checked_seed(seed)
        self.bullet = Bullet(gui)
        try:
            self._build()
        except SkirosError:
            self.close()
            raise

    def _build(self) -> None:
        bullet = self.bullet
        bullet.show(False)
        bullet.resetSimulation()
        bullet.setGravity(0, 0, -9.81)
        bullet.setPhysicsEngineParameter(fixedTimeStep=self.dt, deterministicOverlappingPairs=1)
        self.random = np.random.default_rng(self._seed)
        self.steps = 0
        self.motions = Motions()
        self.faults = Faults(self)
        self.problems: list[Problem] = list(self.scene.problems)
        self.bodies: dict[str, Body] = {}
        self.robots: dict[str, Robot] = {}
        self.arms: dict[str, Arm] = {}
        self.grippers: dict[str, Gripper] = {}
        self.cameras: dict[str, CameraSpec] = {camera.id: camera for camera in self.scene.cameras}
        self._pushes = Pushes(bullet)
        self._elements: dict[int, str] = {}
        self._ground = self._make_ground()
        for spec in self.scene.bodies:
            self.add_body(self._jittered(spec))
        for robot in self.scene.robots:
            self._add_robot(robot)
        for camera in [camera for camera in self.cameras.values() if camera.parent and camera.parent not in self]:
            del self.cameras[camera.id]
            self.problems.append(Problem(camera.id, f"the camera is left out: {camera.parent} is not there"))
        self.problems += move_apart(self)
        bullet.show(True)

    # -- time -------------------------------------------------------------------------------------------------

    @property
    def seed(self) -> int:
        return self._seed

    @property
    def time(self) -> float:
        """Simulated time since the start, or the last reset (s)."""
        return self.steps / RATE

    def step(self, count: int = 1) -> None:
        """Goes on by so many steps. What a motion raises comes out, and the motion is dropped."""
        for _ in range(count):
            self.motions.update(self.dt)
            self.faults.update()
            for robot in self.robots.values():
                robot.before_step()
            self._pushes.update()
            self.bullet.stepSimulation()
            self.steps += 1

    def reset(self, seed: int | None = None) -> None:
        """Puts everything back to the start: the same state as that of a new world.

        :param seed: another one than so far; None: the same.
        :raises WrongValue: it is negative.
        """
        if seed is not None:
            self._seed = _checked_seed(seed)
        self._build()

    def close(self) -> None:
        """Ends it. Closing it twice does nothing."""
        self.bullet.close()

    def __enter__(self) -> World:
        return self

    def __exit__(self, kind: type | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()

    # -- where things are -------------------------------------------------------------------------------------

    def pose_of(self, eid: str) -> Pose:
        """The true pose of an element, in the map: of a gripper its tool's frame, of an arm its mount's, of a camera
        its optical frame's.

        :raises UnknownName: it is not in the simulated world.
        """
        if eid in self.bodies:
            return self.bodies[eid].pose()
        if eid in self.robots:
            return self.robots[eid].pose()
        if eid in self.grippers:
            return self.grippers[eid].tool_pose()
        if eid in self.arms:
            return self.arms[eid].mount_pose()
        if eid in self.cameras:
            camera = self.cameras[eid]
            return composed(self._pose_of_holder(camera), camera.pose)
        raise UnknownName(f"{eid!r} is not in the simulated world; in it are: {', '.join(self._ids()) or 'none'}")

    def velocity_of(self, eid: str) -> tuple[Vector, Vector]:
        """How an element moves (m/s) and turns (rad/s), in the map; a part of a robot as the body that it is of.

        :raises UnknownName: it is not in the simulated world.
        """
        body, link = self._handle(eid)
        if link < 0:
            found: tuple[Vector, Vector] = self.bullet.getBaseVelocity(body)
            return found
        state = self.bullet.getLinkState(body, link, computeLinkVelocity=1, computeForwardKinematics=1)
        return state[6], state[7]

    def set_pose(self, eid: str, pose: Pose) -> None:
        """Puts a thing or a robot elsewhere, at rest.

        :raises UnknownName: it is not in the simulated world.
        :raises Refused: it is a part of a robot.
        :raises WrongValue: the pose is none, or a mobile robot is to be tilted.
        """
        checked = _checked(pose, eid)
        if eid in self.bodies:
            self.bodies[eid].place(checked)
        elif eid in self.robots:
            self.robots[eid].place(checked)
        else:
            self.pose_of(eid)
            raise Refused(f"{eid} is a part of something: move that")

    def push(self, eid: str, force: Vector, torque: Vector = (0.0, 0.0, 0.0), duration: float = 0.0) -> None:
        """Pushes an element at its middle, from the next step on.

        :param force: N, in the map.
        :param torque: Nm, in the map.
        :param duration: s; at least one step.
        :raises UnknownName: it is not in the simulated world.
        :raises Refused: it is fixed.
        :raises WrongValue: a number is not finite or absurd.
        """
        body, link = self._handle(eid)
        if eid in self.bodies and not self.bodies[eid].movable:
            raise Refused(f"{eid} is fixed: it cannot be pushed")
        numbers = finite((*force, *torque, duration), 7, f"push of {eid}")
        if max(map(abs, numbers)) > _STRONGEST or duration < 0:
            raise WrongValue(f"push of {eid}: expected up to {_STRONGEST} N, Nm and s, got {numbers}")
        fx, fy, fz, tx, ty, tz, _ = numbers
        self._pushes.add(body, link, (fx, fy, fz), (tx, ty, tz), max(1, round(duration * RATE)))

    # -- contacts ---------------------------------------------------------------------------------------------

    def contacts(self, eid: str = "") -> list[Contact]:
        """What touches what after the last step, each pair once, in order of their names.

        :param eid: only contacts of this element.
        :raises UnknownName: it is not in the simulated world.
        """
        points = self.bullet.getContactPoints() if not eid else self.bullet.getContactPoints(self._handle(eid)[0])
        return joined_contacts(points, self.name_of)

    def element_of(self, body: int) -> str | None:
        """The id of the element that a body of PyBullet is; None for the ground and what is no element."""
        return self._elements.get(body)

    def name_of(self, body: int, link: int = -1) -> str:
        """As contacts name it: the id of an element, or robot/link."""
        eid = self._elements.get(body, GROUND)
        robot = self.robots.get(eid)
        return eid if robot is None else f"{robot.name}/{robot.link_name(link)}"

    # -- things ----------------------------------------------------------------------------------------------

    def _make_ground(self) -> int:
        bullet = self.bullet
        shape = bullet.createCollisionShape(bullet.GEOM_PLANE)
        seen = bullet.createVisualShape(
            bullet.GEOM_BOX,
            halfExtents=(15, 15, 0.01),
            rgbaColor=(0.8, 0.8, 0.78, 1),
            visualFramePosition=(0, 0, -0.01),
        )
        body: int = bullet.createMultiBody(0, shape, seen)
        bullet.changeDynamics(body, -1, lateralFriction=0.9)
        return body

    def add_body(self, spec: BodySpec) -> None:
        """Adds a thing. It is a box when its model does not load; that, or that it has no size either, is a problem."""
        if spec.id in self:
            self.problems.append(Problem(spec.id, "it is left out: there is another one of that id"))
            return
        number = sum(body.movable == spec.movable for body in self.bodies.values())
        try:
            body = Body(self.bullet, spec, self.scene.models, number)
        except ConfigurationError as error:
            if spec.size is None:
                self.problems.append(Problem(spec.id, f"it is left out: {error}", spec.model))
                return
            self.problems.append(Problem(spec.id, f"it is a box instead: {error}", spec.model))
            body = Body(self.bullet, dataclasses.replace(spec, model=""), (), number)
        self.bodies[spec.id] = body
        self._elements[body.body] = spec.id

    def _add_robot(self, spec: RobotSpec) -> None:
        model = compose(spec, self.scene.models)
        self.problems += model.problems
        try:
            robot = Robot(self.bullet, spec, model)
        except ConfigurationError as error:
            self.problems.append(Problem(spec.id, f"the robot is left out: {error}"))
            return
        self.robots[spec.id] = robot
        self.arms |= robot.arms
        self.grippers |= {arm.gripper.id: arm.gripper for arm in robot.arms.values() if arm.gripper is not None}
        self.cameras |= {camera.id: camera for camera in spec.cameras}
        self._elements[robot.body] = spec.id
        for link in robot.base_links:  # it is held upright by its motors; wheels that do not turn would brake it
            self.bullet.setCollisionFilterPair(robot.body, self._ground, link, -1, 0)

    def remove_body(self, eid: str) -> None:
        """Takes a thing away.

        :raises UnknownName: there is none.
        """
        if eid not in self.bodies:
            raise UnknownName(f"there is no body {eid!r} in the simulated world")
        body = self.bodies.pop(eid)
        self._pushes.forget(body.body)
        self._elements.pop(body.body)
        self.bullet.removeBody(body.body)

    def _jittered(self, spec: BodySpec) -> BodySpec:
        far, turn = self._noise
        if not spec.movable or not (far or turn):
            return spec
        dx, dy, yaw = (float(amount) for amount in self.random.uniform(-1, 1, 3) * (far, far, turn))
        x, y, z = spec.pose.position
        turned = multiplied(from_euler(0.0, 0.0, yaw), spec.pose.orientation)
        return dataclasses.replace(spec, pose=Pose((x + dx, y + dy, z), turned))

    def __contains__(self, eid: object) -> bool:
        """Whether an element is in the simulated world."""
        return eid in set(self._ids())

    # -- names ------------------------------------------------------------------------------------------------

    def _ids(self) -> Iterator[str]:
        for known in (self.bodies, self.robots, self.arms, self.grippers, self.cameras):
            yield from known

    def _handle(self, eid: str) -> tuple[int, int]:
        """PyBullet's body and link of an element."""
        if eid in self.bodies:
            return self.bodies[eid].body, -1
        if eid in self.robots:
            robot = self.robots[eid]
            return robot.body, robot.links[BASE_LINK]
        if eid in self.arms:
            return self.arms[eid].body, self.arms[eid].mount_link
        if eid in self.grippers:
            return self.grippers[eid].body, self.grippers[eid].tool_link
        if eid in self.cameras and self.cameras[eid].parent:
            return self._handle(self.cameras[eid].parent)
        raise UnknownName(f"{eid!r} is not in the simulated world; in it are: {', '.join(self._ids()) or 'none'}")

    def _pose_of_holder(self, camera: CameraSpec) -> Pose:
        if not camera.parent:
            return IDENTITY
        arm = self.arms.get(camera.parent)
        return arm.tool_pose() if arm is not None else self.pose_of(camera.parent)


def _checked_seed(seed: int) -> int:
    if seed < 0:
        raise WrongValue(f"expected a seed of 0 or more, got {seed}")
    return seed


def _checked(pose: Pose, eid: str) -> Pose:
    x, y, z = finite(pose.position, 3, f"{eid}: position")
    qx, qy, qz, qw = finite(pose.orientation, 4, f"{eid}: orientation")
    length = math.sqrt(qx * qx + qy * qy + qz * qz + qw * qw)
    if max(abs(x), abs(y), abs(z)) > _FARTHEST:
        raise WrongValue(f"{eid}: expected a position within {_FARTHEST} m, got {(x, y, z)}")
    if not 0.9 < length < 1.1:
        raise WrongValue(f"{eid}: expected a quaternion of length 1, got {(qx, qy, qz, qw)}")
    return Pose((x, y, z), (qx / length, qy / length, qz / length, qw / length))
