"""The window's copy of the scene as a tree of spatial relations.

Built by a worker thread, then used by the Qt thread only; no call blocks. It is a copy, not the replica of the client,
as a Qt view needs a scene that does not change between two events, and undo needs the state before each change.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Protocol

from skiros2_common.core.changeset import ChangeSet
from skiros2_common.core.names import id_order, local_name
from skiros2_common.core.operations import RESET, SCENE, Change
from skiros2_common.core.world_element import Element
from skiros2_world_model.core.replica import apply_change
from skiros2_world_model.core.scene import ROOT, ChangeInfo, ElementRecord, Scene

#: The parent of elements that nothing contains.
UNPLACED = "(held by nothing)"
#: The parent of the scene's root and of `UNPLACED`.
TOP = ""

_CONTAINS = "skiros:contain"


@dataclass
class SceneUpdate:
    """The effect of changes.

    :param elements: the ids of added, removed and changed elements; changed relations count.
    :param by_change: the change itself, by snapshot id, for changes of the requested author.
    :param by_others: the changes of other authors, in order.
    """

    elements: dict[str, None] = field(default_factory=dict)
    by_change: dict[str, ChangeSet] = field(default_factory=dict)
    by_others: list[ChangeSet] = field(default_factory=list)


class TreeView(Protocol):
    """The view of the tree."""

    def begin_layout(self) -> None:
        """Called before elements are added, removed or moved in the tree."""

    def end_layout(self) -> None: ...

    def elements_changed(self, ids: Iterable[str]) -> None:
        """The content of elements has changed."""


class SceneHierarchy:
    """The elements of a scene as a tree. An element is listed once: below its container, or else its owner.

    Other elements are listed below `UNPLACED`; parts of a skill below the skill. Parents and children are cached until
    the tree changes.

    :param elements: all elements, with their outgoing relations.
    :param spatial: the relations from a parent to a child.
    :param parts: the relations from a skill to its parts.
    :ivar newest: the number of the last change of any of the elements; removals are not known.
    """

    def __init__(
        self, elements: Iterable[Element], spatial: frozenset[str], parts: frozenset[str] = frozenset()
    ) -> None:
        self.scene = Scene()
        self.spatial = spatial
        self.parts = parts
        self.view: TreeView | None = None
        self._snapshot = ""  # after the last applied change
        self._parents: dict[str, str] = {}
        self._children: dict[str, list[str]] = {}
        self._rows: dict[str, int] = {}
        elements = list(elements)
        for element in elements:
            change_info = ChangeInfo(max(element.version, 0), element.getLastUpdate().timestamp())
            self.scene.put(ElementRecord(element.id, element.type, element.label, element.property_view, change_info))
        for element in elements:
            for relation in element.relation_view:
                if relation["src"] == "-1":
                    self.scene.relate(element.id, relation["type"], relation["dst"])
        self.newest = max((element.version for element in elements), default=0)
        self._unplaced = {record.id for record in self.scene if self._find_parent(record.id) == UNPLACED}

    def __len__(self) -> int:
        return len(self.scene)

    # -- the tree ----------------------------------------------------------------------------------------------

    def parent(self, eid: str) -> str:
        """Returns the parent of an element."""
        if eid not in self._parents:
            self._parents[eid] = self._find_parent(eid)
        return self._parents[eid]

    def children(self, eid: str) -> Sequence[str]:
        """Returns the children of an element, sorted."""
        known = self._children.get(eid)
        if known is None:
            known = self._children[eid] = sorted(self._find_children(eid), key=_order)
            self._parents.update((child, eid) for child in known)
            self._rows.update((child, row) for row, child in enumerate(known))
        return known

    def row(self, eid: str) -> int:
        """Returns the row of an element below its parent; -1 if it is not in the tree."""
        self.children(self.parent(eid))
        return self._rows.get(eid, -1)

    def has_children(self, eid: str) -> bool:
        """Returns whether an element has children."""
        return bool(self.children(eid))

    def is_shown(self, eid: str) -> bool:
        """Returns whether an element is in the tree."""
        return eid in self._rows or eid == UNPLACED or eid in self.scene

    def path(self, eid: str) -> list[str]:
        """Returns the ancestors of an element, the topmost first."""
        path = [eid]
        while (above := self.parent(path[0])) not in (TOP, *path):
            path.insert(0, above)
        return path[:-1]

    def holders(self, eid: str) -> list[tuple[str, str]]:
        """Returns the spatial relations to an element and their subjects; that of the tree first."""
        found = [(pred, src) for src, pred, _ in self.scene.relations("", self.spatial, eid) if src in self.scene]
        return sorted(found, key=lambda pair: (pair[0] != _CONTAINS, pair[0], id_order(pair[1])))

    def below(self, eid: str) -> list[str]:
        """Returns an element and its descendants."""
        found = {eid: None}
        for one in (order := [eid]):
            order += [child for child in self.children(one) if child not in found]
            found.update(dict.fromkeys(order))
        return order

    def find(self, text: str, most: int = 1000) -> list[str]:
        """Returns the elements whose id, label or values contain all words of a text, sorted by id.

        :param most: the most elements.
        """
        words = text.lower().split()
        found = [record.id for record in self.scene if all(map(_text(record).__contains__, words))] if words else []
        return sorted(found, key=id_order)[:most]

    # -- changes -----------------------------------------------------------------------------------------------

    def follow(self, changes: Iterable[Change], author: str = "") -> SceneUpdate | None:
        """Applies changes and notifies the view.

        :param author: the author whose changes are returned.
        :returns: None if a change is missing, or the scene was replaced: it has to be read again.
        """
        update, is_moved = SceneUpdate(), False
        for change in changes:
            if not self._snapshot and change.number <= self.newest:
                continue  # contained in the elements read
            if change.action == RESET or (self._snapshot and change.prev_snapshot_id != self._snapshot):
                return None
            self._snapshot = change.snapshot_id
            if change.context not in ("", SCENE) or not (change.elements or change.relations):
                continue
            change_set = apply_change(self.scene, change)
            update.elements.update(change_set.ids())
            is_moved |= bool(change_set.relations) or any(None in pair for pair in change_set.records.values())
            if change.author == author:
                update.by_change[change.snapshot_id] = change_set
            else:
                update.by_others.append(change_set)
        if is_moved:
            self._change_tree(list(update.elements))
        if self.view is not None:
            self.view.elements_changed(update.elements)
        return update

    def _change_tree(self, changed: list[str]) -> None:
        """Clears the cached tree. The view reads the old one until `begin_layout` has returned."""
        if self.view is not None:
            self.view.begin_layout()
        self._parents.clear()
        self._children.clear()
        self._rows.clear()
        # The parents of a skill's parts depend on its parent.
        parts = [part for eid in changed for pred in self.parts for part in self.scene.targets(eid, pred)]
        for eid in [*changed, *parts]:
            if eid in self.scene and self._find_parent(eid) == UNPLACED:
                self._unplaced.add(eid)
            else:
                self._unplaced.discard(eid)
        if self.view is not None:
            self.view.end_layout()

    # -- parents and children ----------------------------------------------------------------------------------

    def _find_parent(self, eid: str) -> str:
        """Returns the parent of an element according to its relations."""
        if eid in (ROOT, UNPLACED):
            return TOP
        holders = [(pred, src) for pred, src in self.holders(eid) if src != eid]
        if holders:
            return holders[0][1]
        skills = [src for src, _, _ in self.scene.relations("", self.parts, eid) if self._is_on_top(src, eid)]
        return min(skills, key=id_order, default=UNPLACED)

    def _is_on_top(self, eid: str, part: str) -> bool:
        """Returns whether an element is directly below `UNPLACED`."""
        if eid in (part, ROOT) or eid not in self.scene:
            return False
        holders = (src for src, _, _ in self.scene.relations("", self.spatial | self.parts, eid))
        return not any(src in self.scene and src != eid for src in holders)

    def _find_children(self, eid: str) -> Iterator[str]:
        if eid == TOP:
            yield from (ROOT, UNPLACED) if ROOT in self.scene else (UNPLACED,)
        elif eid == UNPLACED:
            yield from self._unplaced
        else:
            below = {dst for _, _, dst in self.scene.relations(eid, self.spatial | self.parts) if dst in self.scene}
            yield from (child for child in below if self.parent(child) == eid)


def _order(eid: str) -> tuple[bool, str, int]:
    name, number = id_order(eid)
    return eid == UNPLACED, local_name(name).lower(), number


def _text(record: ElementRecord) -> str:
    """Returns the text of an element to search in."""
    values = (v for prop in record.properties.values() for v in prop.values if isinstance(v, str))
    return " ".join((record.id, record.label, *values)).lower()
