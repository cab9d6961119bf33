"""What a simulated world is made of: plain data, read from a scene by `scene_reader`, or written by hand.

Lengths are in metres, masses in kilograms, angles in radians. Ids are those of the world model's elements.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from skiros2_std_reasoners.core.geometry import IDENTITY, Pose, Vector

Colour = tuple[float, float, float, float]


@dataclass(frozen=True)
class BodySpec:
    """A thing of the scene that has a shape.

    :param parent: id of the element that it is in, on, or a part of; "" for none.
    :param pose: of its middle in the map; with a model, of the model's root frame.
    :param size: of the box that it is without a model, or that its model fills; None: not known.
    :param model: file of its shape (URDF, OBJ or STL), as `model_files` finds it; "" for a box.
    :param movable: whether it falls and can be carried; else it is fixed in the map.
    :param mass: None: that of wood of its size.
    :param colour: red, green, blue, opacity; None: one that its number gives.
    """

    id: str
    type: str = ""
    label: str = ""
    parent: str = ""
    pose: Pose = IDENTITY
    size: Vector | None = None
    model: str = ""
    movable: bool = False
    mass: float | None = None
    colour: Colour | None = None


@dataclass(frozen=True)
class BaseSpec:
    """What a robot stands on. With a model it drives; without one the robot is fixed in the map.

    :param name: the first part of the names of its links and joints.
    :param pose: of the model's root frame in the robot's frame.
    :param size: of the box that it is without a model.
    """

    id: str
    name: str
    model: str = ""
    pose: Pose = IDENTITY
    size: Vector | None = None


@dataclass(frozen=True)
class GripperSpec:
    """A gripper, whose fingers are in the model of the arm, or in one of its own.

    :param model: "" when it is in the arm's.
    :param pose: of its model in the frame of the arm's flange.
    :param action: name of its `control_msgs/GripperCommand` action.
    """

    id: str
    name: str
    model: str = ""
    pose: Pose = IDENTITY
    action: str = ""


@dataclass(frozen=True)
class ArmSpec:
    """An arm of a robot.

    :param pose: of its mount in the robot's frame.
    """

    id: str
    name: str
    model: str
    pose: Pose = IDENTITY
    gripper: GripperSpec | None = None
    trajectory_action: str = ""
    cartesian_action: str = ""
    wrench_topic: str = ""
    stiffness_topic: str = ""
    position_controller: str = "position"
    compliant_controller: str = "compliant"


@dataclass(frozen=True)
class CameraSpec:
    """A camera with a colour and a depth picture.

    :param parent: id of what it hangs on: a gripper or an arm (its tool's frame), a robot, a body, or "" for the map.
    :param pose: of its optical frame (z forward, x right) in the frame of that.
    :param field_of_view: from the lower to the upper edge.
    """

    id: str
    name: str
    parent: str = ""
    pose: Pose = IDENTITY
    width: int = 320
    height: int = 240
    field_of_view: float = math.radians(60.0)
    rgb_topic: str = ""
    depth_topic: str = ""


@dataclass(frozen=True)
class RobotSpec:
    """A robot: a base, arms on it and cameras.

    :param name: without the prefix of the ontology; the first part of its topics and frames.
    :param pose: of its frame `base_link` in the map; that is the root frame of the base's model.
    :param base: None for a robot that is fixed in the map.
    :param move_action: name of its `move_base_msgs/MoveBase` action.
    """

    id: str
    name: str
    pose: Pose = IDENTITY
    size: Vector | None = None
    base: BaseSpec | None = None
    arms: tuple[ArmSpec, ...] = ()
    cameras: tuple[CameraSpec, ...] = ()
    move_action: str = ""


@dataclass(frozen=True)
class Problem:
    """Something in a scene that could not be simulated as it is written.

    :param element: its id.
    :param file: that it is about; "" for none.
    """

    element: str
    reason: str
    file: str = ""

    def __str__(self) -> str:
        return f"{self.element}: {self.file + ': ' if self.file else ''}{self.reason}"


@dataclass(frozen=True)
class SceneSpec:
    """A whole scene.

    :param cameras: those that hang on no robot.
    :param models: folders in which models are looked for, in order.
    :param problems: what was left out, or mended, when the scene was read.
    """

    bodies: tuple[BodySpec, ...] = ()
    robots: tuple[RobotSpec, ...] = ()
    cameras: tuple[CameraSpec, ...] = ()
    map_frame: str = "map"
    models: tuple[str, ...] = ()
    problems: tuple[Problem, ...] = field(default=())
