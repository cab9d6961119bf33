"""Publishes the images of the simulated cameras."""

from __future__ import annotations

import rospy
from sensor_msgs.msg import CameraInfo, Image
from std_msgs.msg import Header

from skiros2_sim.core.camera import picture_of
from skiros2_sim.core.scene_spec import CameraSpec
from skiros2_sim.core.stepper import Stepper
from skiros2_sim.core.world import RATE, World
from skiros2_sim.ros.frames import Frames
from skiros2_sim.ros.messages import camera_info, colour_image, depth_image
from skiros2_sim.ros.publishers import LateTopic, SimulatedClock


class Cameras:
    """Publishes images in the stepping thread, while there are subscribers.

    :param rate: Hz of simulated time; 0 for never.
    """

    def __init__(self, world: World, stepper: Stepper, clock: SimulatedClock, frames: Frames, rate: float) -> None:
        self._world = world
        self._stepper = stepper
        self._clock = clock
        self._frames = frames
        self._period = max(1, round(RATE / rate)) if rate else 0
        self._topics = {camera.id: _Topics(camera) for camera in world.cameras.values()} if rate else {}

    def after_step(self) -> None:
        """Publishes what is due."""
        if self._period and self._stepper.count % self._period == 0:
            for camera, topics in self._topics.items():
                if topics.are_listened_to:
                    topics.put(self._world, self._messages(camera))
                topics.send(self._world)

    def clear(self) -> None:
        """Discards delayed images, after a reset of the world."""
        for topics in self._topics.values():
            topics.clear()

    def _messages(self, camera: str) -> tuple[Image, Image, CameraInfo]:
        picture = picture_of(self._world, camera)
        header = Header(stamp=self._clock.now, frame_id=self._frames.camera(camera))
        return colour_image(picture, header), depth_image(picture, header), camera_info(picture, header)


class _Topics:
    """The topics of one camera: colour, depth, and a camera_info for each."""

    def __init__(self, camera: CameraSpec) -> None:
        # images are large: a slow subscriber gets the newest one
        self._colour = LateTopic(camera.rgb_topic, Image, (camera.id,), queue_size=2)
        self._depth = LateTopic(camera.depth_topic, Image, (camera.id,), queue_size=2)
        self._infos = [
            LateTopic(name, CameraInfo, (camera.id,), queue_size=2)
            for name in sorted({_info(camera.rgb_topic), _info(camera.depth_topic)})
        ]

    @property
    def are_listened_to(self) -> bool:
        return any(topic.has_subscribers for topic in self._all())

    def put(self, world: World, messages: tuple[Image, Image, CameraInfo]) -> None:
        colour, depth, info = messages
        self._colour.put(world, colour)
        self._depth.put(world, depth)
        for topic in self._infos:
            topic.put(world, info)

    def send(self, world: World) -> None:
        for topic in self._all():
            topic.send(world)

    def clear(self) -> None:
        for topic in self._all():
            topic.clear()

    def _all(self) -> list[LateTopic]:
        return [self._colour, self._depth, *self._infos]


def _info(topic: str) -> str:
    """Returns the camera_info topic beside an image topic."""
    return rospy.names.ns_join(topic.rpartition("/")[0] or "/", "camera_info")
