"""Reads the specification of a simulated world from the elements of a scene."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from pathlib import Path

from skiros2_common.core.errors import WrongValue
from skiros2_common.core.operations import SCENE
from skiros2_common.core.world_element import Element
from skiros2_motion.core.bore import Bore, Latch
from skiros2_motion.core.geometry import IDENTITY, Pose, Vector, composed
from skiros2_sim.core.bored_box import bored_box
from skiros2_sim.core.scene_spec import (
    ArmSpec,
    BaseSpec,
    BodySpec,
    CameraSpec,
    GripperSpec,
    Problem,
    RobotSpec,
    SceneSpec,
)
from skiros2_std_reasoners.core import spatial_data
from skiros2_std_skills.core import driver_names as names
from skiros2_std_skills.core.devices import posture, posture_names
from skiros2_world_model.core.local_world_model import LocalWorldModel, source_ontologies
from skiros2_world_model.core.world_model import WorldModel

ROOT = "skiros:Scene-0"
_MAP = "map"
_CARRIES = ("skiros:contain", "skiros:hasA", "skiros:spatiallyRelated")


class SceneTree:
    """The elements of a scene, ordered by number."""

    def __init__(self, elements: Iterable[Element]) -> None:
        ordered = sorted(elements, key=lambda e: (e.getIdNumber(), e.id))
        self._elements = {element.id: element for element in ordered}
        self._parents: dict[str, str] = {}
        self.problems: list[Problem] = []
        for element in ordered:
            for relation in element.getRelations("", _CARRIES, ""):
                src, dst = (element.id if end == "-1" else end for end in (relation["src"], relation["dst"]))
                if relation["state"] and src in self._elements and dst in self._elements:
                    self._hang(dst, src)
        root = self._elements.get(ROOT)
        #: The tf frame of the map.
        self.map_frame = (spatial_data.text(root, spatial_data.FRAME) if root is not None else "") or _MAP
        self._frames = {spatial_data.text(e, spatial_data.FRAME): e for e in ordered} | self._elements

    def of(self, wanted: Callable[[Element], bool]) -> list[Element]:
        """Returns the elements that a function selects."""
        return [element for element in self._elements.values() if wanted(element)]

    def parent_id(self, element: Element) -> str:
        """Returns the id of an element's parent; "" without one."""
        return self._parents.get(element.id, "")

    def children(self, element: Element) -> list[Element]:
        """Returns the children of an element."""
        return [self._elements[eid] for eid, parent in self._parents.items() if parent == element.id]

    def parts(self, element: Element) -> list[Element]:
        """Returns the parts of an element, recursively."""
        found = [child for child in self.children(element) if self._is_part(child, element)]
        return found + [part for child in found for part in self.parts(child)]

    def pose_in_map(self, element: Element) -> Pose | None:
        """Returns the pose of an element in the map; None if its pose, or that of an ancestor, is missing."""
        pose = IDENTITY
        seen: set[str] = set()
        at: Element | None = element
        while at is not None and at.id != ROOT:
            own = spatial_data.pose_of(at)
            if own is None or at.id in seen:
                return None
            seen.add(at.id)
            pose = composed(own, pose)
            at = self._frame_of(at)
        return pose

    def why_no_pose(self, element: Element) -> str:
        """Returns why `pose_in_map` returns None."""
        seen: set[str] = set()
        at: Element | None = element
        while at is not None and at.id not in seen:
            if spatial_data.pose_of(at) is None:
                whose = "its pose" if at is element else f"the pose of {at.id}, on which it depends,"
                return f"{whose} is missing or not finite"
            seen.add(at.id)
            at = self._frame_of(at)
        return f"its pose depends on itself, by {', '.join(sorted(seen))}"

    def _frame_of(self, element: Element) -> Element | None:
        """Returns the element whose frame is the reference of an element's pose; None for the map."""
        base = spatial_data.text(element, spatial_data.BASE_FRAME)
        if base == self.map_frame:
            return None
        return self._frames.get(base) if base in self._frames and base else self._elements.get(self.parent_id(element))

    def _hang(self, child: str, parent: str) -> None:
        """Sets the parent of a child. The first parent counts; cycles are rejected."""
        known = self._parents.get(child)
        if known is not None:
            if known != parent:
                self.problems.append(Problem(child, f"it has the parents {known} and {parent}; the first is used"))
            return
        above: str | None = parent
        while above is not None and above != child:
            above = self._parents.get(above)
        if above == child:
            self.problems.append(Problem(child, f"its parent {parent} is its descendant; the relation is ignored"))
            return
        self._parents[child] = parent

    def _is_part(self, child: Element, parent: Element) -> bool:
        return bool(
            child.getRelations(parent.id, "skiros:hasA", "-1") or parent.getRelations("-1", "skiros:hasA", child.id)
        )


ROBOT = "cora:Robot"
BASE = "rparts:RoboticBase"
ARM = "rparts:ArmDevice"
GRIPPER = "rparts:GripperEffector"
CAMERA = "skiros:DepthCamera"
MOVABLE = "skiros:Manipulatable"
BORE = "skiros:Bore"
#: Classes without a shape, even with a size.
_SHAPELESS = ("skiros:TransformationPose", "skiros:Scene")

_MODEL = "skiros:CadModel"
_MASS = "skiros:Weight"
_FRICTION = "skiros:Friction"
_DIAMETER, _DEPTH, _CHAMFER = "skiros:Diameter", "skiros:Depth", "skiros:Chamfer"
_LATCH = ("skiros:LatchDepth", "skiros:LatchForce", "skiros:RetentionForce")

_MAX_SIZE = 100.0  # m, an edge
_MAX_MASS = 1e5  # kg
_MAX_FRICTION = 10.0


def load_scene(file: str | Path, workspace: str | Path) -> SceneSpec:
    """Reads a scene from a scene file of the world model.

    :param file: absolute, or relative to the workspace.
    :param workspace: folder of the user's ontologies and scenes; searched first for models.
    :raises ConfigurationError: folder or file is missing, or the world model rejects the file.
    """
    folder = Path(workspace)
    model = WorldModel(source_ontologies(), folder, initial=[(SCENE, str(file))])
    world_model = LocalWorldModel("simulator", model)
    return read_scene(world_model.get_scene_elements(), world_model.is_subclass, (folder,))


def read_scene(
    elements: Iterable[Element], is_subclass: Callable[[str, str], bool], folders: Sequence[str | Path] = ()
) -> SceneSpec:
    """Reads a scene from its elements. Errors are listed in `SceneSpec.problems`, not raised.

    :param is_subclass: whether a class is equal to, or a subclass of, another one.
    :param folders: searched for models before PyBullet's data.
    """
    return _Reader(SceneTree(elements), is_subclass).read(tuple(map(str, folders)))


class _Reader:
    def __init__(self, tree: SceneTree, is_subclass: Callable[[str, str], bool]) -> None:
        self._tree = tree
        self._is_subclass = is_subclass
        self._problems: list[Problem] = list(tree.problems)
        self._robot_names: set[str] = set()
        self._addresses: set[str] = set()

    def read(self, folders: tuple[str, ...]) -> SceneSpec:
        parts: set[str] = set()
        robots = []
        for element in self._tree.of(lambda e: self._is(e, ROBOT)):
            parts |= {element.id, *(part.id for part in self._tree.parts(element))}
            robots.append(self._robot(element))
        things = self._tree.of(lambda e: e.id not in parts)
        bodies = [body for element in things if (body := self._body(element)) is not None]
        ids = {body.id for body in bodies}
        cameras = [self._loose_camera(e, ids) for e in things if self._is(e, CAMERA)]
        return SceneSpec(
            tuple(bodies), tuple(robots), tuple(cameras), self._tree.map_frame, folders, tuple(self._problems)
        )

    def _is(self, element: Element, kind: str) -> bool:
        return self._is_subclass(element.type, kind)

    def _add_problem(self, element: Element, reason: str) -> None:
        self._problems.append(Problem(element.id, reason))

    # -- things -----------------------------------------------------------------------------------------------

    def _body(self, element: Element) -> BodySpec | None:
        movable, model, size = self._is(element, MOVABLE), self._model(element), self._size(element)
        if any(self._is(element, kind) for kind in (*_SHAPELESS, CAMERA, BORE)):
            return None
        if size is None and not model:
            if movable:
                self._add_problem(element, "omitted: it has neither a size nor a model")
            return None
        pose = self._tree.pose_in_map(element)
        if pose is None:
            self._add_problem(element, f"omitted: {self._tree.why_no_pose(element)}")
            return None
        return BodySpec(
            element.id,
            element.type,
            element.label,
            self._tree.parent_id(element),
            pose,
            size,
            model,
            movable,
            self._mass(element),
            bores=self._bores(element, size, model),
            friction=self._friction(element),
        )

    def _bores(self, element: Element, size: Vector | None, model: str) -> tuple[Bore, ...]:
        """Returns the bores of a body; none if one is invalid."""
        parts = [part for part in self._tree.children(element) if self._is(part, BORE)]
        if not parts:
            return ()
        if size is None or model:
            self._add_problem(element, f"without its bores ({', '.join(b.id for b in parts)}): expected a box")
            return ()
        bores = []
        for part in parts:
            pose = spatial_data.pose_of(part)
            diameter, depth, chamfer = spatial_data.numbers(part, (_DIAMETER, _DEPTH, _CHAMFER))
            if pose is None or diameter is None or depth is None:
                self._add_problem(part, f"omitted: expected a pose, {_DIAMETER} and {_DEPTH}")
                continue
            x, y, _ = pose.position
            bores.append(Bore(x, y, diameter, depth, chamfer or 0.0, self._latch(part, depth)))
        try:
            bored_box(size, bores)
        except WrongValue as error:
            self._add_problem(element, f"without its bores: {error}")
            return ()
        return tuple(bores)

    def _latch(self, bore: Element, deepest: float) -> Latch | None:
        """Returns the latch of a bore; None without one, or if it is invalid."""
        given = spatial_data.numbers(bore, _LATCH)
        if all(number is None for number in given):
            return None
        numbers = [number for number in given if number is not None and 0.0 < number < math.inf]
        if len(numbers) != 3 or numbers[0] >= deepest:
            expected = f"expected {', '.join(_LATCH)} above 0, and a depth below {deepest:g} m"
            self._add_problem(bore, f"without its latch: {expected}, got {given}")
            return None
        return Latch(*numbers)

    def _loose_camera(self, element: Element, bodies: set[str]) -> CameraSpec:
        """Reads a camera that is not part of a robot: mounted on a body, or in the map."""
        name = names.part_name(element)
        parent = self._tree.parent_id(element)
        camera = self._camera(element, parent, "cameras", name)
        if parent in bodies:
            return camera
        pose = self._tree.pose_in_map(element)
        if pose is None:
            self._add_problem(element, f"placed at the origin of the map: {self._tree.why_no_pose(element)}")
        return replace(camera, parent="", pose=pose or IDENTITY)

    # -- robots -----------------------------------------------------------------------------------------------

    def _robot(self, element: Element) -> RobotSpec:
        name = self._unused(names.robot_name(element), element, self._robot_names)
        taken: set[str] = set()
        base: BaseSpec | None = None
        arms: list[ArmSpec] = []
        cameras: list[CameraSpec] = []
        for part in self._tree.children(element):
            if self._is(part, BASE):
                if base is not None:
                    self._add_problem(part, f"omitted: the robot {element.id} already has the base {base.id}")
                    continue
                base = self._base(part, taken)
            elif self._is(part, ARM):
                arms += self._arm(part, name, taken, cameras)
            elif self._is(part, CAMERA):
                cameras.append(self._camera(part, element.id, name, self._unused_part(part, taken)))
        pose = self._tree.pose_in_map(element)
        if pose is None:
            self._add_problem(element, f"placed at the origin of the map: {self._tree.why_no_pose(element)}")
        return RobotSpec(
            element.id,
            name,
            pose or IDENTITY,
            self._size(element),
            base,
            tuple(arms),
            tuple(cameras),
            self._address(names.MOVE, element, name),
        )

    def _base(self, element: Element, taken: set[str]) -> BaseSpec:
        name = self._unused_part(element, taken)
        return BaseSpec(element.id, name, self._model(element), self._pose_on_robot(element), self._size(element))

    def _arm(self, element: Element, robot: str, taken: set[str], cameras: list[CameraSpec]) -> list[ArmSpec]:
        """Returns the arm, if it has a model; adds its cameras to `cameras`."""
        model = self._model(element)
        if not model:
            self._add_problem(element, f"omitted: it has no model ({_MODEL})")
            return []
        name = self._unused_part(element, taken)
        gripper: GripperSpec | None = None
        for part in self._tree.children(element):
            if self._is(part, CAMERA):
                cameras.append(self._camera(part, element.id, robot, self._unused_part(part, taken)))
            elif self._is(part, GRIPPER):
                if gripper is not None:
                    self._add_problem(part, f"omitted: the arm {element.id} already has the gripper {gripper.id}")
                    continue
                gripper = self._gripper(part, robot, taken)
                for child in self._tree.children(part):
                    if self._is(child, CAMERA):
                        cameras.append(self._camera(child, part.id, robot, self._unused_part(child, taken)))
        return [
            ArmSpec(
                element.id,
                name,
                model,
                self._pose_on_robot(element),
                gripper,
                self._address(names.TRAJECTORY, element, robot, name),
                self._address(names.CARTESIAN, element, robot, name),
                "" if element.value_of(names.MOVEIT_GROUP) else self._address(names.PLANNER, element, robot, name),
                self._address(names.WRENCH, element, robot, name),
                self._address(names.STIFFNESS, element, robot, name),
                names.POSITION_CONTROLLER.of(element, robot, name),
                names.COMPLIANT_CONTROLLER.of(element, robot, name),
                self._postures(element),
            )
        ]

    def _postures(self, element: Element) -> dict[str, tuple[float, ...]]:
        """Returns the usable postures of an arm."""
        try:
            return {name: tuple(posture(element, name).values()) for name in posture_names(element)}
        except WrongValue as error:
            self._add_problem(element, f"postures ignored: {error}")
            return {}

    def _gripper(self, element: Element, robot: str, taken: set[str]) -> GripperSpec:
        name = self._unused_part(element, taken)
        model = self._model(element)
        pose = self._pose_on_robot(element) if model else IDENTITY
        return GripperSpec(element.id, name, model, pose, self._address(names.GRIPPER, element, robot, name))

    def _camera(self, element: Element, parent: str, robot: str, name: str) -> CameraSpec:
        return CameraSpec(
            element.id,
            name,
            parent,
            self._pose_on_robot(element),
            rgb_topic=self._address(names.COLOUR, element, robot, name),
            depth_topic=self._address(names.DEPTH, element, robot, name),
        )

    def _unused_part(self, element: Element, taken: set[str]) -> str:
        return self._unused(names.part_name(element), element, taken)

    def _unused(self, name: str, element: Element, taken: set[str]) -> str:
        """Makes a name unique; appends the number of the element if necessary."""
        if name in taken:
            other, name = name, f"{name}_{max(element.getIdNumber(), 0)}"
            while name in taken:
                name += "_"
            self._add_problem(element, f"renamed to {name}: the name {other} is taken")
        taken.add(name)
        return name

    # -- properties -------------------------------------------------------------------------------------------

    def _address(self, address: names.Address, element: Element, robot: str, part: str = "") -> str:
        """Returns the name of a driver's interface: that of the element, if it is valid and unique; else the
        default."""
        name = address.of(element, robot, part)
        if name in self._addresses or not names.is_legal(name):
            other, name = name, address.rule.format(robot=robot, part=part)
            while name in self._addresses:
                name += f"_{max(element.getIdNumber(), 0)}"
            what = "is not a valid ROS name" if not names.is_legal(other) else "is taken"
            self._add_problem(element, f"uses {name}: {address.key} {other!r} {what}")
        self._addresses.add(name)
        return name

    def _pose_on_robot(self, element: Element) -> Pose:
        """Returns the pose of a part in its parent's frame; default is the identity."""
        return spatial_data.pose_of(element) or IDENTITY

    def _model(self, element: Element) -> str:
        return spatial_data.text(element, _MODEL).strip()

    def _size(self, element: Element) -> Vector | None:
        given = spatial_data.numbers(element, spatial_data.SIZE)
        if all(edge is None for edge in given):
            return None
        edges = [edge for edge in given if edge is not None and 0 < edge <= _MAX_SIZE]
        if len(edges) != 3:
            expected = f"expected three edges of up to {_MAX_SIZE} m"
            self._add_problem(element, f"size ignored: {expected}, got {given}")
            return None
        return edges[0], edges[1], edges[2]

    def _mass(self, element: Element) -> float | None:
        (mass,) = spatial_data.numbers(element, (_MASS,))
        if mass is not None and not 0 < mass <= _MAX_MASS:
            self._add_problem(element, f"weight ignored: expected up to {_MAX_MASS} kg, got {mass}")
            return None
        return mass if mass is None or math.isfinite(mass) else None

    def _friction(self, element: Element) -> float | None:
        (friction,) = spatial_data.numbers(element, (_FRICTION,))
        if friction is not None and not 0.0 <= friction <= _MAX_FRICTION:
            self._add_problem(element, f"friction ignored: expected 0 to {_MAX_FRICTION:g}, got {friction}")
            return None
        return friction
