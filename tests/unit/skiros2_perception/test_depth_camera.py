"""Views from the messages of a camera: which images are used, and what is reported while one is missing."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import rospy
from sensor_msgs.msg import CameraInfo, Image
from std_msgs.msg import Header

from skiros2_common.core.errors import WrongValue
from skiros2_motion.core.geometry import IDENTITY
from skiros2_perception.ros import depth_camera
from skiros2_perception.ros.depth_camera import DepthCamera, Topics

START = 10.0


class Camera:
    """A camera without a master: `send` calls the subscribers."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self._callbacks: dict[str, Callable[[Any], None]] = {}
        self.closed: list[str] = []
        self.frames = {"camera"}
        known = SimpleNamespace(at=lambda base, frame, stamp: IDENTITY if frame in self.frames else None)
        monkeypatch.setattr(depth_camera, "transforms", lambda: known)
        monkeypatch.setattr(rospy, "Subscriber", self._subscribe)
        monkeypatch.setattr(rospy.Time, "now", lambda: rospy.Time.from_sec(START))
        self.woken = 0
        self.camera = DepthCamera(Topics("/camera/depth", colour="/camera/colour"), "map", self._wake)

    def _subscribe(self, topic: str, kind: type, callback: Callable[[Any], None], queue_size: int) -> Any:
        self._callbacks[topic] = callback
        return SimpleNamespace(unregister=lambda: self.closed.append(topic))

    def _wake(self) -> None:
        self.woken += 1

    def send(self, topic: str, message: Any) -> None:
        self._callbacks[topic](message)

    def depth(self, stamp: float, frame: str = "camera") -> None:
        data = np.full((20, 30), 1.0 + stamp / 1000, "<f4").tobytes()
        header = Header(frame_id=frame, stamp=rospy.Time.from_sec(stamp))
        self.send("/camera/depth", Image(header, 20, 30, "32FC1", 0, 120, data))

    def colour(self, stamp: float) -> None:
        header = Header(frame_id="camera", stamp=rospy.Time.from_sec(stamp))
        self.send("/camera/colour", Image(header, 20, 30, "rgb8", 0, 90, bytes(1800)))

    def info(self, width: int = 30) -> None:
        p = (100.0, 0.0, 15.0, 0.0, 0.0, 100.0, 10.0, 0.0, 0.0, 0.0, 1.0, 0.0)
        self.send("/camera/camera_info", CameraInfo(header=Header(frame_id="camera"), width=width, height=20, P=p))


@pytest.fixture
def camera(monkeypatch: pytest.MonkeyPatch) -> Camera:
    return Camera(monkeypatch)


def test_complete_view_has_the_depth_and_colours_of_one_stamp(camera: Camera) -> None:
    camera.info()
    camera.colour(11.0)
    camera.depth(11.0)
    view = camera.camera.poll()
    assert view is not None and view.stamp == 11.0 and view.rgb is not None and view.focal == (100.0, 100.0)
    assert camera.woken == 3


def test_missing_parts_are_named_one_after_the_other(camera: Camera) -> None:
    reasons = [camera.camera.waiting]
    camera.depth(11.0, "elsewhere")
    for step in (camera.info, lambda: camera.frames.add("elsewhere")):
        assert camera.camera.poll() is None
        reasons.append(camera.camera.waiting)
        step()
    assert camera.camera.poll() is None
    reasons.append(camera.camera.waiting)
    assert reasons == [
        "no message on /camera/depth",
        "no camera_info beside the depth image",
        "no transform from 'elsewhere' to 'map' on tf at 11.000 s",
        "no colour image on /camera/colour at 11.000 s",
    ]


def test_image_from_before_the_start_is_not_used_and_replaced(camera: Camera) -> None:
    camera.info()
    camera.colour(9.0)
    camera.depth(9.0)
    assert camera.camera.poll() is None
    assert camera.camera.waiting == "the last message is 1.0 s older than the start of the skill"
    camera.colour(11.0)
    camera.depth(11.0)
    view = camera.camera.poll()
    assert view is not None and view.stamp == 11.0


def test_complete_image_is_kept_until_its_transform_is_known(camera: Camera) -> None:
    camera.frames.clear()
    camera.info()
    camera.colour(11.0)
    camera.depth(11.0)
    camera.depth(12.0)
    camera.frames.add("camera")
    view = camera.camera.poll()
    assert view is not None and view.stamp == 11.0


def test_camera_info_of_another_image_is_refused(camera: Camera) -> None:
    camera.info(width=640)
    camera.colour(11.0)
    camera.depth(11.0)
    with pytest.raises(WrongValue, match="640 x 20 pixels: expected 30 x 20"):
        camera.camera.poll()


def test_closed_camera_has_no_subscriptions(camera: Camera) -> None:
    camera.camera.close()
    assert camera.closed == ["/camera/depth", "/camera/camera_info", "/camera/colour"]
