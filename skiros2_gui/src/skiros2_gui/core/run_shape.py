"""The shape of a task's tree: what its nodes are and which stands under which; not what they do."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from skiros2_common.core.names import local_name

#: Of a node: its id, that of its parent, type, label, processor.
Key = tuple[int, int, str, str, str]


#: What nodes that only group others are called, by the symbol of how they tick them.
_GROUPS = {
    "->": "in turn",
    "->*": "in turn",
    "?": "alternatives",
    "?*": "alternatives",
    "|ff|": "side by side",
    "|fs|": "side by side",
}


def _is_skill(kind: str) -> bool:
    """Skills are of a class of the ontology; nodes that only group others have a type without prefix."""
    return kind.find(":") > 0


def key_of(node: Any) -> Key:
    """Of the `SkillProgress` of a node what makes the shape."""
    label = node.label if node.type != ":Skill" else ""  # a group's is its processor's symbol, which is shown by itself
    return (node.id, node.parent_id, node.type, label, node.processor)


def keys_of(nodes: Sequence[Any]) -> list[Key]:
    """Likewise of each."""
    return [key_of(node) for node in nodes]


class Shape:
    """Nodes by their place in the message, 0 the root. Not changed once made; any thread.

    A node whose parent is not told before it is taken for a child of the root, so that whatever a manager tells is a
    tree.

    :ivar keys: of each node.
    :ivar parents: the places of the parents; -1 for the root.
    :ivar children: the places of the children of each, in their order.
    :ivar depths: 0 for the root.
    :ivar places: the place of each id; the last one of those that came twice.
    """

    __slots__ = ("children", "depths", "keys", "parents", "places")

    def __init__(self, keys: list[Key]) -> None:
        self.keys = keys
        self.places: dict[int, int] = {}
        self.parents: list[int] = []
        self.depths: list[int] = []
        self.children: list[list[int]] = [[] for _ in keys]
        for place, key in enumerate(keys):
            above = self.places.get(key[1], 0) if place else -1
            self.parents.append(above)
            self.depths.append(self.depths[above] + 1 if place else 0)
            if place:
                self.children[above].append(place)
            self.places[key[0]] = place

    def __len__(self) -> int:
        return len(self.keys)

    def id(self, place: int) -> int:
        return self.keys[place][0]

    def type(self, place: int) -> str:
        return self.keys[place][2]

    def label(self, place: int) -> str:
        return self.keys[place][3]

    def processor(self, place: int) -> str:
        """The symbol of how it ticks its children, such as `->*`; "" where it has none."""
        return self.keys[place][4]

    def is_skill(self, place: int) -> bool:
        """Whether it is a skill, not a node that only groups others."""
        return place > 0 and _is_skill(self.type(place))

    def name(self, place: int) -> str:
        """The label; where there is none, the type without prefix, or how a group ticks its children."""
        _, _, kind, label, processor = self.keys[place]
        if not place:
            return f"task {self.keys[place][0]}"
        if label:
            return label
        if _is_skill(kind):
            return local_name(kind)
        return f"{_GROUPS.get(processor, '')} {processor}".strip() or kind or f"node {self.keys[place][0]}"

    def path(self, place: int) -> list[int]:
        """The places from the root to a node, both among them."""
        path = [place]
        while (place := self.parents[place]) >= 0:
            path.append(place)
        return path[::-1]

    def path_names(self, place: int) -> list[str]:
        """The names on the way to a node, without the root's."""
        return [self.name(above) for above in self.path(place)[1:]]
