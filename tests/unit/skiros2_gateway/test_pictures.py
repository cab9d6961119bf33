"""Pictures of cameras: made of images in all encodings, and judged by Qt's decoders."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from PyQt5.QtCore import QByteArray
from PyQt5.QtGui import QImage

from skiros2_common.core.errors import UnknownName, WrongValue
from skiros2_gateway.core.pictures import MAX_PIXELS, camera_topic, jpeg_of_compressed, jpeg_of_raw
from support.pictures import BLUE, GREEN, RED, compressed, quarters


def image(pixels: Any, encoding: str, kind: str = "u1", padding: int = 0, big: bool = False) -> Any:
    """An image as drivers publish it, with bytes beyond each row."""
    array = np.asarray(pixels).astype(np.dtype(kind).newbyteorder(">" if big else "<"))
    rows = array.reshape(array.shape[0], -1).view("u1")
    padded = np.hstack([rows, np.full((len(rows), padding), 255, "u1")])
    return SimpleNamespace(
        height=array.shape[0], width=array.shape[1], step=padded.shape[1], encoding=encoding, is_bigendian=int(big),
        data=padded.tobytes(),
    )  # fmt: skip


def decoded(jpeg: bytes) -> QImage:
    assert jpeg[:3] == b"\xff\xd8\xff"
    found = QImage.fromData(QByteArray(jpeg))
    assert not found.isNull()
    return found


def colour(picture: QImage, x: float, y: float) -> tuple[int, int, int]:
    """The colour at a place, as shares of width and height."""
    found = picture.pixelColor(int(x * picture.width()), int(y * picture.height()))
    return found.red(), found.green(), found.blue()


def is_near(one: tuple[int, ...], other: tuple[int, ...]) -> bool:
    return all(abs(a - b) < 25 for a, b in zip(one, other, strict=True))


@pytest.mark.parametrize(
    ("encoding", "order"),
    [
        ("rgb8", (0, 1, 2)), ("bgr8", (2, 1, 0)), ("8UC3", (2, 1, 0)), ("rgba8", (0, 1, 2, -1)),
        ("bgra8", (2, 1, 0, -1)), ("8UC4", (2, 1, 0, -1)),
    ],
)  # fmt: skip
def test_colours_are_those_of_the_image(encoding: str, order: tuple[int, ...]) -> None:
    picture = decoded(jpeg_of_raw(image(quarters(order), encoding, padding=5)))
    assert (picture.width(), picture.height()) == (64, 48)
    expected = {(0.25, 0.25): RED, (0.75, 0.25): GREEN, (0.25, 0.75): BLUE, (0.75, 0.75): (255, 255, 255)}
    for place, its_colour in expected.items():
        assert is_near(colour(picture, *place), its_colour)


@pytest.mark.parametrize(("encoding", "filter_"), [
    ("bayer_rggb8", "RGGB"), ("bayer_bggr8", "BGGR"), ("bayer_gbrg8", "GBRG"), ("bayer_grbg8", "GRBG"),
])  # fmt: skip
def test_colour_filters_are_applied(encoding: str, filter_: str) -> None:
    square = np.array([RED["RGB".index(each)] for each in filter_]).reshape(2, 2)
    picture = decoded(jpeg_of_raw(image(np.tile(square, (16, 16)), encoding)))
    assert is_near(colour(picture, 0.5, 0.5), RED)


@pytest.mark.parametrize(("encoding", "kind", "scale"), [("mono8", "u1", 1), ("8UC1", "u1", 1), ("mono16", "u2", 257)])
@pytest.mark.parametrize("big", [False, True])
def test_grey_images_keep_their_brightness(encoding: str, kind: str, scale: int, big: bool) -> None:
    pixels = np.full((20, 30), 180) * scale
    assert is_near(colour(decoded(jpeg_of_raw(image(pixels, encoding, kind, big=big))), 0.5, 0.5), (180, 180, 180))


@pytest.mark.parametrize(("encoding", "kind", "unit"), [("32FC1", "f4", 1.0), ("16UC1", "u2", 1000.0)])
def test_distances_are_bright_where_they_are_short_and_black_where_unknown(
    encoding: str, kind: str, unit: float
) -> None:
    depth = np.repeat([[0.5, 2.0, 0.0]], 30, axis=0).repeat(20, axis=1) * unit
    if kind == "f4":
        depth[:10, 40:], depth[10:20, 40:], depth[20:, 40:] = np.nan, np.inf, -1e38
    picture = decoded(jpeg_of_raw(image(depth, encoding, kind)))
    near, far, unknown = (colour(picture, x, 0.5)[0] for x in (1 / 6, 3 / 6, 5 / 6))
    assert near > 230
    assert 20 < far < 60
    assert unknown < 10


@pytest.mark.parametrize("depth", [np.full((4, 4), np.nan), np.full((4, 4), 2.0), np.array([[1e38, 3e38, 1e-45]])])
def test_strange_distances_make_a_picture(depth: Any) -> None:
    decoded(jpeg_of_raw(image(depth, "32FC1", "f4")))


@pytest.mark.parametrize("kind", ["PNG", "JPG"])
def test_compressed_images_are_made_anew(kind: str) -> None:
    data = compressed(kind, quarters((0, 1, 2)))
    picture = jpeg_of_compressed(data + b"<script>alert(1)</script>")
    assert b"script" not in picture
    assert is_near(colour(decoded(picture), 0.25, 0.75), BLUE)


def test_large_images_become_smaller_pictures() -> None:
    picture = decoded(jpeg_of_raw(image(np.zeros((3000, 4000)), "mono8")))
    assert (picture.width(), picture.height()) == (960, 720)


def broken(**fields: Any) -> Any:
    good = image(np.zeros((4, 6)), "mono8")
    return SimpleNamespace(**{**vars(good), **fields})


@pytest.mark.parametrize("fields", [
    {"encoding": "yuv444"}, {"encoding": "x" * 10_000}, {"width": 0}, {"height": 0}, {"width": 7}, {"step": 5},
    {"step": 2**32 - 1}, {"data": b""}, {"data": bytes(23)}, {"data": bytes(25)}, {"encoding": "rgb8"},
    {"width": 2**32 - 1, "height": 2**32 - 1, "step": 2**32 - 1}, {"width": MAX_PIXELS, "height": 2},
    {"width": 1, "height": 1, "step": 200_000_000, "data": bytes(200_000_000)},
    {"encoding": "bayer_rggb8", "width": 24, "height": 1, "step": 24},
])  # fmt: skip
def test_raw_image_that_cannot_be_shown_is_refused_with_the_reason(fields: dict[str, Any]) -> None:
    with pytest.raises(WrongValue, match="expected") as error:
        jpeg_of_raw(broken(**fields))
    assert len(str(error.value)) < 400


def _png_head(width: int, height: int) -> bytes:
    """A PNG that claims a size."""
    import struct
    import zlib

    def chunk(name: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))

    head = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(b"")) + chunk(b"IEND", b"")


@pytest.mark.parametrize("data", [
    b"", b"GIF89a" + bytes(100), b"\xff\xd8\xff", compressed("JPG", quarters((0, 1, 2)))[:200],
    compressed("PNG", quarters((0, 1, 2)))[:-40], _png_head(100_000, 100_000), _png_head(8_000, 8_000), bytes(10**6),
    b"<svg xmlns='http://www.w3.org/2000/svg'/>", b"%!PS-Adobe-3.0 EPSF-3.0\n",
])  # fmt: skip
def test_compressed_image_that_cannot_be_shown_is_refused_with_the_reason(data: bytes) -> None:
    with pytest.raises(WrongValue, match="expected"):
        jpeg_of_compressed(data)


def test_camera_has_its_colours_before_its_distances() -> None:
    properties = {"skiros:DepthTopic": ["/d"], "skiros:RgbTopic": ["/c"]}
    assert camera_topic({"properties": properties}) == "/c"
    assert camera_topic({"properties": {**properties, "skiros:RgbTopic": [""]}}) == "/d"
    for element in ({}, {"properties": {"skiros:RgbTopic": []}}):
        with pytest.raises(UnknownName):
            camera_topic(element)
