"""Regions of the world model that no tool enters: elements of `skiros:NeverRegion`."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from skiros2_common.core.errors import WrongValue
from skiros2_common.core.world_element import Element
from skiros2_common.core.world_model_port import WorldModelPort
from skiros2_contact_skills.core.part_poses import pose_on_arm
from skiros2_motion.core.regions import MARGIN, Region
from skiros2_std_reasoners.core import spatial_data as space

NEVER = "skiros:NeverRegion"
_DIAMETER, _HEIGHT = "skiros:Diameter", "skiros:SizeZ"


def regions_of(wmi: WorldModelPort, arm: Element) -> list[Region]:
    """Returns the regions in the base frame of an arm.

    :raises WrongValue: one has no pose, or a size that is not usable; a region is not left out.
    """
    found = wmi.resolve_elements(Element(NEVER))
    return [_region(element, wmi, arm) for element in sorted(found, key=lambda element: element.id)]


def check_outside(regions: Iterable[Region], what: str, position: Sequence[float], least: float = MARGIN) -> None:
    """Checks that a position is outside of the regions.

    :param what: at the position, for the message.
    :param position: in the base frame of the arm (m).
    :param least: distance that is needed (m).
    :raises WrongValue: it is not.
    """
    for region in regions:
        distance = region.plane(position)[0]
        if distance < least:
            is_near = f"{1000 * distance:.0f} mm from" if distance >= 0.0 else f"{-1000 * distance:.0f} mm inside"
            raise WrongValue(f"{what} is {is_near} {region.name!r}, which no tool enters; expected {1000 * least:g} mm")


def _region(element: Element, wmi: WorldModelPort, arm: Element) -> Region:
    name, pose = str(element.label or element.id), pose_on_arm(wmi, arm, element)
    diameter, height = space.numbers(element, (_DIAMETER, _HEIGHT))
    is_round = diameter is not None
    size = [diameter, diameter, height] if is_round else space.numbers(element, space.SIZE)
    if not is_round and not any(element.value_of(key) for key in space.SIZE):
        return Region(name, pose)
    edges = tuple(edge for edge in size if edge is not None and edge > 0.0)
    if len(edges) < 3:
        wants = "skiros:Diameter and SizeZ; SizeX, SizeY and SizeZ; or none of them, for all below its z = 0"
        raise WrongValue(f"region {name!r}: expected {wants}, above 0")
    return Region(name, pose, edges, is_round)
