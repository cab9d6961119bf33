"""Arms, and the taught poses and paths of an object, as read from the window's replica of the scene."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from skiros2_common.core.errors import UnknownName
from skiros2_common.core.json_data import read_json
from skiros2_common.core.manager_names import manager_of, matching_name
from skiros2_common.core.names import id_order
from skiros2_common.core.operations import SCENE
from skiros2_common.core.world_element import Element
from skiros2_world_model.core.queries import SceneReader

#: The classes of taught elements; a lifting pose is a taught pose and a part of another one.
POSE, LIFTING_POSE, PATH = "skiros:TaughtPose", "skiros:LiftingPose", "skiros:TaughtPath"

_PART = "skiros:hasA"
_SAMPLES, _EVENTS = "skiros:PathSamples", "skiros:GripperEvents"
_POSITION = ("skiros:PositionX", "skiros:PositionY", "skiros:PositionZ")


@dataclass(frozen=True)
class Arm:
    """:param robot: the label of its robot.
    :param manager: the node name of the robot's manager; "" for none.
    :param tool: the id of its gripper; without one that of the arm.
    """

    eid: str
    label: str
    robot: str
    manager: str
    tool: str


@dataclass(frozen=True)
class Taught:
    """A taught pose or path.

    :param kind: `POSE` or `PATH`.
    :param text: its content for people.
    :param has_lifting: whether a pose has a lifting pose.
    """

    eid: str
    name: str
    kind: str
    text: str
    has_lifting: bool = False


def arms(scene: SceneReader, managers: Sequence[str]) -> list[Arm]:
    """Returns the arms of all robots, ordered by robot and id."""
    found = []
    for robot in scene.matching(Element("cora:Robot"), SCENE):
        manager = matching_name(manager_of(robot), managers) or manager_of(robot)
        for arm in scene.branch(robot.id, _PART, "rparts:ArmDevice", SCENE):
            tools = scene.branch(arm.id, _PART, "rparts:GripperEffector", SCENE)
            tool = tools[0].id if tools else arm.id
            found.append(Arm(arm.id, arm.label or arm.id, robot.label or robot.id, manager, tool))
    return sorted(found, key=lambda arm: (arm.robot, id_order(arm.eid)))


def owner_of(scene: SceneReader, eid: str) -> Element | None:
    """Returns the object of a taught element, or any other element itself; None if it is gone."""
    element = scene.find(eid, SCENE)
    taught = {e.id for kind in (POSE, PATH) for e in scene.matching(Element(kind), SCENE)}
    while element is not None and element.id in taught:
        above = scene.related("", _PART, element.id, SCENE)
        element = scene.find(above[0]["src"], SCENE) if above else None
    return element


def taught_of(scene: SceneReader, owner: str) -> list[Taught]:
    """Returns the taught poses and paths of an object, ordered by name."""
    parts = {relation["dst"] for relation in scene.related(owner, _PART, "", SCENE)}
    lifting = {e.id for e in scene.matching(Element(LIFTING_POSE), SCENE)}
    found = []
    for kind in (POSE, PATH):
        for element in scene.matching(Element(kind), SCENE):
            if element.id in parts and element.id not in lifting:
                has_lifting = any(r["dst"] in lifting for r in scene.related(element.id, _PART, "", SCENE))
                text = _path_text(element) if kind == PATH else _pose_text(element, has_lifting)
                found.append(Taught(element.id, element.label or element.id, kind, text, has_lifting))
    return sorted(found, key=lambda taught: (taught.name, id_order(taught.eid)))


def _pose_text(element: Element, has_lifting: bool) -> str:
    position = [element.value_of(key) for key in _POSITION]
    known = [f"{1e3 * value:.0f}" for value in position if isinstance(value, float)]
    where = f"at {', '.join(known)} mm" if len(known) == len(_POSITION) else "without a position"
    return f"pose {where}, with a lifting pose" if has_lifting else f"pose {where}"


def _path_text(element: Element) -> str:
    try:
        samples, events = (read_json(str(element.value_of(key) or "[]")) for key in (_SAMPLES, _EVENTS))
        return f"path of {float(samples[-1][0]):.1f} s, {len(samples)} samples, gripper events: {len(events)}"
    except (ValueError, TypeError, LookupError, UnknownName):
        return "path without readable samples"
