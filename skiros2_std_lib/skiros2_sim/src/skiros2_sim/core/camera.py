"""Pictures of the simulated world: colours, depth, and which element each pixel shows.

They are drawn by PyBullet's TinyRenderer, on the processor alone. Whoever calls here is the thread that steps the
world.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
from PIL import Image

from skiros2_common.core.errors import UnknownName, WrongValue
from skiros2_sim.core.box_fit import quaternion_of
from skiros2_sim.core.world import World
from skiros2_std_reasoners.core.geometry import IDENTITY, Pose, composed, rotated

#: The planes between which things are drawn (m from the eye).
NEAR = 0.02
FAR = 20.0
#: More pixels than that along an edge would hold up the world for seconds.
MOST_PIXELS = 2048
#: Where the light comes from; nearer, its shadows have an edge in the picture (m).
_LIGHT, _LIGHT_DISTANCE = (1.0, 1.0, 2.0), 20.0
#: No element, in `Picture.segments`.
NOTHING = -1


@dataclass(frozen=True)
class Lens:
    """A pinhole camera without distortion: its pixels are square, its axis goes through the middle of the picture.

    :param width: pixels.
    :param height: pixels.
    :param field_of_view: the angle between the upper and the lower edge of the picture (rad).
    :raises WrongValue: a picture of no or of too many pixels, an angle that no lens has.
    """

    width: int = 320
    height: int = 240
    field_of_view: float = math.pi / 3

    def __post_init__(self) -> None:
        if not (0 < self.width <= MOST_PIXELS and 0 < self.height <= MOST_PIXELS):
            raise WrongValue(
                f"a picture of {self.width} x {self.height} pixels: expected 1 to {MOST_PIXELS} along each edge"
            )
        if not 0.01 <= self.field_of_view <= 3.0:
            raise WrongValue(f"a field of view of {self.field_of_view:g} rad: expected 0.01 to 3")

    @property
    def focal_length(self) -> float:
        """The distance of the picture from the eye (pixels)."""
        return self.height / 2 / math.tan(self.field_of_view / 2)

    @property
    def matrix(self) -> tuple[float, ...]:
        """K, which leads from a point in the optical frame to its pixel: 9 numbers, row by row (pixels).

        TinyRenderer takes what a pixel shows at its lower left corner: hence the offsets (measured: with them the
        points of a box lie on its surface, by less than 0.1 mm).
        """
        f = self.focal_length
        return f, 0.0, self.width / 2, 0.0, f, self.height / 2 - 1, 0.0, 0.0, 1.0


@dataclass(frozen=True, eq=False)
class Picture:
    """What a camera saw at one moment.

    :param rgb: height x width x 3, 0 to 255.
    :param depth: height x width: the distance along the camera's axis (m); NaN where there is nothing.
    :param segments: height x width: the index in `ids` of the element that the pixel shows, or `NOTHING`.
    :param ids: of the elements in view.
    :param pose: of the optical frame (x to the right, y down, z forward) in the map.
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
        """Height x width: where the element is seen."""
        if element not in self.ids:
            return np.zeros(self.segments.shape, bool)
        return np.asarray(self.segments == self.ids.index(element))

    def points(self, pixels: npt.NDArray[np.bool_]) -> npt.NDArray[np.float64]:
        """The points that these pixels show: n x 3, in the optical frame (m)."""
        rows, columns = np.nonzero(pixels & np.isfinite(self.depth))
        f, _, cx, _, _, cy, *_ = self.lens.matrix
        z = self.depth[rows, columns].astype(float)
        return np.stack(((columns - cx) / f * z, (rows - cy) / f * z, z), axis=1)


def picture_of(world: World, camera: str) -> Picture:
    """What a camera of the scene sees now.

    :param camera: the id of its element.
    :raises UnknownName: the scene has no such camera.
    """
    lens = lens_of(world, camera)
    return picture_from(world, world.pose_of(camera), lens)


def lens_of(world: World, camera: str) -> Lens:
    """The lens of a camera of the scene.

    :raises UnknownName: the scene has no such camera.
    :raises WrongValue: its spec is none of a lens.
    """
    spec = world.cameras.get(camera)
    if spec is None:
        raise UnknownName(
            f"there is no camera {camera!r}: expected one of {', '.join(sorted(world.cameras)) or 'none'}"
        )
    return Lens(spec.width, spec.height, spec.field_of_view)


def picture_from(world: World, pose: Pose, lens: Lens, shadow: bool = False) -> Picture:
    """What a camera would see from anywhere.

    :param pose: of the optical frame in the map.
    :param shadow: whether things throw one: nicer to look at, and three times as long to draw.
    """
    eye = pose.position
    bullet = world.bullet
    ahead = composed(pose, Pose((0.0, 0.0, 1.0), IDENTITY.orientation)).position
    up = rotated(pose.orientation, (0.0, -1.0, 0.0))
    _, _, rgba, buffer, mask = bullet.getCameraImage(
        lens.width,
        lens.height,
        viewMatrix=bullet.computeViewMatrix(eye, ahead, up),
        projectionMatrix=bullet.computeProjectionMatrixFOV(
            math.degrees(lens.field_of_view), lens.width / lens.height, NEAR, FAR
        ),
        shadow=int(shadow),
        lightDirection=_LIGHT,
        lightDistance=_LIGHT_DISTANCE,
        renderer=bullet.ER_TINY_RENDERER,
    )
    shape = lens.height, lens.width
    nearness = np.asarray(buffer, np.float32).reshape(shape)
    # the depth buffer of OpenGL: 0 at the near plane, 1 at the far one
    depth = np.asarray(FAR * NEAR / (FAR - (FAR - NEAR) * nearness), np.float32)
    bodies = np.asarray(mask, np.int32).reshape(shape)
    depth[bodies < 0] = np.nan
    segments, ids = _segments(bodies, world)
    rgb = np.ascontiguousarray(np.asarray(rgba, np.uint8).reshape(*shape, 4)[:, :, :3])
    return Picture(rgb, depth, segments, ids, lens, pose, world.time)


def looking_at(eye: Sequence[float], target: Sequence[float]) -> Pose:
    """The pose of an optical frame at `eye` whose axis goes through `target` (m, in the map), upright.

    :raises WrongValue: a number that is none, or the same point twice.
    """
    forward = np.asarray(target, float) - np.asarray(eye, float)
    length = float(np.linalg.norm(forward))
    if not (np.isfinite(forward).all() and 1e-6 < length < 1e6):
        raise WrongValue(f"a picture from {tuple(eye)} towards {tuple(target)}: expected two points apart")
    z = forward / length
    right = np.cross(z, (0.0, 0.0, 1.0))
    # straight up or down there is no upright: the picture's right is the map's x
    x = right / np.linalg.norm(right) if np.linalg.norm(right) > 1e-6 else np.array((1.0, 0.0, 0.0))
    position = (float(eye[0]), float(eye[1]), float(eye[2]))
    return Pose(position, quaternion_of(np.stack((x, np.cross(z, x), z), axis=1)))


def _segments(bodies: npt.NDArray[np.int32], world: World) -> tuple[npt.NDArray[np.int32], tuple[str, ...]]:
    """The indices of elements instead of the numbers of PyBullet's bodies, and the elements' ids."""
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
    """Writes the colours of a picture. A folder that is not there yet is made.

    :raises OSError: the file cannot be written.
    """
    file.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(picture.rgb).save(file, format="PNG")
