"""Objects of the world model as perception needs them, and the properties that it writes.

| property | meaning |
|---|---|
| `skiros:PoseCovariance` | covariance of the pose, JSON, 36 numbers; axes of the frame of the pose |
| `skiros:EstimateFitness`, `skiros:EstimateResidual` | quality of the registration |
| `skiros:EstimateViews`, `skiros:EstimateStamp` | number of fused views, time of the last one |
| `skiros:Confidence`, `skiros:Missing` | whether it is still there, see `confidence` |
| `skiros:MeanColour` | mean colour, JSON, red, green, blue, 0 to 255 |
"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from skiros2_common.core.errors import Refused, WrongValue
from skiros2_common.core.world_element import Element
from skiros2_common.core.world_model_port import WorldModelPort
from skiros2_motion.core.bore import Bore
from skiros2_motion.core.geometry import IDENTITY, Pose, composed, inverted
from skiros2_perception.core.confidence import MISSING_BELOW
from skiros2_perception.core.fusion import Estimate, covariance_from, covariance_text, in_frame
from skiros2_perception.core.mesh import mesh_shape
from skiros2_perception.core.shape import Shape, box_shape
from skiros2_perception.core.transforms import Array, inverse
from skiros2_perception.core.view import Sensor
from skiros2_std_reasoners.core import spatial_data as space
from skiros2_std_reasoners.core.scene_poses import has_size, parent_of, pose_in_scene, size_of

COVARIANCE, FITNESS, RESIDUAL = "skiros:PoseCovariance", "skiros:EstimateFitness", "skiros:EstimateResidual"
VIEWS, STAMP = "skiros:EstimateViews", "skiros:EstimateStamp"
CONFIDENCE, MISSING, COLOUR = "skiros:Confidence", "skiros:Missing", "skiros:MeanColour"
#: Of a depth camera: see `Sensor`.
SENSOR = {
    "noise": "skiros:DepthNoise",
    "position": "skiros:CameraPositionError",
    "angle": "skiros:CameraAngleError",
    "nearest": "skiros:MinRange",
    "farthest": "skiros:MaxRange",
}

_BORE, _MODEL = "skiros:Bore", "skiros:CadModel"
#: Maximum difference of the sizes of a model and of its element, relative.
_SAME_SIZE = 0.1
#: Standard deviations of a pose in the world model without covariance: position (m), orientation (rad).
_POSITION, _ANGLE = 0.03, math.radians(10.0)


@dataclass(frozen=True, eq=False)
class KnownObject:
    """An object of the world model.

    :param frame: name of the frame of the scene.
    :param pose: in that frame.
    :param covariance: of the error of the pose (6 x 6), along the axes of that frame.
    :param confidence: 0 to 1.
    :param colour: mean red, green, blue, 0 to 255; None if unknown.
    :param exact: whether `shape` is the shape of the object; False for an object with a model, of which only the
        bounding box is known.
    """

    id: str
    type: str
    label: str
    frame: str
    shape: Shape
    pose: Pose
    covariance: Array
    confidence: float = 1.0
    colour: Array | None = None
    exact: bool = True


def sensor_of(camera: Element) -> Sensor:
    """Returns the errors of a camera: its properties, defaults for missing ones.

    :raises WrongValue: a property is unusable; the text lists all problems.
    """
    given = dict(zip(SENSOR, space.numbers(camera, list(SENSOR.values())), strict=True))
    try:
        return Sensor(**{name: value for name, value in given.items() if value is not None})
    except WrongValue as error:
        raise WrongValue(f"{camera.label!r}: {error}") from None


def model_of(element: Element) -> str:
    """Returns the name of the model of an object; "" without one."""
    return space.text(element, _MODEL).strip()


def model_shape(element: Element, file: Path) -> Shape:
    """Returns the shape of the model of an object.

    :param file: of the model.
    :raises WrongValue: it is unusable, or has another size than the element.
    """
    try:
        shape = mesh_shape(file)
    except WrongValue as error:
        raise WrongValue(f"shape of {element.label or element.id!r}: {error}") from None
    given = size_of(element) if has_size(element) else shape.size
    if any(abs(a - b) > _SAME_SIZE * b for a, b in zip(shape.size, given, strict=True)):
        measured, expected = (" x ".join(f"{edge:g}" for edge in size) for size in (shape.size, given))
        raise WrongValue(f"shape of {element.label or element.id!r}: {file} is {measured} m: expected {expected} m")
    return shape


def shape_of(wmi: WorldModelPort, element: Element) -> Shape:
    """Returns the shape of an object without a model: a box of its size, with its bores (parts of the class
    `skiros:Bore`).

    :raises WrongValue: size or bores are unusable; the text lists all problems.
    """
    parts = [wmi.get_element(relation["dst"]) for relation in element.getRelations("-1", "skiros:hasA")]
    keys = ("skiros:PositionX", "skiros:PositionY", "skiros:Diameter", "skiros:Depth", "skiros:Chamfer")
    bores = []
    for part in parts:
        if wmi.is_subclass(part.type, _BORE):
            x, y, diameter, depth, chamfer = (math.nan if v is None else v for v in space.numbers(part, keys))
            bores.append(Bore(x, y, diameter, depth, 0.0 if math.isnan(chamfer) else chamfer))
    try:
        return box_shape(size_of(element), bores)
    except WrongValue as error:
        raise WrongValue(f"shape of {element.label or element.id!r}: {error}") from None


def known_object(wmi: WorldModelPort, element: Element, model: Path | None = None) -> KnownObject:
    """Returns an object of the world model.

    :param model: file of its model; without it, only the bounding box of an object with a model is known.
    :raises WrongValue: it lacks a usable size or pose, or has an unusable estimate; the text lists all problems.
    """
    problems = []
    shape, frame, pose, covariance = None, "", IDENTITY, np.empty(0)
    try:
        shape = shape_of(wmi, element) if model is None else model_shape(element, model)
    except WrongValue as error:
        problems.append(str(error))
    try:
        frame, pose = pose_in_scene(wmi, element)
        covariance = _covariance(wmi, element)
    except WrongValue as error:
        problems.append(str(error))
    if shape is None or problems:
        raise WrongValue("; ".join(problems))
    confidence = space.numbers(element, [CONFIDENCE])[0]
    is_usable = confidence is not None and 0.0 <= confidence <= 1.0
    return KnownObject(
        element.id,
        element.type,
        element.label,
        frame,
        shape,
        pose,
        covariance,
        confidence if is_usable and confidence is not None else 1.0,
        _colour(element),
        model is not None or not model_of(element),
    )


def stored_estimate(wmi: WorldModelPort, element: Element) -> Estimate | None:
    """Returns the estimate of an object in the world model, in the frame of the scene; None without one.

    :raises WrongValue: it is unusable.
    """
    if not space.text(element, COVARIANCE):
        return None
    pose = pose_in_scene(wmi, element)[1]
    fitness, residual, views, stamp = space.numbers(element, [FITNESS, RESIDUAL, VIEWS, STAMP])
    information = inverse(_covariance(wmi, element))
    return Estimate(pose, information, fitness or 0.0, residual or 0.0, max(1, int(views or 1)), stamp or 0.0)


def check_movable(wmi: WorldModelPort, element: Element) -> None:
    """Checks that perception may write the pose of an object.

    :raises Refused: the pose follows a tf frame.
    """
    name, frame = element.label or element.id, space.text(element, space.LINKED_TO)
    if frame:
        raise Refused(f"the pose of {name!r} follows the tf frame {frame!r}: expected an object that follows none")


def put_estimate(wmi: WorldModelPort, element: Element, estimate: Estimate) -> None:
    """Sets the pose of an element, and the properties of the estimate. The world model is not changed.

    :param element: a copy of its current state.
    :param estimate: in the frame of the scene.
    """
    local = in_frame(estimate, inverted(_parent_pose(wmi, element)))
    space.set_pose(element, local.pose)
    space.set_text(element, COVARIANCE, covariance_text(local.covariance))
    space.set_numbers(element, [FITNESS, RESIDUAL], [estimate.fitness, estimate.residual])
    element.setProperty(VIEWS, estimate.views, "xsd:int")
    element.setProperty(STAMP, float(estimate.stamp), "xsd:double")


def put_confidence(element: Element, confidence: float) -> None:
    """Sets the confidence of an element, and marks it as missing if the confidence is low."""
    space.set_numbers(element, [CONFIDENCE], [confidence])
    element.setProperty(MISSING, confidence < MISSING_BELOW, "xsd:boolean")


def write_estimate(wmi: WorldModelPort, eid: str, estimate: Estimate, confidence: float) -> None:
    """Writes an estimate to the world model, in one change.

    :param eid: id of the object.
    :param estimate: in the frame of the scene.
    :param confidence: 0 to 1.
    :raises Refused: the pose of the object follows a tf frame.
    :raises SkirosError: the world model refuses the change.
    """
    element = wmi.get_element(eid)
    check_movable(wmi, element)
    put_estimate(wmi, element, estimate)
    put_confidence(element, confidence)
    wmi.update_element_properties(element)


def put_colour(element: Element, colour: Array | None) -> None:
    """Sets the mean colour of an element, if it is known."""
    if colour is not None:
        space.set_text(element, COLOUR, json.dumps([round(float(part)) for part in colour]))


def _colour(element: Element) -> Array | None:
    try:
        colour = np.array(json.loads(space.text(element, COLOUR)), float)
    except (ValueError, TypeError):
        return None
    return colour if colour.shape == (3,) and np.isfinite(colour).all() else None


def _parent_pose(wmi: WorldModelPort, element: Element) -> Pose:
    """Returns the pose of the frame of an element's pose in the frame of the scene."""
    own = space.pose_of(element)
    if own is None:
        parent = parent_of(wmi, element)
        return pose_in_scene(wmi, parent)[1] if parent is not None else IDENTITY
    return composed(pose_in_scene(wmi, element)[1], inverted(own))


def _covariance(wmi: WorldModelPort, element: Element) -> Array:
    """Returns the covariance along the axes of the scene; a default without one."""
    text = space.text(element, COVARIANCE)
    if not text:
        return np.diag((_POSITION**2,) * 3 + (_ANGLE**2,) * 3)
    local = Estimate(IDENTITY, inverse(covariance_from(text)), 0.0, 0.0, 1, 0.0)
    return inverse(in_frame(local, _parent_pose(wmi, element)).information)
