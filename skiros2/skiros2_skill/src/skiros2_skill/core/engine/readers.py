"""The running nodes of a task by what they read, so that a change marks only the nodes that it affects."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable

from skiros2_skill.core.tree.skill_node import SkillWrapper

_Nodes = dict[SkillWrapper, None]


class Readers:
    """The running nodes by the elements and the blackboard keys that they read. For the thread that ticks the task.

    A marked node is `stale`: its parameters are refreshed before its next `execute`. A node without known reads is
    marked by every change; `add` begins so, because many skills end before anything changes.
    """

    def __init__(self) -> None:
        self._of_anything: _Nodes = {}
        self._of_element: dict[str, _Nodes] = {}
        self._of_key: dict[str, _Nodes] = {}
        self._revisions: dict[str, object] = {}  # of the elements, when they were last compared

    def add(self, node: SkillWrapper) -> None:
        """Adds a node that starts."""
        self.remove(node)
        self._of_anything[node] = None

    def set_reads(self, node: SkillWrapper, ids: Collection[str], revision: Callable[[str], object]) -> None:
        """Records what a node is about to read, besides the keys of its slots.

        :param ids: of elements.
        :param revision: returns the present revision of an element.
        """
        reads = (tuple(ids), tuple(slot.key for slot in node.slots))
        if node.reads == reads:
            return
        self.remove(node)
        node.reads = reads
        for eid in reads[0]:
            self._of_element.setdefault(eid, {})[node] = None
            if eid not in self._revisions:
                self._revisions[eid] = revision(eid)
        for key in reads[1]:
            self._of_key.setdefault(key, {})[node] = None

    def remove(self, node: SkillWrapper) -> None:
        """Removes a node that has ended."""
        self._of_anything.pop(node, None)
        if node.reads is None:
            return
        ids, keys = node.reads
        node.reads = None
        for eid in ids:
            if _has_last(self._of_element, eid, node):
                del self._revisions[eid]
        for key in keys:
            _has_last(self._of_key, key, node)

    def mark_changed(self, revision: Callable[[str], object]) -> None:
        """Marks the readers of the elements that have changed since the last call.

        :param revision: returns the present revision of an element.
        """
        changed = [eid for eid, seen in self._revisions.items() if revision(eid) is not seen]
        for eid in changed:
            self._revisions[eid] = revision(eid)  # before the nodes read it
            _mark(self._of_element[eid])
        _mark(self._of_anything)

    def mark_keys(self, keys: Iterable[str]) -> None:
        """Marks the readers of keys of the blackboard."""
        for key in keys:
            _mark(self._of_key.get(key, ()))
        _mark(self._of_anything)

    def mark_all(self) -> None:
        """Marks all nodes."""
        for nodes in (self._of_anything, *self._of_element.values(), *self._of_key.values()):
            _mark(nodes)


def _mark(nodes: Iterable[SkillWrapper]) -> None:
    for node in nodes:
        node.stale = True
        node.steady = False


def _has_last(index: dict[str, _Nodes], name: str, node: SkillWrapper) -> bool:
    """Removes a node from the readers of a name. Returns whether it was the last one."""
    nodes = index.get(name, {})
    nodes.pop(node, None)
    if nodes:
        return False
    index.pop(name, None)
    return True
