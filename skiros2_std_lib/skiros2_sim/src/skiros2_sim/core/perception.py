"""Simulated perception: the visible objects and their poses.

Recognition is ideal: each pixel has the id of its element. Localisation is realistic: hidden, distant or cropped
objects are not found, and the pose is estimated from the depth of the visible pixels and the known size (`fit_box`). So
the orientation is unique up to symmetries of the box, and a partly hidden object is located by its visible part. An
object with a model is treated as a box of its size around the root of the model.

`fit_box` minimises the sum of squared distances of the points from the surface over position and orientation with the
method of Levenberg and Marquardt (D. Marquardt, "An algorithm for least-squares estimation of nonlinear parameters",
1963), from several starts: the box upright on each of its sides, aligned with the minimum-area rectangle around the
points. SciPy's `least_squares` takes three times as long (90 instead of 30 ms for six starts), and holds up the
simulation meanwhile.

Optionally, poses are the true ones with noise, without rendering. Call in the stepping thread.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from enum import Enum
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.spatial import ConvexHull, QhullError
from scipy.spatial.transform import Rotation

from skiros2_motion.core.geometry import (
    Pose,
    Quaternion,
    Vector,
    composed,
    from_euler,
    inverted,
    multiplied,
    normalized,
)
from skiros2_sim.core.camera import NEAR, Lens, Picture, lens_of, picture_of, quaternion_of
from skiros2_sim.core.scene_spec import BodySpec
from skiros2_sim.core.world import World

Points = npt.NDArray[np.float64]

#: Minimum number of pixels of a detected object.
MIN_PIXELS = 40
#: Minimum visible fraction of a detected object.
MIN_VISIBILITY = 0.15
#: End points of the visibility rays, as fractions of the half edges.
_RAYS = 0.9 * np.vstack((np.zeros((1, 3)), list(itertools.product((-1.0, 1.0), repeat=3)), np.eye(3), -np.eye(3)))


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
        hits = world.physics.first_hits(camera.position, targets[in_picture].tolist())
        in_view = sum(world.element_of(hit) == body.id for hit in hits if hit >= 0) / len(targets)
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


#: Maximum number of points; more are thinned out evenly.
MAX_POINTS = 600
STEPS = 12
#: Edges that differ by less count as equal (m).
EQUAL = 1e-3


class BoxFit(NamedTuple):
    """The result of a fit.

    :param pose: of the centre of the box, in the frame of the points.
    :param error: root mean square distance of the points from its surface (m).
    """

    pose: Pose
    error: float


def fit_box(points: Points, size: Vector) -> BoxFit:
    """Returns the best pose of a box. Of equivalent orientations of the box, returns the one with the smallest
    rotation.

    :param points: n x 3, at least 1, on the surface, in a frame with z up (m).
    :param size: edge lengths along the axes of the box (m).
    """
    points = points[:: max(1, math.ceil(len(points) / MAX_POINTS))]
    half = np.asarray(size) / 2
    fits = (_fitted(points, half, *start) for start in _starts(points, half))
    error, rotation, middle = min(fits, key=lambda fit: fit[0])
    orientation = least_turned(quaternion_of(rotation), size)
    return BoxFit(Pose((float(middle[0]), float(middle[1]), float(middle[2])), orientation), math.sqrt(error))


def least_rectangle(points: Points) -> tuple[float, Points]:
    """Returns angle (rad, 0 to pi / 2) and centre of the minimum-area rectangle around points of a plane (n x 2). One
    of its edges lies on an edge of the hull (H. Freeman and R. Shapira, 1975)."""
    try:
        hull = points[ConvexHull(points).vertices]
    except (QhullError, ValueError):  # fewer than three, or on a line
        hull = points
    edges = np.diff(np.vstack((hull, hull[:1])), axis=0)
    best = (math.inf, 0.0, hull.mean(axis=0))
    for angle in np.unique(np.arctan2(edges[:, 1], edges[:, 0]) % (math.pi / 2)):
        axes = np.array(((math.cos(angle), math.sin(angle)), (-math.sin(angle), math.cos(angle))))
        turned = hull @ axes.T
        low, high = turned.min(axis=0), turned.max(axis=0)
        area = float(np.prod(high - low))
        if area < best[0]:
            best = (area, float(angle), (low + high) / 2 @ axes)
    return best[1], best[2]


def outline_area(points: Points) -> float:
    """Returns the area of the convex hull of points of a plane (n x 2)."""
    try:
        return float(ConvexHull(points).volume)  # of two dimensions, that is the area
    except QhullError:  # on a line
        return 0.0


def corners_of(size: Vector) -> Points:
    """Returns the corners of a box around the origin: 8 x 3."""
    return np.asarray(np.array(list(itertools.product((-0.5, 0.5), repeat=3))) * np.asarray(size))


def least_turned(orientation: Quaternion, size: Vector) -> Quaternion:
    """Returns the equivalent orientation of a box with the smallest rotation."""
    return max((multiplied(orientation, same) for same in _symmetries(size)), key=lambda q: abs(q[3]))


def _symmetries(size: Vector) -> list[Quaternion]:
    """Returns the rotational symmetries of a box."""
    turns = []
    for order in itertools.permutations(range(3)):
        if all(abs(size[i] - size[order[i]]) < EQUAL for i in range(3)):
            for signs in itertools.product((-1.0, 1.0), repeat=3):
                matrix = np.eye(3)[list(order)] * signs
                if np.linalg.det(matrix) > 0:
                    turns.append(quaternion_of(matrix))
    return turns


def _starts(points: Points, half: Points) -> list[tuple[Points, Points]]:
    """Returns start rotations and centres: the box on each of its sides, below the highest points."""
    angle, (x, y) = least_rectangle(points[:, :2])
    top = float(np.percentile(points[:, 2], 98))
    starts: list[tuple[Points, Points]] = []
    seen: list[Points] = []
    for order, quarter in itertools.product(((0, 1, 2), (1, 2, 0), (2, 0, 1)), (0.0, math.pi / 2)):
        lengths = half[list(order)] if not quarter else half[[order[1], order[0], order[2]]]
        if any(np.allclose(lengths, before, atol=EQUAL) for before in seen):
            continue  # equivalent to a previous start
        seen.append(lengths)
        cos, sin = math.cos(angle + quarter), math.sin(angle + quarter)
        # the columns are the axes of the box; the last one in `order` is vertical
        rotation = np.zeros((3, 3))
        rotation[:, list(order)] = np.array(((cos, -sin, 0.0), (sin, cos, 0.0), (0.0, 0.0, 1.0)))
        starts.append((rotation, np.array((x, y, top - half[order[2]]))))
    return starts


def _fitted(points: Points, half: Points, rotation: Points, middle: Points) -> tuple[float, Points, Points]:
    """Returns the mean squared distance after the fit, rotation and centre."""
    away, normals = _distances(points, half, rotation, middle)
    error, damping = float(np.mean(away**2)), 1e-3
    for _ in range(STEPS):
        jacobian = np.hstack((-normals, -np.cross(points - middle, normals)))
        # scales rotations so that all parameters have the unit of the centre: 1 rad moves the surface by half an edge
        scale = np.array((1.0, 1.0, 1.0, *(1 / half.max(),) * 3))
        j = jacobian * scale
        step = scale * np.linalg.solve(j.T @ j + damping * len(points) * np.eye(6), -j.T @ away)
        tried = Rotation.from_rotvec(step[3:]).as_matrix() @ rotation, middle + step[:3]
        tried_away, tried_normals = _distances(points, half, *tried)
        tried_error = float(np.mean(tried_away**2))
        if tried_error < error:
            better = error - tried_error
            (rotation, middle), away, normals, error = tried, tried_away, tried_normals, tried_error
            damping = max(damping / 5, 1e-9)
            if better < 1e-12:  # a thousandth of a millimetre
                break
        else:
            damping *= 10
    return error, rotation, middle


def _distances(points: Points, half: Points, rotation: Points, middle: Points) -> tuple[Points, Points]:
    """Returns signed distances of points from the surface (n; negative inside), and outward normals (n x 3)."""
    inside = (points - middle) @ rotation
    over = np.abs(inside) - half
    beyond = np.maximum(over, 0.0)
    far = np.linalg.norm(beyond, axis=1)
    nearest = np.eye(3)[over.argmax(axis=1)]
    outside = far > 0
    away = np.where(outside, far, over.max(axis=1))
    directions = np.where(outside[:, None], beyond / np.where(outside, far, 1.0)[:, None], nearest)
    return away, (directions * np.where(inside < 0, -1.0, 1.0)) @ rotation.T
