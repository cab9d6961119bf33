"""Pictures of cameras: the gateway's node with drivers that publish their images, also wrong ones; judged by Qt."""

from __future__ import annotations

import json
import urllib.error
import urllib.request
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
import rospy
from PyQt5.QtCore import QByteArray
from PyQt5.QtGui import QImage
from sensor_msgs.msg import CompressedImage, Image
from std_msgs.msg import Header, String

from support.job_cell import TOKENS, JobCell, job_cell
from support.pictures import BLUE, RED, compressed, quarters
from support.ros import RosMaster, wait_until

pytestmark = pytest.mark.timeout(180)


class Driver:
    """A camera of the scene, and the publisher of its topic. A context manager."""

    def __init__(self, cell: JobCell, topic: str, kind: Any) -> None:
        self._cell, self._topic = cell, topic
        self._publisher = rospy.Publisher(topic, kind, queue_size=1, latch=True) if kind else None
        self._eid = cell.world.thing("skiros:DepthCamera", "camera", RgbTopic=topic)

    def __enter__(self) -> Driver:
        live = "/api/live"
        wait_until(lambda: self._eid in self._cell.rest.get(live)["document"]["elements"], what="the camera's element")
        return self

    def __exit__(self, *_: object) -> None:
        wm = self._cell.world.wm
        wm.remove_element(wm.get_element(self._eid))
        if self._publisher is not None:
            self._publisher.unregister()

    def publish(self, message: Any) -> None:
        assert self._publisher is not None
        self._publisher.publish(message)

    def picture(self, tag: str = "") -> Answer:
        headers = {"Authorization": f"Bearer {TOKENS['view']}", **({"If-None-Match": tag} if tag else {})}
        url = f"{self._cell.rest.address}/api/live/cameras/{self._eid}/picture"
        try:
            with urllib.request.urlopen(urllib.request.Request(url, headers=headers), timeout=30.0) as answer:
                fields = answer.headers
                return Answer(answer.status, fields["ETag"], float(fields["X-Age"]), answer.read())
        except urllib.error.HTTPError as error:
            data = error.read()
            return Answer(error.code, reason=json.loads(data)["detail"] if data else "")

    def shows(self, colour: tuple[int, int, int], x: float = 0.25, y: float = 0.25) -> Answer:
        """Waits for a picture with a colour at a place (shares of width and height)."""

        def found() -> Answer | None:
            answer = self.picture()
            return answer if answer.status == 200 and is_near(answer.colour(x, y), colour) else None

        return wait_until(found, what=f"{colour} in the picture of {self._topic}")  # type: ignore[no-any-return]

    @property
    def is_subscribed(self) -> bool:
        return "/gateway" in self._cell.ros.master.subscribers(self._topic)


@dataclass
class Answer:
    status: int
    tag: str = ""
    age: float = 0.0
    jpeg: bytes = b""
    reason: str = ""

    def colour(self, x: float, y: float) -> tuple[int, int, int]:
        picture = QImage.fromData(QByteArray(self.jpeg), "JPG")
        assert not picture.isNull()
        found = picture.pixelColor(int(x * picture.width()), int(y * picture.height()))
        return found.red(), found.green(), found.blue()


def is_near(one: tuple[int, ...], other: tuple[int, ...]) -> bool:
    return all(abs(a - b) < 25 for a, b in zip(one, other, strict=True))


def raw(pixels: Any, age: float = 0.0, **fields: Any) -> Image:
    height, width, _ = pixels.shape
    header = Header(stamp=rospy.Time.now() - rospy.Duration.from_sec(age))
    good = {"width": width, "height": height, "step": 3 * width, "encoding": "rgb8", "data": pixels.tobytes()}
    return Image(header=header, **{**good, **fields})


@pytest.fixture(scope="module")
def cell(ros_master: RosMaster, tmp_path_factory: pytest.TempPathFactory) -> Iterator[JobCell]:
    with job_cell(ros_master, tmp_path_factory.mktemp("cameras"), products=0, agents="off") as made:
        yield made


def test_pictures_follow_the_driver_while_somebody_looks(cell: JobCell) -> None:
    with Driver(cell, "/shelf_camera/image", Image) as camera:
        assert "no image has come" in camera.picture().reason
        camera.publish(raw(quarters((0, 1, 2))))
        first = camera.shows(RED)
        assert is_near(first.colour(0.25, 0.75), BLUE)
        assert camera.picture(first.tag).status == 304
        camera.publish(raw(quarters((2, 1, 0)), age=7.0))
        second = camera.shows(BLUE)
        assert second.tag != first.tag
        assert 7.0 <= second.age < 30.0
        assert camera.is_subscribed
        wait_until(lambda: not camera.is_subscribed, what="the end of the subscription")
        camera.publish(raw(quarters((0, 1, 2))))
        camera.shows(RED)


def test_compressed_images_are_shown(cell: JobCell) -> None:
    with Driver(cell, "/gripper_camera/image/compressed", CompressedImage) as camera:
        for kind in ("JPG", "PNG"):
            camera.publish(CompressedImage(format="wrong", data=compressed(kind, quarters((0, 1, 2)))))
            camera.shows(RED)
            camera.publish(CompressedImage(data=compressed(kind, quarters((2, 1, 0)))))
            camera.shows(BLUE)


def test_topics_without_images_are_not_subscribed_to(cell: JobCell) -> None:
    with Driver(cell, "/words", String) as camera:
        answer = camera.picture()
        assert answer.status == 409
        assert "std_msgs/String" in answer.reason and "sensor_msgs/Image" in answer.reason
        assert not camera.is_subscribed
    with Driver(cell, "/nothing", None) as camera:
        assert camera.picture().reason == "no node publishes /nothing"
        assert not camera.is_subscribed
    with Driver(cell, "not a topic!", None) as camera:
        assert "is no name of a topic" in camera.picture().reason


@pytest.mark.parametrize("wrong", [
    lambda good: raw(good, width=2**32 - 1, height=2**32 - 1, step=2**32 - 1),
    lambda good: raw(good, height=1),
    lambda good: raw(good, step=2**32 - 1),
    lambda good: raw(good, encoding="x" * 10**6),
    lambda good: raw(good, data=b""),
    lambda good: raw(np.zeros((6000, 6000, 1), np.uint8), encoding="mono8", step=6000),
], ids=["size", "height", "step", "encoding", "no data", "large"])  # fmt: skip
def test_wrong_images_are_named_and_the_next_good_one_is_shown(
    cell: JobCell, wrong: Any, request: pytest.FixtureRequest
) -> None:
    good, number = quarters((0, 1, 2)), request.node.callspec.indices["wrong"]
    with Driver(cell, f"/wrong_{number}/image", Image) as camera:
        camera.publish(wrong(good))
        answer = wait_until(lambda: "expected" in (found := camera.picture()).reason and found, what="the reason")
        assert answer.status == 409
        assert len(answer.reason) < 500
        camera.publish(raw(good))
        camera.shows(RED)


class Garbage(Image):  # type: ignore[misc]
    """Bytes that are no message."""

    def serialize(self, buff: Any) -> None:
        buff.write(b"\xff" * 100)


def test_bytes_that_are_no_message_are_survived(cell: JobCell) -> None:
    with Driver(cell, "/garbage/image", Image) as camera:
        camera.publish(Garbage())
        assert "no image has come" in camera.picture().reason
        camera.publish(raw(quarters((0, 1, 2))))
        camera.shows(RED)


def test_driver_that_ends_and_comes_back_with_another_type_is_shown(cell: JobCell) -> None:
    with Driver(cell, "/moved/image", Image) as camera:
        camera.publish(raw(quarters((0, 1, 2))))
        camera.shows(RED)
    with Driver(cell, "/moved/image", CompressedImage) as camera:
        camera.publish(CompressedImage(data=compressed("PNG", quarters((2, 1, 0)))))
        camera.shows(BLUE)


def test_many_cameras_take_turns_and_none_stays_subscribed(cell: JobCell) -> None:
    cameras = [Driver(cell, f"/many_{number}/image", Image) for number in range(10)]
    for camera in cameras:
        camera.publish(raw(quarters((0, 1, 2))))
        with camera:
            camera.shows(RED)
            assert sum(each.is_subscribed for each in cameras) <= 8
    wait_until(lambda: not any(each.is_subscribed for each in cameras), what="the end of all subscriptions")
