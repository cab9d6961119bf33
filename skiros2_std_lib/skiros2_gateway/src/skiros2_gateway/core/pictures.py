"""Pictures of cameras for viewers: images of drivers as JPEG.

A picture is made from the pixels, also of an image that is a JPEG: viewers get nothing else that it contains.
"""

from __future__ import annotations

import io
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt
from PIL import Image

from skiros2_common.core.errors import UnknownName, WrongValue

#: The topics of a camera's element; the first that it has is shown.
TOPICS = ("skiros:RgbTopic", "skiros:DepthTopic", "skiros:DepthImageRaw")
#: The largest image (pixels), and its data (bytes: 4 channels).
MAX_PIXELS = 32_000_000
_MAX_BYTES = 4 * MAX_PIXELS
#: The largest picture (pixels); larger images are made smaller.
_SIZE = (960, 720)
_QUALITY = 80

#: Encodings of `sensor_msgs/Image`: the type of a channel, and which channels are red, green and blue.
_COLOURS: dict[str, tuple[str, int, tuple[int, ...]]] = {
    "rgb8": ("u1", 3, (0, 1, 2)),
    "rgba8": ("u1", 4, (0, 1, 2)),
    "bgr8": ("u1", 3, (2, 1, 0)),
    "8UC3": ("u1", 3, (2, 1, 0)),
    "bgra8": ("u1", 4, (2, 1, 0)),
    "8UC4": ("u1", 4, (2, 1, 0)),
    "mono8": ("u1", 1, (0,)),
    "8UC1": ("u1", 1, (0,)),
    "mono16": ("u2", 1, (0,)),
}
_DEPTHS = {"16UC1": "u2", "32FC1": "f4"}
#: Colour filters: where in each square of four pixels red, green and blue are.
_FILTERS = {"bayer_rggb8": (0, 1, 3), "bayer_bggr8": (3, 1, 0), "bayer_gbrg8": (2, 0, 1), "bayer_grbg8": (1, 0, 2)}
_ENCODINGS = (*_COLOURS, *_DEPTHS, *_FILTERS)


class RawImage(Protocol):
    """The fields of `sensor_msgs/Image`."""

    width: int
    height: int
    step: int
    encoding: str
    is_bigendian: int
    data: bytes


@dataclass(frozen=True)
class Picture:
    """A picture of a camera.

    :param id: differs from that of each other picture.
    :param age: s since it was taken, as far as the camera's stamps say so, or else received.
    """

    id: str
    jpeg: bytes
    age: float


class Cameras(Protocol):
    """The cameras of a cell."""

    async def picture(self, topic: str) -> Picture:
        """Returns the newest picture of a topic, five a second at most.

        :raises Refused: the topic has no images, or none that can be shown; the text says why.
        """


def camera_topic(element: Mapping[str, Any]) -> str:
    """Returns the topic with the images of a camera.

    :param element: of the live view's document.
    :raises UnknownName: it has none.
    """
    for key in TOPICS:
        for topic in element.get("properties", {}).get(key, ()):
            if topic:
                return str(topic)
    raise UnknownName(f"there is no such camera: expected an element with {', '.join(TOPICS[:2])}")


def jpeg_of_raw(image: RawImage) -> bytes:
    """Returns the picture of an uncompressed image; of distances, near ones are bright and unknown ones black.

    :raises WrongValue: encoding or size is unusable.
    """
    encoding = image.encoding
    if encoding not in _ENCODINGS:
        raise WrongValue(f"encoding {encoding[:40]!r}: expected {', '.join(_ENCODINGS)}")
    if encoding in _FILTERS:
        return _jpeg(Image.fromarray(_filtered(_all_pixels(image, "u1", 1)[:, :, 0], _FILTERS[encoding])))
    if encoding in _DEPTHS:
        return _jpeg(Image.fromarray(_brightness(_pixels(image, _DEPTHS[encoding], 1)[:, :, 0])))
    kind, channels, order = _COLOURS[encoding]
    pixels = _pixels(image, kind, channels)[:, :, list(order)]
    bytes_ = (pixels >> 8).astype(np.uint8) if kind == "u2" else np.ascontiguousarray(pixels)
    return _jpeg(Image.fromarray(bytes_ if len(order) == 3 else bytes_[:, :, 0]))


def jpeg_of_compressed(data: bytes) -> bytes:
    """Returns the picture of a JPEG or PNG.

    :raises WrongValue: it is neither, or is too large.
    """
    try:
        with Image.open(io.BytesIO(data), formats=("JPEG", "PNG")) as image:
            _check_size(*image.size)
            image.draft("RGB", _SIZE)  # a JPEG is read in the size that is needed
            if image.mode.startswith("I"):  # 16 bits
                return _jpeg(Image.fromarray(_brightness(np.asarray(image))))
            return _jpeg(image.convert("RGB"))
    except (OSError, SyntaxError, ValueError, Image.DecompressionBombError) as error:
        if isinstance(error, WrongValue):
            raise
        raise WrongValue(f"image of {len(data)} bytes: expected a JPEG or PNG: {error}") from error


def _check_size(width: int, height: int) -> None:
    if not 0 < width * height <= MAX_PIXELS:
        raise WrongValue(f"{width} x {height} pixels: expected 1 to {MAX_PIXELS}")


def _all_pixels(image: RawImage, kind: str, channels: int) -> npt.NDArray[Any]:
    """Returns height x width x channels."""
    _check_size(image.width, image.height)
    dtype = np.dtype(kind).newbyteorder(">" if image.is_bigendian else "<")
    row = image.width * channels * dtype.itemsize
    if image.step < row or len(image.data) > _MAX_BYTES or len(image.data) != image.step * image.height:
        size = f"{image.width} x {image.height} pixels of {image.encoding}"
        raise WrongValue(f"{size}: {len(image.data)} bytes in steps of {image.step}: expected at least {row} a row")
    rows = np.frombuffer(image.data, np.uint8).reshape(image.height, image.step)[:, :row]
    return np.ascontiguousarray(rows).view(dtype).reshape(image.height, image.width, channels)


def _pixels(image: RawImage, kind: str, channels: int) -> npt.NDArray[Any]:
    """Returns the same; of a large image not all."""
    return _thinned(_all_pixels(image, kind, channels))


def _thinned(pixels: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Returns every n-th pixel of a large image; there stay more than the picture has."""
    n = max(1, *(have // (2 * need) for have, need in zip(pixels.shape[1::-1], _SIZE, strict=True)))
    return pixels[::n, ::n]


def _filtered(pixels: npt.NDArray[Any], places: tuple[int, int, int]) -> npt.NDArray[np.uint8]:
    """Returns the colours of each square of four pixels."""
    height, width = pixels.shape[0] // 2 * 2, pixels.shape[1] // 2 * 2
    if not height or not width:
        raise WrongValue(f"{pixels.shape[1]} x {pixels.shape[0]} pixels: expected squares of four")
    return np.stack([_thinned(pixels[at // 2 : height : 2, at % 2 : width : 2]) for at in places], axis=-1)


def _brightness(depth: npt.NDArray[Any]) -> npt.NDArray[np.uint8]:
    """Returns distances as brightness."""
    values = depth.astype(np.float32)
    known = np.isfinite(values) & (values > 0)
    if not known.any():
        return np.zeros(values.shape, np.uint8)
    near, far = values[known].min(), values[known].max()
    share = (np.where(known, values, far) - near) / (far - near or 1.0)
    return np.where(known, 255.0 - 215.0 * share, 0.0).astype(np.uint8)


def _jpeg(image: Image.Image) -> bytes:
    image.thumbnail(_SIZE)
    out = io.BytesIO()
    image.save(out, "JPEG", quality=_QUALITY)
    return out.getvalue()
