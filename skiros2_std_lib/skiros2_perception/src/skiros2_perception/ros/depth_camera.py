"""The views of a depth camera, from its topics and tf."""

from __future__ import annotations

import functools
import threading
from collections.abc import Callable
from typing import Any, NamedTuple

import rospy
from sensor_msgs.msg import CameraInfo, Image, PointCloud2

from skiros2_common.core.errors import SkirosError, WrongValue
from skiros2_motion.core.geometry import Pose
from skiros2_perception.core.view import View, view_of_points
from skiros2_perception.ros.messages import colours_of, depth_of, lens_of, points_of
from skiros2_std_reasoners.ros.transforms import Transforms

#: Number of colour images that are kept, to find the one of a depth image.
_COLOURS = 5


class Topics(NamedTuple):
    """The topics of a camera.

    :param depth: rectified `sensor_msgs/Image`, with `camera_info` beside it; "" for point clouds.
    :param cloud: organised `sensor_msgs/PointCloud2`; "" for images.
    :param colour: `sensor_msgs/Image` of the same pixels and stamps as the depth images; "" without colours.
    """

    depth: str = ""
    cloud: str = ""
    colour: str = ""


@functools.cache
def transforms() -> Transforms:
    """Returns the transforms of this process, subscribed to tf from the first call on."""
    found = Transforms()
    found.listen()
    return found


class DepthCamera:
    """Waits for a view. Messages are received in threads of ROS; `poll` and `close` are called by one thread.

    A view is used if its stamp is later than the creation of this object: an arm that has just stopped was still moving
    in earlier ones.

    :param frame: reference frame of the views.
    :param on_message: called after each message, in a thread of ROS.
    """

    def __init__(self, topics: Topics, frame: str, on_message: Callable[[], None]) -> None:
        self._frame = frame
        self._topics = topics
        self._on_message = on_message
        self._since = rospy.Time.now()
        self._lock = threading.Lock()
        self._image: Any = None
        self._info: CameraInfo | None = None
        self._colours: dict[Any, Image] = {}
        transforms()
        main, kind = (topics.cloud, PointCloud2) if topics.cloud else (topics.depth, Image)
        self._subscribers = [rospy.Subscriber(main, kind, self._on_image, queue_size=1)]
        if not topics.cloud:
            folder = topics.depth.rpartition("/")[0]
            info = f"{folder}/camera_info" if folder else "camera_info"
            self._subscribers.append(rospy.Subscriber(info, CameraInfo, self._on_info, queue_size=1))
            if topics.colour:
                self._subscribers.append(rospy.Subscriber(topics.colour, Image, self._on_colour, queue_size=_COLOURS))
        #: The reason why there is no view yet.
        self.waiting = f"no message on {rospy.resolve_name(main)}"

    def close(self) -> None:
        """Ends the subscriptions."""
        for subscriber in self._subscribers:
            subscriber.unregister()

    def poll(self) -> View | None:
        """Returns a view; None while something is missing, which `waiting` names.

        :raises WrongValue: a message is unusable.
        """
        with self._lock:
            image, info, colours = self._image, self._info, dict(self._colours)
        if image is None:
            return None
        if not self._topics.cloud and info is None:
            self.waiting = "no camera_info beside the depth image"
            return None
        header = image.header
        if header.stamp < self._since:
            age = (self._since - header.stamp).to_sec()
            self.waiting = f"the last message is {age:.1f} s older than the start of the skill"
            return None
        pose = transforms().at(self._frame, header.frame_id, header.stamp)
        if pose is None:
            frames = f"from {header.frame_id!r} to {self._frame!r}"
            self.waiting = f"no transform {frames} on tf at {header.stamp.to_sec():.3f} s"
            return None
        colour = colours.get(header.stamp)
        if self._topics.colour and not self._topics.cloud and colour is None:
            self.waiting = f"no colour image on {self._topics.colour} at {header.stamp.to_sec():.3f} s"
            return None
        return self._view(image, info, colour, pose)

    def _view(self, image: Any, info: CameraInfo | None, colour: Image | None, pose: Pose) -> View:
        stamp = image.header.stamp.to_sec()
        if info is None:
            return view_of_points(points_of(image), pose, self._frame, stamp)
        problems: list[str] = []
        depth = _tried(problems, depth_of, image)
        lens = _tried(problems, lens_of, info, image)
        rgb = None if colour is None else _tried(problems, colours_of, colour)
        if problems:
            raise WrongValue("; ".join(problems))
        return View(depth, *lens, pose, self._frame, stamp, rgb)

    def _on_image(self, message: Any) -> None:
        with self._lock:
            before = self._image.header.stamp if self._image is not None else rospy.Time(0)
            if before >= self._since and before in self._colours:
                return  # the present image is complete: it waits for its transform
            self._image = message
        self._on_message()

    def _on_info(self, message: CameraInfo) -> None:
        with self._lock:
            self._info = message
        self._on_message()

    def _on_colour(self, message: Image) -> None:
        with self._lock:
            self._colours[message.header.stamp] = message
            while len(self._colours) > _COLOURS:
                del self._colours[min(self._colours)]
        self._on_message()


def _tried(problems: list[str], read: Callable[..., Any], *arguments: Any) -> Any:
    """Calls a reader; collects its error."""
    try:
        return read(*arguments)
    except SkirosError as error:
        problems.append(str(error))
        return None
