"""Whether an arm still holds what the world model has in its gripper."""

from __future__ import annotations

from skiros2_common.core.errors import SkirosError
from skiros2_common.core.world_element import Element
from skiros2_common.core.world_model_port import WorldModelPort
from skiros2_contact_skills.arms import finger_width
from skiros2_contact_skills.core.evidence import holds_something
from skiros2_std_reasoners.core.places import move_in_world_model
from skiros2_std_reasoners.core.scene_poses import ancestors, pose_in_scene
from skiros2_std_skills.core.devices import opening


def lost_part(wmi: WorldModelPort, robot: Element, arm: Element) -> str:
    """Returns that a part is not between the fingers of the arm's gripper, with its name and their distance; "" if one
    may be there, none has to be, or the fingers are not measured."""
    for gripper in _related(wmi, wmi.get_element(arm.id), "skiros:hasA"):
        if not wmi.is_subclass(gripper.type, "rparts:GripperEffector"):
            continue
        parts = _related(wmi, gripper, "skiros:contain")
        width = finger_width(wmi, robot, gripper) if parts else None
        if width is not None and not holds_something(width, opening(gripper)):
            names = ", ".join(str(part.label or part.id) for part in parts)
            return f"{names}: not between the fingers, which are {1000 * width:.0f} mm apart"
    return ""


def leave_where_it_was_lost(wmi: WorldModelPort, part: Element) -> str:
    """Takes a part that is not between the fingers out of its gripper in the world model. It is in the scene then, with
    the pose at which it was last known: nothing measures where it is. A part that is in no gripper stays.

    :returns: what was done, for the message of the failure.
    """
    name = str(part.label or part.id)
    try:
        line = ancestors(wmi, wmi.get_element(part.id))
        if len(line) < 2 or not wmi.is_subclass(line[1].type, "rparts:GripperEffector"):
            return f"{name} is in no gripper"
        move_in_world_model(wmi, line[0], line[-1], pose_in_scene(wmi, line[0])[1])
    except SkirosError as error:
        return f"{name} is still in its gripper in the world model: {error}"
    return f"{name} is in {line[-1].label or line[-1].id} in the world model, where it was last known"


def _related(wmi: WorldModelPort, element: Element, relation: str) -> list[Element]:
    found = (wmi.find_element(each["dst"]) for each in element.getRelations("-1", relation))
    return [each for each in found if each is not None]
