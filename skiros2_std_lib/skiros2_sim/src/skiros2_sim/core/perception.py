"""What a perception skill would make of a camera: the objects in view, and where they are.

Recognition is ideal: a pixel tells which element it shows, as a recogniser without mistakes would. What is not ideal is
what is seen: an object that is hidden, too far or out of the picture is not found, and where it is comes from the depth
of its pixels and its known size alone (`box_fit`). So an orientation is known up to the turns in which the object's box
looks the same, and one that is partly hidden is placed by the part in view. What has a model is taken for a box of its
size around the model's root.

By option positions are the true ones with noise, which needs no picture. Whoever calls here is the thread that steps
the world.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from enum import Enum

import numpy as np
import numpy.typing as npt

from skiros2_sim.core.box_fit import area_of, convex_hull, corners_of, fit_box, least_turned
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
    rotated,
)

Points = npt.NDArray[np.float64]

#: With fewer pixels an object is not found: their points say too little about where it is.
LEAST_PIXELS = 40
#: Nor with a smaller part of it in view.
LEAST_IN_VIEW = 0.15
#: The rays that tell how much of an object is in view end so far from its middle (parts of its half edges).
_RAYS = np.vstack((np.zeros((1, 3)), 0.9 * corners_of((2.0, 2.0, 2.0)), 0.9 * np.eye(3), -0.9 * np.eye(3)))


class Source(Enum):
    """What poses are made from."""

    CAMERA = "camera"
    TRUTH = "truth"


@dataclass(frozen=True)
class Noise:
    """Standard deviations of the errors that are added.

    :param depth: of each pixel's depth (m); from the camera.
    :param position: along each axis (m); with the truth.
    :param angle: about each axis (rad); with the truth.
    """

    depth: float = 0.0
    position: float = 0.0
    angle: float = 0.0


EXACT = Noise()


@dataclass(frozen=True)
class Detection:
    """An object that was found.

    :param id: of the element that it was recognised as.
    :param pose: of its middle in the map.
    :param confidence: the part of it that is in view, 0 to 1.
    """

    id: str
    type: str
    label: str
    pose: Pose
    confidence: float


def movable(body: BodySpec) -> bool:
    """What is looked for when nothing is asked for: things that can be carried."""
    return body.movable


def detect(
    world: World,
    camera: str,
    wanted: Callable[[BodySpec], bool] = movable,
    source: Source = Source.CAMERA,
    noise: Noise = EXACT,
) -> list[Detection]:
    """What a camera sees now, ordered by id.

    :param camera: the id of its element.
    :param wanted: which objects to report. One whose size is not known is never found.
    :raises UnknownName: the scene has no such camera.
    """
    if source is Source.CAMERA:
        return detections(picture_of(world, camera), world, wanted, noise)
    lens = lens_of(world, camera)
    found = _true(world, world.pose_of(camera), lens, wanted)
    return [_blurred(detection, noise, world.random) for detection in found]


def detections(
    picture: Picture, world: World, wanted: Callable[[BodySpec], bool] = movable, noise: Noise = EXACT
) -> list[Detection]:
    """The objects that a picture shows, ordered by id."""
    found = []
    for body, size in _bodies(world, wanted, picture.ids):
        points = picture.points(picture.pixels_of(body.id))
        if len(points) < LEAST_PIXELS:
            continue
        if noise.depth:
            # a wrong depth moves a point along its ray
            points *= 1 + world.random.normal(0.0, noise.depth, (len(points), 1)) / points[:, 2:]
        pose = fit_box(_in(picture.pose, points), size).pose
        in_view = _part_in_view(len(points), pose, size, picture)
        if in_view >= LEAST_IN_VIEW:
            found.append(Detection(body.id, body.type, body.label, pose, in_view))
    return found


def _bodies(
    world: World, wanted: Callable[[BodySpec], bool], ids: tuple[str, ...] | None = None
) -> Iterator[tuple[BodySpec, Vector]]:
    """The things that are wanted, with their sizes, ordered by id.

    :param ids: only of these; None: of all.
    """
    for eid in sorted(world.bodies if ids is None else ids):
        body = world.bodies.get(eid)
        if body is not None and body.spec.size is not None and wanted(body.spec):
            yield body.spec, body.spec.size


def _part_in_view(pixels: int, pose: Pose, size: Vector, picture: Picture) -> float:
    """How many of the pixels that the object would fill, were nothing before it, and the picture large enough."""
    corners = _in(composed(inverted(picture.pose), pose), corners_of(size))
    if corners[:, 2].min() < NEAR:
        return 0.0  # it reaches into the lens
    outline = convex_hull(picture.lens.focal_length * corners[:, :2] / corners[:, 2:])
    return min(1.0, pixels / max(area_of(outline), 1.0))


def _true(world: World, camera: Pose, lens: Lens, wanted: Callable[[BodySpec], bool]) -> Iterator[Detection]:
    """The objects in view by rays from the eye: to the middle, to the corners and to the sides of each."""
    for body, size in _bodies(world, wanted):
        pose = world.pose_of(body.id)
        targets = _in(pose, _RAYS * np.asarray(size) / 2)
        seen = _in(inverted(camera), targets)
        ahead = seen[:, 2] > NEAR
        limits = np.array((lens.width, lens.height)) / 2 / lens.focal_length
        in_picture = ahead & (np.abs(seen[:, :2]) <= limits * seen[:, 2:]).all(axis=1)
        if not in_picture.any():
            continue
        rays = targets[in_picture].tolist()
        hits = world.bullet.rayTestBatch([camera.position] * len(rays), rays)
        in_view = sum(world.element_of(hit[0]) == body.id for hit in hits if hit[0] >= 0) / len(targets)
        if in_view >= LEAST_IN_VIEW:
            pose = Pose(pose.position, least_turned(pose.orientation, size))
            yield Detection(body.id, body.type, body.label, pose, in_view)


def _blurred(detection: Detection, noise: Noise, random: np.random.Generator) -> Detection:
    shift, turn = random.normal(0.0, noise.position, 3), random.normal(0.0, noise.angle, 3)
    x, y, z = (float(c + d) for c, d in zip(detection.pose.position, shift, strict=True))
    orientation = normalized(multiplied(from_euler(*(float(t) for t in turn)), detection.pose.orientation))
    return Detection(detection.id, detection.type, detection.label, Pose((x, y, z), orientation), detection.confidence)


def _in(frame: Pose, points: Points) -> Points:
    """Points that are given in a frame (n x 3), in the one that the frame's pose is given in."""
    columns = [rotated(frame.orientation, axis) for axis in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))]
    return np.asarray(points @ np.asarray(columns) + np.asarray(frame.position))
