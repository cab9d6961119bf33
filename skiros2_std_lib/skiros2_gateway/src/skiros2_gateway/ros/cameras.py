"""Pictures of the cell's cameras, from their topics: subscribed to only while somebody looks."""

from __future__ import annotations

import asyncio
import logging
import secrets
import threading
from time import monotonic
from typing import Any

import rosgraph
import rospy
from sensor_msgs.msg import CompressedImage, Image

from skiros2_common.command_line.master import XMLRPC_ERRORS
from skiros2_common.core.errors import Refused, SkirosError, WrongValue
from skiros2_gateway.core.pictures import Picture, jpeg_of_compressed, jpeg_of_raw
from skiros2_gateway.ros.ros_cell import RosCell

log = logging.getLogger(__name__)

#: The shortest time between two pictures of a camera (s).
_PERIOD = 0.2
#: How long a camera stays subscribed without viewers, and may be silent until it is subscribed to again (s).
_LINGER = 5.0
#: How long a request waits for the first image (s).
_FIRST = 2.0
#: The most subscribed cameras; one more ends the subscription that was read least recently.
_MOST = 8

#: The buffer of a connection (bytes): a smaller one than an image makes rospy slow.
_BUFFER = 2**24

_KINDS = {"sensor_msgs/Image": Image, "sensor_msgs/CompressedImage": CompressedImage}


class RosCameras:
    """Implements `Cameras`. Made and used in the thread of the loop; call `close` at the end."""

    def __init__(self, cell: RosCell) -> None:
        self._cell = cell
        self._master = rosgraph.Master(rospy.get_name())
        self._feeds: dict[str, _Feed] = {}  # by topic, the one that was read least recently first
        self._opening = asyncio.Lock()
        self._task = asyncio.get_running_loop().create_task(self._close_unread())

    def close(self) -> None:
        """Ends all subscriptions."""
        self._task.cancel()
        for feed in self._feeds.values():
            feed.close()

    async def picture(self, topic: str) -> Picture:
        name = _resolved(topic)
        async with self._opening:
            feed = self._feeds.get(name)
            if feed is None or feed.is_due:
                kind = await self._cell.in_thread(self._kind, name)
                if feed is not None and feed.kind is not kind:
                    await self._end(name)
                feed = self._feeds.setdefault(name, _Feed(name, kind))
                await self._cell.in_thread(feed.open)
            self._feeds[name] = self._feeds.pop(name)  # is now the last one
            if len(self._feeds) > _MOST:
                await self._end(next(iter(self._feeds)))
        return await feed.picture()

    async def _end(self, topic: str) -> None:
        await self._cell.in_thread(self._feeds[topic].close)
        self._feeds.pop(topic)

    def _kind(self, topic: str) -> Any:
        """Returns the class of a topic's messages. Blocks."""
        try:
            published = dict(self._master.getPublishedTopics(""))
        except (*XMLRPC_ERRORS, rosgraph.MasterException) as error:
            raise Refused(f"{topic}: the ROS master does not answer: {error}") from error
        name = published.get(topic)
        if name is None:
            raise Refused(f"no node publishes {topic}")
        if name not in _KINDS:
            raise Refused(f"{topic} has {name}: expected {' or '.join(_KINDS)}")
        return _KINDS[name]

    async def _close_unread(self) -> None:
        while True:
            await asyncio.sleep(1.0)
            async with self._opening:
                for topic in [topic for topic, feed in self._feeds.items() if feed.is_unread]:
                    try:
                        await self._end(topic)
                    except SkirosError as error:
                        log.warning("the subscription of %s ends later: %s", topic, error)


class _Feed:
    """A topic. To be used in the thread of the loop, except `open` and `close`."""

    def __init__(self, topic: str, kind: Any) -> None:
        self.kind = kind
        self._topic = topic
        self._loop = asyncio.get_running_loop()
        self._latest: tuple[Any, float] | None = None  # the message, and when it was received
        self._shown: tuple[Any, float] | None = None  # that of the picture
        self._picture: tuple[str, bytes] | WrongValue | None = None
        self._next = 0.0
        self._read = monotonic()
        self._opened = 0.0
        self._encoding = asyncio.Lock()
        self._has_image = asyncio.Event()
        self._subscribing = threading.Lock()
        self._subscriber: Any = None
        self._is_first = False  # no image has come since it has subscribed

    def open(self) -> None:
        """Subscribes, or again: rospy reads no more from a driver that has sent bytes that are no message. Blocks."""
        with self._subscribing:
            if self._subscriber is not None:
                self._subscriber.unregister()
            self._opened, self._is_first = monotonic(), True
            self._subscriber = rospy.Subscriber(self._topic, self.kind, self._receive, queue_size=1, buff_size=_BUFFER)

    def close(self) -> None:
        """Ends the subscription. Blocks."""
        with self._subscribing:
            if self._subscriber is not None:
                self._subscriber.unregister()
            self._subscriber = None

    @property
    def is_due(self) -> bool:
        """Whether it is to be opened, perhaps again: no image has come for long."""
        latest = self._latest
        return self._subscriber is None or monotonic() - max(self._opened, latest[1] if latest else 0.0) > _LINGER

    @property
    def is_unread(self) -> bool:
        """Whether nobody has read a picture for long."""
        return monotonic() - self._read > _LINGER

    def _receive(self, message: Any) -> None:
        """In threads of ROS."""
        latest = self._latest
        is_first, self._is_first = self._is_first, False
        if is_first and latest is not None and message == latest[0]:
            return  # a latched image once more: it is as old as it was
        self._latest = message, monotonic()
        if latest is None:
            self._loop.call_soon_threadsafe(self._has_image.set)

    async def picture(self) -> Picture:
        """Returns the newest picture; see `Cameras.picture`."""
        self._read = monotonic()
        try:
            await asyncio.wait_for(self._has_image.wait(), _FIRST)
        except TimeoutError:
            raise Refused(f"no image has come on {self._topic} yet") from None
        async with self._encoding:
            if self._latest is not self._shown and monotonic() >= self._next:
                latest, self._next = self._latest, monotonic() + _PERIOD
                assert latest is not None
                try:
                    self._picture = secrets.token_hex(8), await asyncio.to_thread(_jpeg, latest[0])
                except WrongValue as error:
                    self._picture = error
                self._shown = latest
        assert self._picture is not None and self._shown is not None
        if isinstance(self._picture, WrongValue):
            raise Refused(f"{self._topic}: {self._picture}")
        return Picture(*self._picture, _age(*self._shown))


def _jpeg(message: Any) -> bytes:
    return jpeg_of_compressed(message.data) if isinstance(message, CompressedImage) else jpeg_of_raw(message)


def _age(message: Any, received: float) -> float:
    """Returns how old an image is (s): a driver that hangs may publish an old one again and again."""
    stamp = message.header.stamp
    age = 0.0 if stamp.is_zero() else (rospy.get_rostime() - stamp).to_sec()
    return float(max(monotonic() - received, age))


def _resolved(topic: str) -> str:
    """:raises Refused: it is no name of a topic."""
    if not rosgraph.names.is_legal_name(topic) or topic.startswith("~"):
        raise Refused(f"{topic[:100]!r} is no name of a topic")
    return str(rospy.resolve_name(topic))
