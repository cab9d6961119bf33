"""Renders images of the simulated world: colour, depth, and the element of each pixel.

On the CPU. Call in the stepping thread.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
from PIL import Image
from scipy.spatial.transform import Rotation

from skiros2_common.core.errors import UnknownName, WrongValue
from skiros2_motion.core.geometry import Pose, Quaternion
from skiros2_sim.core.world import World

#: Near and far clipping plane (m).
NEAR = 0.02
FAR = 20.0
#: Maximum number of pixels per edge; larger images would stop the world for seconds.
MAX_PIXELS = 2048
#: Index of pixels without element in `Picture.segments`.
NOTHING = -1


@dataclass(frozen=True)
class Lens:
    """A pinhole camera without distortion, with square pixels and the principal point in the centre.

    :param width: pixels.
    :param height: pixels.
    :param field_of_view: vertical (rad).
    :raises WrongValue: width, height or field of view is out of range.
    """

    width: int = 320
    height: int = 240
    field_of_view: float = math.pi / 3

    def __post_init__(self) -> None:
        if not (0 < self.width <= MAX_PIXELS and 0 < self.height <= MAX_PIXELS):
            raise WrongValue(
                f"picture of {self.width} x {self.height} pixels: expected 1 to {MAX_PIXELS} along each edge"
            )
        if not 0.01 <= self.field_of_view <= 3.0:
            raise WrongValue(f"field of view of {self.field_of_view:g} rad: expected 0.01 to 3")

    @property
    def focal_length(self) -> float:
        """Focal length (pixels)."""
        return self.height / 2 / math.tan(self.field_of_view / 2)

    @property
    def matrix(self) -> tuple[float, ...]:
        """The camera matrix K: 9 numbers, row by row (pixels).

        TinyRenderer samples a pixel at its lower left corner, hence the offsets (measured: with them, points of a box
        are within 0.1 mm of its surface).
        """
        f = self.focal_length
        return f, 0.0, self.width / 2, 0.0, f, self.height / 2 - 1, 0.0, 0.0, 1.0


@dataclass(frozen=True, eq=False)
class Picture:
    """An image of a camera.

    :param rgb: height x width x 3, 0 to 255.
    :param depth: height x width: distance along the optical axis (m); NaN for the background.
    :param segments: height x width: index in `ids` of the element of each pixel, or `NOTHING`.
    :param ids: of the visible elements.
    :param pose: of the optical frame (x right, y down, z forward) in the map.
    :param time: of the world (s).
    """

    rgb: npt.NDArray[np.uint8]
    depth: npt.NDArray[np.float32]
    segments: npt.NDArray[np.int32]
    ids: tuple[str, ...]
    lens: Lens
    pose: Pose
    time: float

    def pixels_of(self, element: str) -> npt.NDArray[np.bool_]:
        """Returns a mask of the pixels of an element: height x width."""
        if element not in self.ids:
            return np.zeros(self.segments.shape, bool)
        return np.asarray(self.segments == self.ids.index(element))

    def points(self, pixels: npt.NDArray[np.bool_]) -> npt.NDArray[np.float64]:
        """Returns the points of pixels: n x 3, in the optical frame (m)."""
        rows, columns = np.nonzero(pixels & np.isfinite(self.depth))
        f, _, cx, _, _, cy, *_ = self.lens.matrix
        z = self.depth[rows, columns].astype(float)
        return np.stack(((columns - cx) / f * z, (rows - cy) / f * z, z), axis=1)


def picture_of(world: World, camera: str) -> Picture:
    """Renders the image of a camera of the scene.

    :param camera: id of its element.
    :raises UnknownName: the scene has no such camera.
    """
    lens = lens_of(world, camera)
    return picture_from(world, world.pose_of(camera), lens)


def with_depth_noise(picture: Picture, deviation: float, random: np.random.Generator) -> Picture:
    """Returns an image with noise of each pixel's depth.

    :param deviation: standard deviation (m).
    """
    noise = random.normal(0.0, deviation, picture.depth.shape)
    return dataclasses.replace(picture, depth=np.asarray(picture.depth + noise, np.float32))


def lens_of(world: World, camera: str) -> Lens:
    """Returns the lens of a camera of the scene.

    :raises UnknownName: the scene has no such camera.
    :raises WrongValue: its values are out of range.
    """
    spec = world.cameras.get(camera)
    if spec is None:
        raise UnknownName(
            f"there is no camera {camera!r}: expected one of {', '.join(sorted(world.cameras)) or 'none'}"
        )
    return Lens(spec.width, spec.height, spec.field_of_view)


def picture_from(world: World, pose: Pose, lens: Lens, shadow: bool = False) -> Picture:
    """Renders an image from any pose.

    :param pose: of the optical frame in the map.
    :param shadow: whether to render shadows, which triples the time.
    """
    rgb, depth, bodies = world.physics.render(pose, lens.width, lens.height, lens.field_of_view, NEAR, FAR, shadow)
    depth[bodies < 0] = np.nan
    segments, ids = _segments(bodies, world)
    return Picture(rgb, depth, segments, ids, lens, pose, world.time)


def looking_at(eye: Sequence[float], target: Sequence[float]) -> Pose:
    """Returns the pose of an upright optical frame at `eye` that looks at `target` (m, in the map).

    :raises WrongValue: a number is not finite, or the points are equal.
    """
    forward = np.asarray(target, float) - np.asarray(eye, float)
    length = float(np.linalg.norm(forward))
    if not (np.isfinite(forward).all() and 1e-6 < length < 1e6):
        raise WrongValue(f"picture from {tuple(eye)} towards {tuple(target)}: the points are equal")
    z = forward / length
    right = np.cross(z, (0.0, 0.0, 1.0))
    # vertical view: image x is the map's x
    x = right / np.linalg.norm(right) if np.linalg.norm(right) > 1e-6 else np.array((1.0, 0.0, 0.0))
    position = (float(eye[0]), float(eye[1]), float(eye[2]))
    return Pose(position, quaternion_of(np.stack((x, np.cross(z, x), z), axis=1)))


def quaternion_of(rotation: npt.NDArray[np.float64]) -> Quaternion:
    """Converts a rotation matrix to a quaternion with w >= 0."""
    x, y, z, w = Rotation.from_matrix(rotation).as_quat(canonical=True)
    return float(x), float(y), float(z), float(w)


def _segments(bodies: npt.NDArray[np.int32], world: World) -> tuple[npt.NDArray[np.int32], tuple[str, ...]]:
    """Converts the engine's bodies to indices of elements; returns these and the elements' ids."""
    seen = np.flatnonzero(np.bincount(bodies.ravel() + 1)) - 1  # a background is -1
    indices = np.full(seen[-1] + 2, NOTHING, np.int32)
    ids: list[str] = []
    for body in seen[seen >= 0]:
        element = world.element_of(int(body))
        if element is not None:
            indices[body + 1] = len(ids)
            ids.append(element)
    return indices[bodies + 1], tuple(ids)


def save_png(picture: Picture, file: Path) -> None:
    """Writes the colours of an image as a PNG. Creates missing folders.

    :raises OSError: the file cannot be written.
    """
    file.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(picture.rgb).save(file, format="PNG")
