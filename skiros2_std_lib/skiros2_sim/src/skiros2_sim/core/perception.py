"""Simulated perception: the visible objects and their poses.

Recognition is ideal: each pixel has the id of its element. Localisation is realistic: hidden, distant or cropped
objects are not found, and the pose is estimated from the depth of the visible pixels and the known size (`box_fit`). So
the orientation is unique up to symmetries of the box, and a partly hidden object is located by its visible part. An
object with a model is treated as a box of its size around the model's root.

Optionally, poses are the true ones with noise, without rendering. Call in the stepping thread.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from enum import Enum

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from skiros2_sim.core.box_fit import corners_of, fit_box, least_turned, outline_area
from skiros2_sim.core.camera import NEAR, Lens, Picture, lens_of, picture_of
from skiros2_sim.core.scene_spec import BodySpec
from skiros2_sim.core.world import World
from skiros2_std_reasoners.core.geometry import (
    Pose,
    Vector,
    composed,
    from_euler,
    inverted,
    multiplied,
    normalized,
)

Points = npt.NDArray[np.float64]

#: Minimum number of pixels of a detected object.
MIN_PIXELS = 40
#: Minimum visible fraction of a detected object.
MIN_VISIBILITY = 0.15
#: End points of the visibility rays, as fractions of the half edges.
_RAYS = np.vstack((np.zeros((1, 3)), 0.9 * corners_of((2.0, 2.0, 2.0)), 0.9 * np.eye(3), -0.9 * np.eye(3)))


class Source(Enum):
    """The source of poses."""

    CAMERA = "camera"
    TRUTH = "truth"


@dataclass(frozen=True)
class Noise:
    """Standard deviations of the added noise.

    :param depth: of the depth of each pixel (m); for `Source.CAMERA`.
    :param position: along each axis (m); for `Source.TRUTH`.
    :param angle: about each axis (rad); for `Source.TRUTH`.
    """

    depth: float = 0.0
    position: float = 0.0
    angle: float = 0.0


EXACT = Noise()


@dataclass(frozen=True)
class Detection:
    """A detected object.

    :param id: of its element.
    :param pose: of its centre in the map.
    :param confidence: visible fraction, 0 to 1.
    """

    id: str
    type: str
    label: str
    pose: Pose
    confidence: float


def movable(body: BodySpec) -> bool:
    """The default filter of `detect`: movable objects."""
    return body.movable


def detect(
    world: World,
    camera: str,
    wanted: Callable[[BodySpec], bool] = movable,
    source: Source = Source.CAMERA,
    noise: Noise = EXACT,
) -> list[Detection]:
    """Detects the objects in view of a camera, ordered by id.

    :param camera: id of its element.
    :param wanted: which objects to report. Objects of unknown size are not reported.
    :raises UnknownName: the scene has no such camera.
    """
    if source is Source.CAMERA:
        return detections(picture_of(world, camera), world, wanted, noise)
    lens = lens_of(world, camera)
    found = _visible_by_rays(world, world.pose_of(camera), lens, wanted)
    return [_with_noise(detection, noise, world.random) for detection in found]


def detections(
    picture: Picture, world: World, wanted: Callable[[BodySpec], bool] = movable, noise: Noise = EXACT
) -> list[Detection]:
    """Detects the objects in an image, ordered by id."""
    found = []
    for body, size in _bodies(world, wanted, picture.ids):
        points = picture.points(picture.pixels_of(body.id))
        if len(points) < MIN_PIXELS:
            continue
        if noise.depth:
            # a depth error moves a point along its ray
            points *= 1 + world.random.normal(0.0, noise.depth, (len(points), 1)) / points[:, 2:]
        pose = fit_box(_transformed(picture.pose, points), size).pose
        in_view = _visibility(len(points), pose, size, picture)
        if in_view >= MIN_VISIBILITY:
            found.append(Detection(body.id, body.type, body.label, pose, in_view))
    return found


def _bodies(
    world: World, wanted: Callable[[BodySpec], bool], ids: tuple[str, ...] | None = None
) -> Iterator[tuple[BodySpec, Vector]]:
    """Yields the wanted bodies with their sizes, ordered by id.

    :param ids: only these; None for all.
    """
    for eid in sorted(world.bodies if ids is None else ids):
        body = world.bodies.get(eid)
        if body is not None and body.spec.size is not None and wanted(body.spec):
            yield body.spec, body.spec.size


def _visibility(pixels: int, pose: Pose, size: Vector, picture: Picture) -> float:
    """Returns the visible fraction of an object: pixels relative to its unobstructed, uncropped outline."""
    corners = _transformed(composed(inverted(picture.pose), pose), corners_of(size))
    if corners[:, 2].min() < NEAR:
        return 0.0  # it intersects the lens
    outline = outline_area(picture.lens.focal_length * corners[:, :2] / corners[:, 2:])
    return min(1.0, pixels / max(outline, 1.0))


def _visible_by_rays(world: World, camera: Pose, lens: Lens, wanted: Callable[[BodySpec], bool]) -> Iterator[Detection]:
    """Yields the visible objects, tested by rays from the camera to the centre, corners and sides of each."""
    for body, size in _bodies(world, wanted):
        pose = world.pose_of(body.id)
        targets = _transformed(pose, _RAYS * np.asarray(size) / 2)
        seen = _transformed(inverted(camera), targets)
        ahead = seen[:, 2] > NEAR
        limits = np.array((lens.width, lens.height)) / 2 / lens.focal_length
        in_picture = ahead & (np.abs(seen[:, :2]) <= limits * seen[:, 2:]).all(axis=1)
        if not in_picture.any():
            continue
        rays = targets[in_picture].tolist()
        hits = world.bullet.rayTestBatch([camera.position] * len(rays), rays)
        in_view = sum(world.element_of(hit[0]) == body.id for hit in hits if hit[0] >= 0) / len(targets)
        if in_view >= MIN_VISIBILITY:
            pose = Pose(pose.position, least_turned(pose.orientation, size))
            yield Detection(body.id, body.type, body.label, pose, in_view)


def _with_noise(detection: Detection, noise: Noise, random: np.random.Generator) -> Detection:
    shift, turn = random.normal(0.0, noise.position, 3), random.normal(0.0, noise.angle, 3)
    x, y, z = (float(c + d) for c, d in zip(detection.pose.position, shift, strict=True))
    orientation = normalized(multiplied(from_euler(*(float(t) for t in turn)), detection.pose.orientation))
    return Detection(detection.id, detection.type, detection.label, Pose((x, y, z), orientation), detection.confidence)


def _transformed(frame: Pose, points: Points) -> Points:
    """Transforms points (n x 3) from a frame to the reference frame of its pose."""
    return np.asarray(Rotation.from_quat(frame.orientation).apply(points) + np.asarray(frame.position))
