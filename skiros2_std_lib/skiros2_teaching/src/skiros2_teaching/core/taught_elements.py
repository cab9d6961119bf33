"""Taught poses and paths as elements of the world model.

    object          any element with a pose
      hasA  skiros:TaughtPose    pose of the tool in the frame of the object
              hasA  skiros:LiftingPose   pose of the tool in the frame of the taught pose; at most one
      hasA  skiros:TaughtPath    pose of its first sample in the frame of the object; samples and gripper events

They are parts of their object: they move with it, and are removed with it. The label is the name, unique among the
taught elements of an object. Each edit is a list of operations for one request (`wmi.transact`): the window sends it
through its undo stack. `last_edit` finds the last one in the history, whoever made it.
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Iterable, Sequence

from skiros2_common.core.changeset import ChangeSet
from skiros2_common.core.discrete_reasoner import REASONER_PROPERTY
from skiros2_common.core.errors import Refused, UnknownName, WrongValue
from skiros2_common.core.operations import Operation, Remove
from skiros2_common.core.world_element import Element
from skiros2_common.core.world_model_port import WorldModelPort
from skiros2_motion.core.geometry import Pose, normalized
from skiros2_std_reasoners.core import spatial_data as space
from skiros2_std_reasoners.core.scene_poses import parent_of
from skiros2_teaching.core.taught_path import TaughtPath
from skiros2_world_model.core.changes import added_elements, written
from skiros2_world_model.core.history import HistoryEntry
from skiros2_world_model.core.world_model_client import WorldModelClient

POSE, LIFTING_POSE, PATH = "skiros:TaughtPose", "skiros:LiftingPose", "skiros:TaughtPath"
SAMPLES, EVENTS = "skiros:PathSamples", "skiros:GripperEvents"
PART = "skiros:hasA"

#: Maximum length of a name.
_MAX_NAME = 80
#: Maximum distance of a taught pose from its object (m).
_MAX_DISTANCE = 10.0
#: Maximum difference of the length of a quaternion from 1.
_UNIT = 1e-3
#: Number of requests in which an edit to undo is searched.
_HISTORY = 500
_REASONER = "AauSpatialReasoner"


# -- reading -----------------------------------------------------------------------------------------------------


def taught_elements(wmi: WorldModelPort, owner: Element) -> list[Element]:
    """Returns the taught poses and paths of an object, ordered by name, without lifting poses.

    :param owner: the object, in its current state or not.
    :raises UnknownName: the object is not in the scene.
    """
    found = _parts(wmi, _current(wmi, owner), (POSE, PATH))
    return sorted((e for e in found if not wmi.is_subclass(e.type, LIFTING_POSE)), key=lambda e: (e.label, e.id))


def find_taught(wmi: WorldModelPort, owner: Element, name: str) -> Element:
    """Returns the taught pose or path of an object with a name.

    :raises UnknownName: there is none; the text has the nearest names.
    """
    known = {element.label: element for element in taught_elements(wmi, owner)}
    if name not in known:
        near = difflib.get_close_matches(name, known) or sorted(known)[:5]
        raise UnknownName(f"{owner.label!r} has no taught pose or path {name!r}; it has: {', '.join(near) or 'none'}")
    return known[name]


def lifting_pose_of(wmi: WorldModelPort, taught: Element) -> Element | None:
    """Returns the lifting pose of a taught pose; None without one."""
    found = _parts(wmi, _current(wmi, taught), (LIFTING_POSE,))
    return found[0] if found else None


def owner_of(wmi: WorldModelPort, taught: Element) -> Element:
    """Returns the object that a taught pose, lifting pose or path belongs to.

    :raises UnknownName: the taught element is no longer in the scene.
    :raises Refused: its object is gone.
    """
    element = _current(wmi, taught)
    above = parent_of(wmi, element)
    while above is not None and wmi.is_subclass(above.type, POSE):
        above = parent_of(wmi, above)
    if above is None:
        raise Refused(f"the object of {taught.label!r} is gone: {taught.id} is not a part of anything in the scene")
    return above


def path_of(taught: Element) -> TaughtPath:
    """Returns the path of an element `skiros:TaughtPath`, in the frame of the element.

    :raises WrongValue: samples or events are missing or invalid.
    """
    try:
        return TaughtPath.from_json(space.text(taught, SAMPLES), space.text(taught, EVENTS))
    except WrongValue as error:
        raise WrongValue(f"path {taught.label!r}: {error}") from None


# -- edits -------------------------------------------------------------------------------------------------------


def new_pose(wmi: WorldModelPort, owner: Element, name: str, pose: Pose) -> list[Operation]:
    """Returns the operations that add a taught pose.

    :param pose: of the tool in the frame of the object.
    :raises UnknownName: the object is not in the scene.
    :raises WrongValue: name or pose cannot be used; the text lists all problems.
    """
    owner = _current(wmi, owner)
    _refuse_if(f"taught pose {name!r} of {owner.label!r}", [*_name_problems(wmi, owner, name), *pose_problems(pose)])
    return _added(wmi, _element(POSE, name, pose, owner, PART))


def new_path(wmi: WorldModelPort, owner: Element, name: str, path: TaughtPath) -> list[Operation]:
    """Returns the operations that add a taught path.

    :param path: in the frame of the object.
    :raises UnknownName: the object is not in the scene.
    :raises WrongValue: the name cannot be used, or the path is too far away; the text lists all problems.
    """
    owner = _current(wmi, owner)
    start = path.pose(0.0)
    _refuse_if(f"taught path {name!r} of {owner.label!r}", [*_name_problems(wmi, owner, name), *pose_problems(start)])
    element = _element(PATH, name, start, owner, PART)
    _put_path(element, path.from_start())
    return _added(wmi, element)


def with_lifting_pose(wmi: WorldModelPort, taught: Element, pose: Pose) -> list[Operation]:
    """Returns the operations that add the lifting pose of a taught pose, or move the one that it has.

    :param pose: of the tool in the frame of the taught pose.
    :raises UnknownName: the taught pose is not in the scene.
    :raises WrongValue: the element is not a taught pose, or the pose cannot be used; the text lists all problems.
    """
    taught = _current(wmi, taught)
    problems = pose_problems(pose)
    if not wmi.is_subclass(taught.type, POSE) or wmi.is_subclass(taught.type, LIFTING_POSE):
        problems.insert(0, f"{taught.id} is a {taught.type}: expected a {POSE}")
    _refuse_if(f"lifting pose of {taught.label!r}", problems)
    there = lifting_pose_of(wmi, taught)
    if there is not None:
        return with_pose(wmi, there, pose)
    return _added(wmi, _element(LIFTING_POSE, f"{taught.label} lifting", pose, taught, PART))


def with_pose(wmi: WorldModelPort, taught: Element, pose: Pose) -> list[Operation]:
    """Returns the operations that move a taught element; the samples of a path move with its start.

    :param pose: in the frame of its parent: the object, or for a lifting pose the taught pose.
    :raises UnknownName: the element is not in the scene.
    :raises Refused: its object is gone.
    :raises WrongValue: the pose cannot be used; the text lists all problems.
    """
    owner_of(wmi, taught)
    _refuse_if(f"pose of {taught.label!r}", pose_problems(pose))
    element = _current(wmi, taught)
    above = parent_of(wmi, element)
    space.set_pose(element, pose)
    if above is not None:
        space.set_text(element, space.BASE_FRAME, _frame(above))
    return _changed(wmi, element)


def with_path(wmi: WorldModelPort, taught: Element, path: TaughtPath) -> list[Operation]:
    """Returns the operations that replace a taught path.

    :param path: in the frame of the object.
    :raises UnknownName: the element is not in the scene.
    :raises Refused: its object is gone.
    :raises WrongValue: the element is not a taught path, or the path is too far away; the text lists all problems.
    """
    owner = owner_of(wmi, taught)
    element, start = _current(wmi, taught), path.pose(0.0)
    problems = pose_problems(start)
    if not wmi.is_subclass(element.type, PATH):
        problems.insert(0, f"{element.id} is a {element.type}: expected a {PATH}")
    _refuse_if(f"path {taught.label!r}", problems)
    space.set_pose(element, start)
    space.set_text(element, space.BASE_FRAME, _frame(owner))
    _put_path(element, path.from_start())
    return _changed(wmi, element)


def renamed(wmi: WorldModelPort, taught: Element, name: str) -> list[Operation]:
    """Returns the operations that rename a taught element.

    :raises UnknownName: the element is not in the scene.
    :raises Refused: its object is gone.
    :raises WrongValue: the name cannot be used; the text lists all problems.
    """
    owner, element = owner_of(wmi, taught), _current(wmi, taught)
    _refuse_if(f"name of {element.label!r}", _name_problems(wmi, owner, name, element.id))
    element.label = name
    return _changed(wmi, element)


def removed(wmi: WorldModelPort, taught: Element) -> list[Operation]:
    """Returns the operations that remove a taught element, a taught pose with its lifting pose.

    :raises UnknownName: the element is not in the scene.
    :raises WrongValue: it is not a taught element.
    """
    element = _current(wmi, taught)
    if not any(wmi.is_subclass(element.type, cls) for cls in (POSE, PATH)):
        raise WrongValue(f"{element.id} is a {element.type}: expected a {POSE} or a {PATH}")
    return [Remove(element.id)]


def last_edit(wmi: WorldModelClient) -> HistoryEntry:
    """Returns the last edit of taught elements that has not been undone, by whatever client; `wmi.revert` undoes it.

    :raises Refused: there is none among the last requests.
    :raises WmException: the world model has no journal.
    """
    edits: list[HistoryEntry] = []
    for entry in wmi.history(limit=_HISTORY):
        change = entry.changes.effective()
        if not change or entry.author == _REASONER or not _is_edit(wmi, change):
            continue
        if edits and _are_inverse(edits[-1].changes.effective(), change):
            edits.pop()
        else:
            edits.append(entry)
    if not edits:
        raise Refused(f"nothing to undo: no taught pose or path was edited in the last {_HISTORY} requests")
    return edits[-1]


def pose_problems(pose: Pose) -> list[str]:
    """Returns why a pose cannot be taught; empty if it can."""
    problems = []
    if not all(map(math.isfinite, pose.position)):
        problems.append(f"position {_listed(pose.position)}: expected finite numbers in m")
    elif math.hypot(*pose.position) > _MAX_DISTANCE:
        problems.append(f"position {_listed(pose.position)}: expected up to {_MAX_DISTANCE:g} m from the object")
    if not all(map(math.isfinite, pose.orientation)):
        problems.append(f"orientation {_listed(pose.orientation)}: expected finite numbers")
    elif abs(math.hypot(*pose.orientation) - 1.0) > _UNIT:
        problems.append(f"orientation {_listed(pose.orientation)}: expected a unit quaternion x, y, z, w")
    return problems


# -- internal ----------------------------------------------------------------------------------------------------


def _is_edit(wmi: WorldModelPort, change: ChangeSet) -> bool:
    """Whether a change concerns the content of taught elements only."""
    types = {record.type for pair in change.records.values() for record in pair if record is not None}
    return bool(types) and all(any(wmi.is_subclass(kind, cls) for cls in (POSE, PATH)) for kind in types)


def _are_inverse(change: ChangeSet, other: ChangeSet) -> bool:
    inverse = other.inverse()
    return (
        change.relations == inverse.relations
        and change.records.keys() == inverse.records.keys()
        and all(
            one is two or (one is not None and two is not None and one.equals(two))
            for eid, pair in change.records.items()
            for one, two in zip(pair, inverse.records[eid], strict=True)
        )
    )


def _current(wmi: WorldModelPort, element: Element) -> Element:
    """Returns the current state of an element.

    :raises UnknownName: it is not in the scene.
    """
    found = wmi.find_element(element.id) if element.id else None
    if found is not None:
        return found
    change = wmi.removal_of(element.id) if element.id else None
    by = f": it was removed by {change.author}" if change is not None and change.author else ""
    raise UnknownName(f"{element.label or element.type!r} ({element.id or 'without id'}) is not in the scene{by}")


def _parts(wmi: WorldModelPort, owner: Element, classes: Iterable[str]) -> list[Element]:
    parts = [wmi.find_element(relation["dst"]) for relation in owner.getRelations("-1", PART)]
    return [e for e in parts if e is not None and any(wmi.is_subclass(e.type, cls) for cls in classes)]


def _name_problems(wmi: WorldModelPort, owner: Element, name: str, own_id: str = "") -> list[str]:
    problems = []
    if not name.strip():
        problems.append("the name is empty")
    elif name != name.strip() or not name.isprintable():
        problems.append(f"name {name!r}: expected printable characters without spaces at its ends")
    if len(name) > _MAX_NAME:
        problems.append(f"the name has {len(name)} characters: expected up to {_MAX_NAME}")
    same = [e for e in taught_elements(wmi, owner) if e.label == name and e.id != own_id]
    if same:
        problems.append(f"{owner.label!r} has a taught element of this name: {same[0].id}")
    return problems


def _refuse_if(subject: str, problems: Sequence[str]) -> None:
    if problems:
        raise WrongValue(f"{subject}: {'; '.join(problems)}")


def _element(kind: str, name: str, pose: Pose, parent: Element, relation: str) -> Element:
    element = Element(kind, name)
    # not by `setProperty`: the reasoner itself is a plugin, and need not be loaded in this process
    element.appendProperty(REASONER_PROPERTY, _REASONER)
    space.set_pose(element, Pose(pose.position, normalized(pose.orientation)))
    space.set_text(element, space.BASE_FRAME, _frame(parent))
    element.setProperty(space.PUBLISH, True)
    element.addRelation(parent.id, relation, "-1")
    return element


def _put_path(element: Element, path: TaughtPath) -> None:
    samples, events = path.to_json()
    space.set_text(element, SAMPLES, samples)
    space.set_text(element, EVENTS, events)


def _frame(element: Element) -> str:
    return space.text(element, space.FRAME) or str(element.id)


def _added(wmi: WorldModelPort, element: Element) -> list[Operation]:
    return added_elements([element], wmi.is_scene_element)[1]


def _changed(wmi: WorldModelPort, element: Element) -> list[Operation]:
    return written([element], wmi.is_scene_element)[1]


def _listed(numbers: Sequence[float]) -> str:
    return f"({', '.join(f'{number:.4g}' for number in numbers)})"
