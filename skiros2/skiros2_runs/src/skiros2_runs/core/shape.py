"""The shape of a task's tree: nodes and edges without states."""

from __future__ import annotations

import functools
from collections.abc import Sequence

from skiros2_common.core.names import local_name
from skiros2_runs.core.progress import GROUP_TYPE, NodeMessage

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


def key_of(node: NodeMessage) -> Key:
    """Returns the parts of a `SkillProgress` that define the shape."""
    label = node.label if node.type != GROUP_TYPE else ""  # the label of a control-flow node is its processor symbol
    return (node.id, node.parent_id, node.type, label, node.processor)


class Shape:
    """Nodes by their index in the message; 0 is the root. Immutable; any thread.

    A node whose parent does not precede it becomes a child of the root, so that any message gives a tree.

    :ivar keys: of each node.
    :ivar parents: the index of each node's parent; -1 for the root.
    :ivar children: the indices of each node's children, in order.
    :ivar depths: 0 for the root.
    :ivar index_by_id: the index of each id; the last one of a duplicate id.
    """

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

    @classmethod
    def of(cls, nodes: Sequence[NodeMessage]) -> Shape:
        """Returns the shape of a message."""
        return cls([key_of(node) for node in nodes])

    @functools.cached_property
    def index_paths(self) -> list[tuple[int, ...]]:
        """The child indices from the root to each node; () for the root."""
        paths: list[tuple[int, ...]] = [()] * len(self.keys)
        for parent, children in enumerate(self.children):
            for number, child in enumerate(children):
                paths[child] = (*paths[parent], number)
        return paths

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
            return local_name(kind) or f"node {self.keys[index][0]}"
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

    def skills_text(self, most: int = 0) -> str:
        """Returns the names of the nodes below the root.

        :param most: how many are named; 0: all.
        """
        names = [self.name(index) for index in self.children[0]] if self.keys else []
        more = f" and {len(names) - most} more" if 0 < most < len(names) else ""
        return ", ".join(names[: most or None]) + more
