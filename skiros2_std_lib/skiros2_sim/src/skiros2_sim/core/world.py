"""The simulated world: bodies and robots in physics. Not thread-safe."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator
from types import TracebackType

import numpy as np

from skiros2_common.core.errors import ConfigurationError, Refused, SkirosError, UnknownName, WrongValue
from skiros2_motion.core.geometry import IDENTITY, Pose, Vector, composed, from_euler, multiplied
from skiros2_motion.core.motion import MotionList
from skiros2_motion.core.numbers import finite
from skiros2_sim.core.arm import Arm
from skiros2_sim.core.body import Body
from skiros2_sim.core.bullet import Bullet
from skiros2_sim.core.contacts import Contact, joined_contacts
from skiros2_sim.core.faults import Faults
from skiros2_sim.core.gripper import Gripper
from skiros2_sim.core.latches import Latches
from skiros2_sim.core.overlaps import separate_overlaps
from skiros2_sim.core.physics import Part, Physics
from skiros2_sim.core.pushes import Pushes
from skiros2_sim.core.robot import Robot
from skiros2_sim.core.robot_model import BASE_LINK, merge_models
from skiros2_sim.core.scene_spec import BodySpec, CameraSpec, Problem, RobotSpec, SceneSpec
from skiros2_sim.core.wrist_sensor import EXACT, SensorModel

#: Default number of steps per second, and its limits.
RATE, MIN_RATE, MAX_RATE = 240, 240, 2000
GROUND = "ground"
_GROUND_FRICTION = 0.9

_MAX_DISTANCE = 1000.0  # m; beyond it the floats of the engine are too coarse
_MAX_FORCE = 1e5  # N or Nm


class World:
    """A scene in physics.

    :param seed: of all random numbers; the same seed and steps give bit-identical runs.
    :param gui: whether to show PyBullet's window.
    :param position_noise, yaw_noise: maximum offset in x and y (m), and rotation (rad), of movable bodies at the start.
    :param rate: steps per second; 1000 for scenes with tight fits and stiff contacts.
    :param sensor: errors of the force/torque sensors at the wrists.
    :param visuals: whether robots can be seen, by cameras or in a window; without, a world is built faster.
    :raises WrongValue: the seed is negative, a noise is not finite, or the rate is out of range.
    :raises Refused: no window can be opened.

    `problems` lists what could not be simulated as described. After `reset`, look bodies, robots and arms up again.
    """

    def __init__(
        self,
        scene: SceneSpec,
        seed: int = 0,
        gui: bool = False,
        position_noise: float = 0.0,
        yaw_noise: float = 0.0,
        rate: int = RATE,
        sensor: SensorModel = EXACT,
        visuals: bool = True,
    ) -> None:
        self.scene = scene
        self.rate = _check_rate(rate)
        self.dt = 1.0 / rate
        self._sensor, self._visuals = sensor, visuals
        self._noise = (*finite((position_noise, yaw_noise), 2, "noise of the world"),)
        self._seed = _check_seed(seed)
        self.physics: Physics = Bullet(gui)
        try:
            self._build()
        except SkirosError:
            self.close()
            raise

    def _build(self) -> None:
        physics = self.physics
        physics.show(False)
        physics.reset(self.dt)
        self.random = np.random.default_rng(self._seed)
        self.steps = 0
        self.motions = MotionList()
        self.faults = Faults(self)
        self.problems: list[Problem] = list(self.scene.problems)
        self.bodies: dict[str, Body] = {}
        self.robots: dict[str, Robot] = {}
        self.arms: dict[str, Arm] = {}
        self.grippers: dict[str, Gripper] = {}
        self.cameras: dict[str, CameraSpec] = {camera.id: camera for camera in self.scene.cameras}
        self._pushes = Pushes(physics)
        self._latches = Latches(physics, self.dt)
        self._elements: dict[int, str] = {}
        self._ground = physics.add_ground(_GROUND_FRICTION)
        for spec in self.scene.bodies:
            self.add_body(self._with_noise(spec))
        for robot in self.scene.robots:
            self._add_robot(robot)
        for camera in [camera for camera in self.cameras.values() if camera.parent and camera.parent not in self]:
            del self.cameras[camera.id]
            self.problems.append(Problem(camera.id, f"omitted: its parent {camera.parent} does not exist"))
        self.problems += separate_overlaps(physics, self.bodies, lambda body: self._elements.get(body, GROUND))
        physics.show(True)

    # -- time -------------------------------------------------------------------------------------------------

    @property
    def seed(self) -> int:
        return self._seed

    @property
    def time(self) -> float:
        """Simulated time since the start or the last reset (s)."""
        return self.steps / self.rate

    def step(self, count: int = 1) -> None:
        """Makes `count` steps. An exception of a motion propagates, and the motion is removed."""
        for _ in range(count):
            self.motions.update(self.dt)
            self.faults.update()
            for robot in self.robots.values():
                robot.before_step()
            self._pushes.update()
            self._latches.update()
            self.physics.step()
            self.steps += 1
            for arm in self.arms.values():
                arm.after_step()

    def reset(self, seed: int | None = None) -> None:
        """Returns to the start: the same state as that of a new world.

        :param seed: a new seed; None for the current one.
        :raises WrongValue: the seed is negative.
        """
        if seed is not None:
            self._seed = _check_seed(seed)
        self._build()

    def close(self) -> None:
        """Disconnects from the engine. Further calls do nothing."""
        self.physics.close()

    def __enter__(self) -> World:
        return self

    def __exit__(self, kind: type | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()

    # -- where things are -------------------------------------------------------------------------------------

    def pose_of(self, eid: str) -> Pose:
        """Returns the true pose of an element in the map: of a gripper, its tool frame; of an arm, its mount; of a
        camera, its optical frame.

        :raises UnknownName: the element is not in the simulated world.
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
            return composed(self._pose_of_parent(camera), camera.pose)
        raise UnknownName(f"{eid!r} is not in the simulated world; in it are: {', '.join(self._ids()) or 'none'}")

    def part_of(self, eid: str) -> Part:
        """Returns the link of an element: of a gripper, the tool; of an arm, the mount; of a camera, its parent's.

        :raises UnknownName: the element is not in the simulated world.
        """
        if eid in self.bodies:
            return Part(self.bodies[eid].body)
        if eid in self.robots:
            robot = self.robots[eid]
            return Part(robot.body, robot.links[BASE_LINK])
        if eid in self.arms:
            return Part(self.arms[eid].body, self.arms[eid].mount_link)
        if eid in self.grippers:
            return Part(self.grippers[eid].body, self.grippers[eid].tool_link)
        if eid in self.cameras and self.cameras[eid].parent:
            return self.part_of(self.cameras[eid].parent)
        raise UnknownName(f"{eid!r} is not in the simulated world; in it are: {', '.join(self._ids()) or 'none'}")

    def velocity_of(self, eid: str) -> tuple[Vector, Vector]:
        """Returns the linear (m/s) and angular (rad/s) velocity of an element, in the map; of a part, that of its link.

        :raises UnknownName: the element is not in the simulated world.
        """
        return self.physics.velocity(self.part_of(eid))

    def set_pose(self, eid: str, pose: Pose) -> None:
        """Moves a body or a robot to a pose, at rest.

        :raises UnknownName: the element is not in the simulated world.
        :raises Refused: it is a part of a robot.
        :raises WrongValue: the pose is invalid, or tilts a mobile robot.
        """
        checked = _checked(pose, eid)
        if eid in self.bodies:
            self.bodies[eid].place(checked)
        elif eid in self.robots:
            self.robots[eid].place(checked)
        else:
            self.pose_of(eid)
            raise Refused(f"{eid} is a part of a robot; move the robot instead")

    def push(self, eid: str, force: Vector, torque: Vector = (0.0, 0.0, 0.0), duration: float = 0.0) -> None:
        """Applies a force and a torque at the centre of an element, from the next step on.

        :param force: N, in the map.
        :param torque: Nm, in the map.
        :param duration: s; at least one step.
        :raises UnknownName: the element is not in the simulated world.
        :raises Refused: it is fixed.
        :raises WrongValue: a number is not finite or too large.
        """
        part = self.part_of(eid)
        if eid in self.bodies and not self.bodies[eid].movable:
            raise Refused(f"{eid} is fixed: it cannot be pushed")
        numbers = finite((*force, *torque, duration), 7, f"push of {eid}")
        if max(map(abs, numbers)) > _MAX_FORCE or duration < 0:
            raise WrongValue(f"push of {eid}: expected up to {_MAX_FORCE} N, Nm and s, got {numbers}")
        fx, fy, fz, tx, ty, tz, _ = numbers
        self._pushes.add(part, (fx, fy, fz), (tx, ty, tz), max(1, round(duration * self.rate)))

    # -- contacts ---------------------------------------------------------------------------------------------

    def contacts(self, eid: str = "") -> list[Contact]:
        """Returns the contacts of the last step, one per pair, ordered by name.

        :param eid: only contacts of this element.
        :raises UnknownName: it is not in the simulated world.
        """
        return joined_contacts(self.physics.contacts(self.part_of(eid).body if eid else None), self.name_of)

    def element_of(self, body: int) -> str | None:
        """Returns the id of the element of a body; None for the ground."""
        return self._elements.get(body)

    def name_of(self, body: int, link: int = -1) -> str:
        """Returns the name of a body in contacts: the id of an element, or robot/link."""
        eid = self._elements.get(body, GROUND)
        robot = self.robots.get(eid)
        return eid if robot is None else f"{robot.name}/{robot.link_name(link)}"

    # -- things ----------------------------------------------------------------------------------------------

    def add_body(self, spec: BodySpec) -> None:
        """Adds a body. If its model does not load, it becomes a box, or is omitted without a size; see `problems`."""
        if spec.id in self:
            self.problems.append(Problem(spec.id, "omitted: another element has this id"))
            return
        number = sum(body.movable == spec.movable for body in self.bodies.values())
        try:
            body = Body(self.physics, spec, self.scene.models, number)
        except ConfigurationError as error:
            if spec.size is None:
                self.problems.append(Problem(spec.id, f"omitted: {error}", spec.model))
                return
            self.problems.append(Problem(spec.id, f"replaced by a box: {error}", spec.model))
            body = Body(self.physics, dataclasses.replace(spec, model=""), (), number)
        self.bodies[spec.id] = body
        self._latches.add(body)
        self._elements[body.body] = spec.id

    def _add_robot(self, spec: RobotSpec) -> None:
        model = merge_models(spec, self.scene.models)
        self.problems += model.problems
        try:
            robot = Robot(self.physics, spec, model, self._visuals)
        except ConfigurationError as error:
            self.problems.append(Problem(spec.id, f"omitted: {error}"))
            return
        self.robots[spec.id] = robot
        robot.mount_sensors(self._sensor, self._seed)
        self.arms |= robot.arms
        self.grippers |= {arm.gripper.id: arm.gripper for arm in robot.arms.values() if arm.gripper is not None}
        self.cameras |= {camera.id: camera for camera in spec.cameras}
        self._elements[robot.body] = spec.id
        for link in robot.base_links:  # the drives keep it upright; fixed wheels would brake it
            self.physics.ignore_collisions(Part(robot.body, link), Part(self._ground))

    def remove_body(self, eid: str) -> None:
        """Removes a body.

        :raises UnknownName: there is no such body.
        """
        if eid not in self.bodies:
            raise UnknownName(f"there is no body {eid!r} in the simulated world")
        body = self.bodies.pop(eid)
        self._pushes.remove(body.body)
        self._latches.remove(body)
        self._elements.pop(body.body)
        self.physics.remove(body.body)

    def _with_noise(self, spec: BodySpec) -> BodySpec:
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

    def _pose_of_parent(self, camera: CameraSpec) -> Pose:
        if not camera.parent:
            return IDENTITY
        arm = self.arms.get(camera.parent)
        return arm.tool_pose() if arm is not None else self.pose_of(camera.parent)


def _check_seed(seed: int) -> int:
    if seed < 0:
        raise WrongValue(f"expected a seed of 0 or more, got {seed}")
    return seed


def _check_rate(rate: int) -> int:
    if not MIN_RATE <= rate <= MAX_RATE:
        raise WrongValue(f"rate {rate}: expected {MIN_RATE} to {MAX_RATE} steps per second")
    return rate


def _checked(pose: Pose, eid: str) -> Pose:
    x, y, z = finite(pose.position, 3, f"{eid}: position")
    qx, qy, qz, qw = finite(pose.orientation, 4, f"{eid}: orientation")
    length = math.sqrt(qx * qx + qy * qy + qz * qz + qw * qw)
    if max(abs(x), abs(y), abs(z)) > _MAX_DISTANCE:
        raise WrongValue(f"{eid}: expected a position within {_MAX_DISTANCE} m, got {(x, y, z)}")
    if not 0.9 < length < 1.1:
        raise WrongValue(f"{eid}: expected a quaternion of length 1, got {(qx, qy, qz, qw)}")
    return Pose((x, y, z), (qx / length, qy / length, qz / length, qw / length))
