"""The window's copy of the scene as a tree of spatial relations.

Built by a worker thread, then used by the Qt thread only; no call blocks.
"""

from __future__ import annotations

import bisect
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Protocol

from skiros2_common.core.names import id_order, local_name
from skiros2_common.core.world_element import Element
from skiros2_world_model.core.changes import REMOVE, REMOVE_RECURSIVE, RESET, SCENE, Change
from skiros2_world_model.core.changeset import ChangeSet
from skiros2_world_model.core.replica import apply_change
from skiros2_world_model.core.scene import ROOT, ElementRecord, Provenance, Scene

#: The parent of elements that nothing contains.
UNPLACED = "(held by nothing)"
#: The parent of the scene's root and of `UNPLACED`.
TOP = ""

#: If one change moves more elements, the view is reset.
_MANY_MOVES = 500
_CONTAINS = "skiros:contain"


@dataclass
class SceneUpdate:
    """The effect of changes.

    :param elements: the ids of added, removed and changed elements; changed relations count.
    :param by_change: the change itself, by snapshot id, for changes of the requested author.
    """

    elements: dict[str, None] = field(default_factory=dict)
    by_change: dict[str, ChangeSet] = field(default_factory=dict)


class TreeView(Protocol):
    """The view of the tree. `end` follows each of the `begin` calls once the tree has changed."""

    def begin_insert(self, parent: str, row: int) -> None: ...
    def begin_remove(self, parent: str, row: int) -> None: ...
    def begin_reset(self) -> None: ...
    def end(self) -> None: ...
    def element_changed(self, eid: str) -> None:
        """The content of an element has changed, but not its position."""

    def changes_ended(self) -> None:
        """Called after a series of changes."""


class SceneHierarchy:
    """The elements of a scene as a tree. An element is listed once: below its container, or else its owner.

    Other elements are listed below `UNPLACED`; parts of a skill below the skill.

    :param elements: all elements, with their outgoing relations.
    :param spatial: the relations from a parent to a child.
    :param parts: the relations from a skill to its parts.
    """

    def __init__(
        self, elements: Iterable[Element], spatial: frozenset[str], parts: frozenset[str] = frozenset()
    ) -> None:
        self.scene = Scene()
        self.spatial = spatial
        self.parts = parts
        self._downwards = spatial | parts
        self.view: TreeView | None = None
        self._snapshot = ""  # after the last applied change
        self._parents: dict[str, str] = {}  # the parents of the elements in `_children`
        self._children: dict[str, list[tuple[tuple[int, str, int], str]]] = {}
        self._orders: dict[str, tuple[int, str, int]] = {}  # sort keys
        self._texts = SearchTexts()
        self._moving: set[str] = set()  # not inserted yet, while a change is applied
        elements = list(elements)
        for element in elements:
            provenance = Provenance(max(element.version, 0), element.getLastUpdate().timestamp())
            self.scene.put(ElementRecord(element.id, element.type, element.label, element._props, provenance))
        for element in elements:
            for relation in element._rels:
                if relation["src"] == "-1":
                    self.scene.relate(element.id, relation["type"], relation["dst"])
        self._texts.find(" ", self.scene)
        self._newest = max((element.version for element in elements), default=0)
        self._unplaced = {record.id for record in self.scene if self._parent(record.id) == UNPLACED}

    def __len__(self) -> int:
        return len(self.scene)

    # -- the tree ----------------------------------------------------------------------------------------------

    def parent(self, eid: str) -> str:
        """Returns the parent of an element."""
        known = self._parents.get(eid)
        return known if known is not None else TOP if eid == UNPLACED else self._parent(eid)

    def children(self, eid: str) -> Sequence[str]:
        """Returns the children of an element, sorted."""
        return _Ids(self._sorted_children(eid))

    def count(self, eid: str) -> int:
        """Returns the number of children."""
        return len(self._sorted_children(eid))

    def child(self, eid: str, row: int) -> str:
        """Returns the child in a row."""
        return self._sorted_children(eid)[row][1]

    def row(self, eid: str) -> int:
        """Returns the row of an element below its parent; -1 if it is not in the tree."""
        siblings = self._sorted_children(self.parent(eid))
        key = self._order(eid)
        row = bisect.bisect_left(siblings, (key, eid))
        return row if row < len(siblings) and siblings[row][1] == eid else -1

    def has_children(self, eid: str) -> bool:
        """Returns whether an element has children."""
        if eid in (TOP, UNPLACED) or eid in self._children:
            return bool(self._sorted_children(eid))
        for pred in self._downwards:
            for dst in self.scene.targets(eid, pred):
                if dst in self.scene and dst not in self._moving and self._parent(dst) == eid:
                    return True
        return False

    def is_shown(self, eid: str) -> bool:
        """Returns whether an element is in the tree."""
        return eid == UNPLACED or eid in self.scene or eid in self._parents

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
        found = [eid]
        seen = {eid}
        for one in found:
            fresh = [child for child in self.children(one) if child not in seen]
            seen.update(fresh)
            found += fresh
        return found

    def find(self, text: str, most: int = 1000) -> list[str]:
        """Returns the elements whose id, label or values contain all words of a text, sorted by id.

        :param most: the most elements.
        """
        return self._texts.find(text, self.scene)[:most]

    # -- changes -----------------------------------------------------------------------------------------------

    def follow(self, changes: Iterable[Change], author: str = "") -> SceneUpdate | None:
        """Applies changes and notifies the view.

        :param author: the author whose changes are returned.
        :returns: None if a change is missing, or the scene was replaced: it has to be read again.
        """
        update = SceneUpdate()
        for change in changes:
            if not self._snapshot and change.number <= self._newest:
                continue  # contained in the elements read
            if change.action == RESET or (self._snapshot and change.prev_snapshot_id != self._snapshot):
                return None
            self._snapshot = change.snapshot_id
            if change.context not in ("", SCENE) or not (change.elements or change.relations):
                continue
            affected = self._affected(change)
            change_set = self._apply(change, affected)
            update.elements.update(affected)
            if change.author == author:
                update.by_change[change.snapshot_id] = change_set
        if self.view is not None:
            self.view.changes_ended()
        return update

    def _apply(self, change: Change, affected: dict[str, None]) -> ChangeSet:
        parents = {eid: (self.parent(eid), len(self.path(eid))) for eid in affected if eid in self.scene}
        change_set = apply_change(self.scene, change)
        moves = [e for e in affected if (self._parent(e) if e in self.scene else TOP) != parents.get(e, (TOP, 0))[0]]
        if len(moves) > _MANY_MOVES:
            self._reset_order(moves)
        else:
            self._moving = set(moves)
            # Children are removed before, and inserted after, their parents.
            for eid in sorted(moves, key=lambda e: -parents.get(e, (TOP, 0))[1]):
                if eid in parents:
                    self._take_out(eid, parents[eid][0])
            for eid in sorted((e for e in moves if e in self.scene), key=self._depth):
                self._put_in(eid)
            self._moving.clear()
        if self.view is not None:
            for eid in affected:
                if eid in self.scene:
                    self.view.element_changed(eid)
        return change_set

    def _reset_order(self, moves: Iterable[str]) -> None:
        """Clears the sorted children, which are rebuilt on demand."""
        if self.view is not None:
            self.view.begin_reset()
        self._children.clear()
        self._parents.clear()
        for eid in moves:
            if eid in self.scene and self._parent(eid) == UNPLACED:
                self._unplaced.add(eid)
            else:
                self._unplaced.discard(eid)
        if self.view is not None:
            self.view.end()

    def _take_out(self, eid: str, parent: str) -> None:
        siblings = self._children.get(parent)
        entry = self._order(eid), eid
        row = bisect.bisect_left(siblings, entry) if siblings is not None else 0
        if siblings is not None and row < len(siblings) and siblings[row] == entry:
            if self.view is not None:
                self.view.begin_remove(parent, row)
            del siblings[row]
            if self.view is not None:
                self.view.end()
        self._unplaced.discard(eid)
        self._parents.pop(eid, None)
        if eid not in self.scene:
            self._children.pop(eid, None)
            self._orders.pop(eid, None)
            self._texts.forget(eid)

    def _put_in(self, eid: str) -> None:
        parent = self._parent(eid)
        self._moving.discard(eid)
        if parent == UNPLACED:
            self._unplaced.add(eid)
        siblings = self._children.get(parent)
        entry = self._order(eid), eid
        if siblings is not None:
            row = bisect.bisect_left(siblings, entry)
            if row == len(siblings) or siblings[row] != entry:
                if self.view is not None:
                    self.view.begin_insert(parent, row)
                siblings.insert(row, entry)
                self._parents[eid] = parent
                if self.view is not None:
                    self.view.end()
        if self.view is not None:
            self.view.element_changed(parent)

    def _depth(self, eid: str) -> int:
        """Returns the depth of an element according to its relations."""
        above = [eid]
        while (parent := self._parent(above[-1])) not in (TOP, UNPLACED, *above):
            above.append(parent)
        return len(above)

    def _affected(self, change: Change) -> dict[str, None]:
        """Returns the elements that a change affects, including the ends of changed relations."""
        affected = dict.fromkeys(element.id for element in change.elements)
        for element in change.elements:
            eid = element.id
            before = {*self.scene.relations(eid), *self.scene.relations(dst=eid)}
            after: set[tuple[str, str, str]] = set()
            if change.action not in (REMOVE, REMOVE_RECURSIVE):
                ends = ((eid if r[side] == "-1" else r[side] for side in ("src", "type", "dst")) for r in element._rels)
                after = {(src, pred, dst) for src, pred, dst in ends}
            for src, _, dst in before ^ after:
                affected.update({src: None, dst: None})
        for relation in change.relations:
            affected.update({relation["src"]: None, relation["dst"]: None})
        for eid in list(affected):  # the parents of its parts depend on its parent
            affected.update((dst, None) for pred in self.parts for dst in self.scene.targets(eid, pred))
        return affected

    # -- the tree's order --------------------------------------------------------------------------------------

    def _parent(self, eid: str) -> str:
        """Computes the parent of an element from its relations."""
        if eid == ROOT:
            return TOP
        best: tuple[bool, str, tuple[str, int]] | None = None
        holder = UNPLACED
        for src, pred, _ in self.scene.relations("", self.spatial, eid):
            key = (pred != _CONTAINS, pred, id_order(src))
            if src in self.scene and src != eid and (best is None or key < best):
                best, holder = key, src
        if best is None:
            skills = [src for src, _, _ in self.scene.relations("", self.parts, eid) if self._is_on_top(src, eid)]
            holder = min(skills, key=id_order, default=UNPLACED)
        return holder

    def _is_on_top(self, eid: str, part: str) -> bool:
        """Returns whether an element is directly below `UNPLACED`."""
        if eid in (part, ROOT) or eid not in self.scene:
            return False
        holders = (src for src, _, _ in self.scene.relations("", self._downwards, eid))
        return not any(src in self.scene and src != eid for src in holders)

    def _sorted_children(self, eid: str) -> list[tuple[tuple[int, str, int], str]]:
        known = self._children.get(eid)
        if known is None:
            known = self._children[eid] = sorted((self._order(child), child) for child in self._found_children(eid))
            self._parents.update((child, eid) for _, child in known)
        return known

    def _found_children(self, eid: str) -> Iterator[str]:
        if eid == TOP:
            if ROOT in self.scene:
                yield ROOT
            yield UNPLACED
        elif eid == UNPLACED:
            yield from self._unplaced
        else:
            below = {dst for _, _, dst in self.scene.relations(eid, self._downwards) if dst in self.scene}
            yield from (child for child in below - self._moving if self._parent(child) == eid)

    def _order(self, eid: str) -> tuple[int, str, int]:
        known = self._orders.get(eid)
        if known is None:
            name, number = id_order(eid)
            known = self._orders[eid] = (1, "", 0) if eid == UNPLACED else (0, local_name(name).lower(), number)
        return known


class _Ids(Sequence[str]):
    """The ids of a list of children."""

    def __init__(self, children: list[tuple[tuple[int, str, int], str]]) -> None:
        self._children = children

    def __len__(self) -> int:
        return len(self._children)

    def __getitem__(self, row):  # type: ignore[no-untyped-def]
        return self._children[row][1]


class SearchTexts:
    """The search texts of the elements, cached."""

    def __init__(self) -> None:
        self._texts: dict[str, tuple[ElementRecord, str]] = {}

    def find(self, text: str, records: Iterable[ElementRecord]) -> list[str]:
        """Returns the elements that contain all words of a text, sorted by id; none without words."""
        words = text.lower().split()
        found = [record.id for record in records if all(map(self._text(record).__contains__, words))]
        return sorted(found, key=id_order) if words else []

    def forget(self, eid: str) -> None:
        """Removes an element."""
        self._texts.pop(eid, None)

    def _text(self, record: ElementRecord) -> str:
        known = self._texts.get(record.id)
        if known is None or known[0] is not record:
            values = (str(v) for prop in record.properties.values() for v in prop.values if isinstance(v, str))
            known = self._texts[record.id] = record, " ".join((record.id, record.label, *values)).lower()
        return known[1]
