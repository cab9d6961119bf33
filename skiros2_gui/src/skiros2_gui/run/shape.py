"""The shape of a task's tree: nodes and edges without states."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from skiros2_common.core.names import local_name

#: The id, parent id, type, label and processor of a node.
Key = tuple[int, int, str, str, str]


#: The names of control-flow nodes, by processor symbol.
_GROUPS = {
    "->": "in turn",
    "->*": "in turn",
    "?": "alternatives",
    "?*": "alternatives",
    "|ff|": "side by side",
    "|fs|": "side by side",
}


def _is_skill(kind: str) -> bool:
    """Skills have a class of the ontology as type, control-flow nodes a type without prefix."""
    return kind.find(":") > 0


def key_of(node: Any) -> Key:
    """Returns the parts of a `SkillProgress` that define the shape."""
    label = node.label if node.type != ":Skill" else ""  # the label of a control-flow node is its processor symbol
    return (node.id, node.parent_id, node.type, label, node.processor)


def keys_of(nodes: Sequence[Any]) -> list[Key]:
    """Returns the key of each node."""
    return [key_of(node) for node in nodes]


class Shape:
    """Nodes by their index in the message; 0 is the root. Immutable; any thread.

    A node whose parent does not precede it becomes a child of the root, so that any message gives a tree.

    :ivar keys: of each node.
    :ivar parents: the index of each node's parent; -1 for the root.
    :ivar children: the indices of each node's children, in order.
    :ivar depths: 0 for the root.
    :ivar index_by_id: the index of each id; the last one of a duplicate id.
    """

    __slots__ = ("children", "depths", "index_by_id", "keys", "parents")

    def __init__(self, keys: list[Key]) -> None:
        self.keys = keys
        self.index_by_id: dict[int, int] = {}
        self.parents: list[int] = []
        self.depths: list[int] = []
        self.children: list[list[int]] = [[] for _ in keys]
        for index, key in enumerate(keys):
            above = self.index_by_id.get(key[1], 0) if index else -1
            self.parents.append(above)
            self.depths.append(self.depths[above] + 1 if index else 0)
            if index:
                self.children[above].append(index)
            self.index_by_id[key[0]] = index

    def __len__(self) -> int:
        return len(self.keys)

    def id(self, index: int) -> int:
        return self.keys[index][0]

    def type(self, index: int) -> str:
        return self.keys[index][2]

    def label(self, index: int) -> str:
        return self.keys[index][3]

    def processor(self, index: int) -> str:
        """Returns the symbol of its processor, such as `->*`; "" for none."""
        return self.keys[index][4]

    def is_skill(self, index: int) -> bool:
        """Returns whether it is a skill, not a control-flow node."""
        return index > 0 and _is_skill(self.type(index))

    def name(self, index: int) -> str:
        """Returns the label, or else the type without prefix, or the kind of control-flow node."""
        _, _, kind, label, processor = self.keys[index]
        if not index:
            return f"task {self.keys[index][0]}"
        if label:
            return label
        if _is_skill(kind):
            return local_name(kind)
        return f"{_GROUPS.get(processor, '')} {processor}".strip() or kind or f"node {self.keys[index][0]}"

    def path(self, index: int) -> list[int]:
        """Returns the indices from the root to a node, both included."""
        path = [index]
        while (index := self.parents[index]) >= 0:
            path.append(index)
        return path[::-1]

    def path_names(self, index: int) -> list[str]:
        """Returns the names from below the root to a node."""
        return [self.name(above) for above in self.path(index)[1:]]
