"""The tf frames of the simulated world, and poses of other tf frames."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

from skiros2_common.core.errors import UnknownName
from skiros2_motion.core.geometry import IDENTITY, Pose, composed, inverted
from skiros2_sim.core.robot_model import BASE_LINK
from skiros2_sim.core.scene_spec import CameraSpec, SceneSpec
from skiros2_sim.core.world import World
from skiros2_std_reasoners.ros.transforms import Transforms

#: Returns the pose of a frame in the map.
Reference = Callable[[World], Pose]

ODOM = "odom"
#: Minimum joint motion (rad, m) to publish: the motors of an arm at rest oscillate.
_STILL = 1e-5


class Frames:
    """map -> ROBOT/odom -> ROBOT/base_link -> ROBOT/LINK and ROBOT/CAMERA; other cameras are children of the map.

    The frames of a robot do not change with a reset.
    """

    def __init__(self, world: World) -> None:
        self.map = world.scene.map_frame
        self._cameras = {eid: frame for eid, frame in _cameras(world.scene) if eid in world.cameras}
        self._robots = {robot.name: eid for eid, robot in world.robots.items()}
        self._links = {eid: frozenset(robot.link_poses()) for eid, robot in world.robots.items()}
        self._transforms = Transforms()
        self._last_joints: dict[str, list[float]] = {}

    def camera(self, eid: str) -> str:
        """Returns the optical frame of a camera."""
        return self._cameras[eid]

    def reference(self, frame: str) -> Reference:
        """Returns a function for the pose of a frame: evaluated later for a simulated frame, looked up now on tf for
        others. May block for one second; must not be called in the stepping thread.

        :param frame: "" for the map.
        :raises UnknownName: the frame is unknown.
        """
        name = frame.lstrip("/")
        if not name or name == self.map:
            return lambda world: IDENTITY
        robot, _, link = name.partition("/")
        if robot in self._robots:
            eid = self._robots[robot]
            if link == ODOM:
                return lambda world: IDENTITY
            if link in self._links[eid]:
                return lambda world: world.robots[eid].link_pose(link)
        for camera, its_frame in self._cameras.items():
            if name == its_frame:
                return lambda world: world.pose_of(camera)
        pose = self._transforms.find(self.map, name)
        if pose is None:
            raise UnknownName(f"frame {frame!r} is neither in the simulated world nor on tf")
        return lambda world: pose

    def moved(self, world: World) -> Iterator[tuple[str, str, Pose]]:
        """Yields the frames that have moved since the last call: parent, name, pose in the parent. Called in the
        stepping thread."""
        for robot in world.robots.values():
            base = f"{robot.name}/{BASE_LINK}"
            in_map = robot.pose()
            yield f"{robot.name}/{ODOM}", base, in_map
            joints = robot.joint_positions()
            last = self._last_joints.get(robot.id)
            if last is not None and all(abs(now - then) < _STILL for now, then in zip(joints, last, strict=True)):
                continue
            self._last_joints[robot.id] = joints
            from_base = inverted(in_map)
            if last is None:
                yield self.map, f"{robot.name}/{ODOM}", IDENTITY
            for link, pose in robot.link_poses().items():
                if link != BASE_LINK and (last is None or robot.links[link] not in robot.base_links):
                    yield base, f"{robot.name}/{link}", composed(from_base, pose)
            for camera in self._there(robot.spec.cameras):
                yield base, self._cameras[camera], composed(from_base, world.pose_of(camera))
        for camera in self._there(world.scene.cameras):
            yield self.map, self._cameras[camera], world.pose_of(camera)

    def _there(self, cameras: Sequence[CameraSpec]) -> list[str]:
        return [camera.id for camera in cameras if camera.id in self._cameras]


def _cameras(scene: SceneSpec) -> Iterator[tuple[str, str]]:
    for robot in scene.robots:
        for camera in robot.cameras:
            yield camera.id, f"{robot.name}/{camera.name}"
    yield from ((camera.id, camera.name) for camera in scene.cameras)
