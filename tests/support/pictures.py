"""Images of cameras for tests, and a stand-in for cameras."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
from PyQt5.QtCore import QBuffer, QIODevice
from PyQt5.QtGui import QImage

from skiros2_common.core.errors import Refused
from skiros2_gateway.core.pictures import Picture, jpeg_of_raw

#: The topic with pictures.
SEEN = "/camera_1/image"

RED, GREEN, BLUE = (230, 20, 20), (20, 200, 20), (20, 20, 220)


def shelf() -> SimpleNamespace:
    """An image of a shelf with two products, as a driver publishes it."""
    pixels = np.full((480, 640, 3), (214, 211, 205), np.uint8)
    pixels[300:330], pixels[150:162] = (120, 92, 64), (120, 92, 64)
    pixels[210:300, 150:250], pixels[200:300, 390:470] = (38, 108, 178), (196, 88, 40)
    return SimpleNamespace(
        width=640, height=480, step=1920, encoding="rgb8", is_bigendian=0, data=pixels.tobytes()
    )  # fmt: skip


def quarters(order: tuple[int, ...]) -> Any:
    """Red, green, blue and white quarters with channels in an order; -1 is opacity."""
    picture = np.zeros((48, 64, 3), "u1")
    picture[:24, :32], picture[:24, 32:], picture[24:, :32], picture[24:, 32:] = RED, GREEN, BLUE, (255, 255, 255)
    return np.stack([picture[:, :, each] if each >= 0 else np.full((48, 64), 7, "u1") for each in order], axis=-1)


def compressed(kind: str, picture: Any) -> bytes:
    """A picture (rgb) as a file of Qt."""
    data = np.ascontiguousarray(picture)
    qt = QImage(data.tobytes(), data.shape[1], data.shape[0], 3 * data.shape[1], QImage.Format_RGB888)
    buffer = QBuffer()
    buffer.open(QIODevice.WriteOnly)
    assert qt.save(buffer, kind)
    return bytes(buffer.data())


class StandInCameras:
    """Implements `Cameras`: one with a picture that stays; notes what was read."""

    def __init__(self) -> None:
        self.read: list[str] = []
        self.age = 0.1
        self._jpeg = jpeg_of_raw(shelf())

    async def picture(self, topic: str) -> Picture:
        self.read.append(topic)
        if topic != SEEN:
            raise Refused(f"no node publishes {topic}")
        return Picture("1", self._jpeg, self.age)
