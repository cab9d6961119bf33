"""The specification of a simulated world: plain data, read from a scene by `scene_reader`, or written by hand.

Lengths in metres, masses in kilograms, angles in radians. Ids are those of the world model's elements.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from skiros2_motion.core.bore import Bore
from skiros2_motion.core.geometry import IDENTITY, Pose, Vector

Colour = tuple[float, float, float, float]

_DENSITY = 600.0  # kg/m3, of wood
_MIN_MASS, _MAX_MASS = 0.05, 50.0  # kg, of a body without a mass of its own
#: Friction of a body without one of its own; PyBullet multiplies the values of both contact partners.
_FRICTION = 0.9


@dataclass(frozen=True)
class BodySpec:
    """A body with a shape.

    :param parent: id of the element that contains it, or that it is a part of; "" without one.
    :param pose: of its centre in the map; with a model, of the model's root frame.
    :param size: of the box without a model, or of the bounding box of the model; None if unknown.
    :param model: file of its shape (URDF, OBJ or STL), resolved by `model_files`; "" for a box.
    :param movable: whether it falls and can be carried; otherwise it is fixed in the map.
    :param mass: None for that of wood of its size.
    :param colour: red, green, blue, opacity; None for a colour by number.
    :param friction: of its surface; None for that of wood. The friction of a contact is the product of two.
    :param bores: bores in a box without a model, from its top face downwards.
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
    bores: tuple[Bore, ...] = ()
    friction: float | None = None

    @property
    def own_mass(self) -> float:
        """The mass (kg) that it has, or would have if it were movable."""
        if self.mass is not None:
            return self.mass
        volume = math.prod(self.size) if self.size is not None else 0.0
        return min(max(volume * _DENSITY, _MIN_MASS), _MAX_MASS)

    @property
    def own_friction(self) -> float:
        """The friction coefficient of its surface."""
        return _FRICTION if self.friction is None else self.friction


@dataclass(frozen=True)
class BaseSpec:
    """The base of a robot. With a model it is mobile; without one the robot is fixed in the map.

    :param name: prefix of the names of its links and joints.
    :param pose: of the model's root frame in the robot's frame.
    :param size: of the box without a model.
    """

    id: str
    name: str
    model: str = ""
    pose: Pose = IDENTITY
    size: Vector | None = None


@dataclass(frozen=True)
class GripperSpec:
    """A gripper, with fingers in the arm's model or in its own model.

    :param model: "" if the arm's model contains it.
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
    :param planning_action: "" if MoveIt plans for it.
    :param postures: joint positions (rad, m) by name: it starts in `start`, or in that of its model if there is one, or
        in `home`, or with all joints at 0.
    """

    id: str
    name: str
    model: str
    pose: Pose = IDENTITY
    gripper: GripperSpec | None = None
    trajectory_action: str = ""
    cartesian_action: str = ""
    planning_action: str = ""
    wrench_topic: str = ""
    stiffness_topic: str = ""
    position_controller: str = "position"
    compliant_controller: str = "compliant"
    postures: Mapping[str, tuple[float, ...]] = field(default_factory=dict)


@dataclass(frozen=True)
class CameraSpec:
    """A colour and depth camera.

    :param parent: id of the element it is mounted on: a gripper or an arm (the tool frame), a robot, a body; "" for the
        map.
    :param pose: of its optical frame (z forward, x right) in the parent's frame.
    :param field_of_view: vertical.
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
    """A robot: base, arms and cameras.

    :param name: without the prefix of the ontology; prefix of its topics and frames.
    :param pose: of its frame `base_link` in the map; the root frame of the base's model.
    :param base: None for a robot fixed in the map.
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
    """A part of a scene that cannot be simulated as described.

    :param element: its id.
    :param file: the related file; "" without one.
    """

    element: str
    reason: str
    file: str = ""

    def __str__(self) -> str:
        return f"{self.element}: {self.file + ': ' if self.file else ''}{self.reason}"


@dataclass(frozen=True)
class SceneSpec:
    """A scene.

    :param cameras: cameras that are not part of a robot.
    :param models: folders to search for models, in order.
    :param problems: elements that were omitted or corrected.
    """

    bodies: tuple[BodySpec, ...] = ()
    robots: tuple[RobotSpec, ...] = ()
    cameras: tuple[CameraSpec, ...] = ()
    map_frame: str = "map"
    models: tuple[str, ...] = ()
    problems: tuple[Problem, ...] = field(default=())
