"""The tree of a scene's elements, and their poses in the map."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from skiros2_common.core.world_element import Element
from skiros2_sim.core.scene_spec import Problem
from skiros2_std_reasoners.core import spatial_data
from skiros2_std_reasoners.core.geometry import IDENTITY, Pose, composed

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
