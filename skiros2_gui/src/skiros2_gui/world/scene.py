"""The window's own copy of the scene, and the tree that it makes along what places one element in another.

Made whole in a worker thread, then used by the Qt thread alone: nothing that is asked of it waits for anybody.
"""

from __future__ import annotations

import bisect
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Protocol

from skiros2_common.core.names import id_order, local_name
from skiros2_common.core.world_element import Element
from skiros2_gui.world.revert import recorded_change
from skiros2_world_model.core.apply_change import apply_change
from skiros2_world_model.core.changes import REMOVE, REMOVE_RECURSIVE, RESET, SCENE, Change
from skiros2_world_model.core.history_entry import HistoryEntry
from skiros2_world_model.core.scene import ROOT, ElementRecord, Provenance, Scene

#: The tree's node that everything is under which nothing holds.
UNPLACED = "(held by nothing)"
#: What the root of the scene and `UNPLACED` are under.
TOP = ""

#: When more elements than this come, go or move in one change, the tree is shown anew.
_MANY_MOVES = 500
_CONTAINS = "skiros:contain"


@dataclass
class SceneUpdate:
    """What changes have made other.

    :param elements: the ids of elements whose content or relations are other, also new and gone ones.
    :param by_change: what each of some changes made other, by the change's snapshot id.
    """

    elements: dict[str, None] = field(default_factory=dict)
    by_change: dict[str, HistoryEntry] = field(default_factory=dict)


class TreeView(Protocol):
    """Who shows the tree. Each call of the first three is followed by `done` when the tree has become so."""

    def begin_insert(self, parent: str, row: int) -> None: ...
    def begin_remove(self, parent: str, row: int) -> None: ...
    def begin_reset(self) -> None: ...
    def end(self) -> None: ...
    def element_changed(self, eid: str) -> None:
        """What is shown of an element is other; its place is the same."""

    def changes_ended(self) -> None:
        """These were all changes for now."""


class SceneHierarchy:
    """The elements of a scene as a tree. An element is shown once: under what contains it, else under what has it.

    What is nowhere is shown under `UNPLACED`; of that, what describes a skill under the skill.

    :param elements: all elements, with their outgoing relations.
    :param spatial: the relations that place their object in their subject.
    :param parts: the relations that lead from a skill to what describes it.
    """

    def __init__(
        self, elements: Iterable[Element], spatial: frozenset[str], parts: frozenset[str] = frozenset()
    ) -> None:
        self.scene = Scene()
        self.spatial = spatial
        self.parts = parts
        self._downwards = spatial | parts
        self.view: TreeView | None = None
        self._snapshot = ""  # the state after the last change that was followed
        self._places: dict[str, str] = {}  # what the elements that are in `_children` are shown under
        self._children: dict[str, list[tuple[tuple[int, str, int], str]]] = {}
        self._orders: dict[str, tuple[int, str, int]] = {}  # what sorts the elements among their siblings
        self._texts = SearchTexts()
        self._moving: set[str] = set()  # what is still to be put in its place, while a change is followed
        elements = list(elements)
        for element in elements:
            made = Provenance(max(element.version, 0), element.getLastUpdate().timestamp())
            self.scene.put(ElementRecord(element.id, element.type, element.label, element._props, made))
        for element in elements:
            for relation in element._rels:
                if relation["src"] == "-1":
                    self.scene.relate(element.id, relation["type"], relation["dst"])
        self._texts.find(" ", self.scene)
        self._newest = max((element.version for element in elements), default=0)
        self._unplaced = {node.id for node in self.scene if self._parent(node.id) == UNPLACED}

    def __len__(self) -> int:
        return len(self.scene)

    # -- the tree ----------------------------------------------------------------------------------------------

    def parent(self, eid: str) -> str:
        """What an element is shown under."""
        known = self._places.get(eid)
        return known if known is not None else TOP if eid == UNPLACED else self._parent(eid)

    def children(self, eid: str) -> Sequence[str]:
        """What is shown under an element, in order."""
        return _Ids(self._sorted_children(eid))

    def count(self, eid: str) -> int:
        """How many are shown under an element."""
        return len(self._sorted_children(eid))

    def child(self, eid: str, row: int) -> str:
        """What is shown in a row under an element."""
        return self._sorted_children(eid)[row][1]

    def row(self, eid: str) -> int:
        """In which row an element is shown under its parent; -1 when it is not shown."""
        siblings = self._sorted_children(self.parent(eid))
        key = self._order(eid)
        row = bisect.bisect_left(siblings, (key, eid))
        return row if row < len(siblings) and siblings[row][1] == eid else -1

    def has_children(self, eid: str) -> bool:
        """Whether something is shown under an element."""
        if eid in (TOP, UNPLACED) or eid in self._children:
            return bool(self._sorted_children(eid))
        for pred in self._downwards:
            for dst in self.scene.targets(eid, pred):
                if dst in self.scene and dst not in self._moving and self._parent(dst) == eid:
                    return True
        return False

    def is_shown(self, eid: str) -> bool:
        """Whether it is a node of the tree."""
        return eid == UNPLACED or eid in self.scene or eid in self._places

    def path(self, eid: str) -> list[str]:
        """What an element is shown under, the topmost first; without itself."""
        path = [eid]
        while (above := self.parent(path[0])) not in (TOP, *path):
            path.insert(0, above)
        return path[:-1]

    def holders(self, eid: str) -> list[tuple[str, str]]:
        """The relations that place an element, and the elements that they place it in; that of the tree first."""
        found = [(pred, src) for src, pred, _ in self.scene.relations("", self.spatial, eid) if src in self.scene]
        return sorted(found, key=lambda pair: (pair[0] != _CONTAINS, pair[0], id_order(pair[1])))

    def below(self, eid: str) -> list[str]:
        """An element and all that is under it in the tree."""
        found = [eid]
        seen = {eid}
        for one in found:
            fresh = [child for child in self.children(one) if child not in seen]
            seen.update(fresh)
            found += fresh
        return found

    def find(self, text: str, most: int = 1000) -> list[str]:
        """The elements that have all words of a text in their id, label or a value, in the order of their ids.

        :param most: so many at most.
        """
        return self._texts.find(text, self.scene)[:most]

    # -- changes -----------------------------------------------------------------------------------------------

    def follow(self, changes: Iterable[Change], wanted: str = "") -> SceneUpdate | None:
        """Makes what some changes tell, in their order, and tells the view.

        :param wanted: what each change of this author made other is noted.
        :returns: None when one is missing, or the scene was replaced: it must be read anew.
        """
        update = SceneUpdate()
        for change in changes:
            if not self._snapshot and change.number <= self._newest:
                continue  # what was read has it
            if change.action == RESET or (self._snapshot and change.prev_snapshot_id != self._snapshot):
                return None
            self._snapshot = change.snapshot_id
            if change.context not in ("", SCENE) or not (change.elements or change.relations):
                continue
            affected = self._affected(change)
            before = {eid: self.scene.record(eid) for eid in affected}
            relations = self._relations(affected) if change.author == wanted else set()
            self._apply(change, affected)
            update.elements.update(affected)
            if change.author == wanted:
                after = {eid: self.scene.record(eid) for eid in affected}
                made = recorded_change(change, before, after, relations, self._relations(affected))
                update.by_change[change.snapshot_id] = made
        if self.view is not None:
            self.view.changes_ended()
        return update

    def _apply(self, change: Change, affected: dict[str, None]) -> None:
        places = {eid: (self.parent(eid), len(self.path(eid))) for eid in affected if eid in self.scene}
        apply_change(self.scene, change)
        moves = [e for e in affected if (self._parent(e) if e in self.scene else TOP) != places.get(e, (TOP, 0))[0]]
        if len(moves) > _MANY_MOVES:
            self._reset_order(moves)
        else:
            self._moving = set(moves)
            # What is under an element goes before it, and comes after it.
            for eid in sorted(moves, key=lambda e: -places.get(e, (TOP, 0))[1]):
                if eid in places:
                    self._take_out(eid, places[eid][0])
            for eid in sorted((e for e in moves if e in self.scene), key=self._depth):
                self._put_in(eid)
            self._moving.clear()
        if self.view is not None:
            for eid in affected:
                if eid in self.scene:
                    self.view.element_changed(eid)

    def _reset_order(self, moves: Iterable[str]) -> None:
        """Forgets the order of the tree, which is made anew as it is asked for."""
        if self.view is not None:
            self.view.begin_reset()
        self._children.clear()
        self._places.clear()
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
        self._places.pop(eid, None)
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
                self._places[eid] = parent
                if self.view is not None:
                    self.view.end()
        if self.view is not None:
            self.view.element_changed(parent)

    def _depth(self, eid: str) -> int:
        """How deep an element is in the tree as its relations make it."""
        above = [eid]
        while (parent := self._parent(above[-1])) not in (TOP, UNPLACED, *above):
            above.append(parent)
        return len(above)

    def _affected(self, change: Change) -> dict[str, None]:
        """The elements that a change makes other, the ends of the relations that come and go among them."""
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
        for eid in list(affected):  # where its parts are shown depends on where it is
            affected.update((dst, None) for pred in self.parts for dst in self.scene.targets(eid, pred))
        return affected

    def _relations(self, elements: Iterable[str]) -> set[tuple[str, str, str]]:
        return {r for eid in elements for r in [*self.scene.relations(eid), *self.scene.relations(dst=eid)]}

    # -- the tree's order --------------------------------------------------------------------------------------

    def _parent(self, eid: str) -> str:
        """What an element is shown under, from its relations."""
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
        """Whether an element is directly under `UNPLACED`, so that a part of it can be shown under it."""
        if eid in (part, ROOT) or eid not in self.scene:
            return False
        holders = (src for src, _, _ in self.scene.relations("", self._downwards, eid))
        return not any(src in self.scene and src != eid for src in holders)

    def _sorted_children(self, eid: str) -> list[tuple[tuple[int, str, int], str]]:
        known = self._children.get(eid)
        if known is None:
            known = self._children[eid] = sorted((self._order(child), child) for child in self._found_children(eid))
            self._places.update((child, eid) for _, child in known)
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
    """The ids of a sorted list of children."""

    def __init__(self, children: list[tuple[tuple[int, str, int], str]]) -> None:
        self._children = children

    def __len__(self) -> int:
        return len(self._children)

    def __getitem__(self, row):  # type: ignore[no-untyped-def]
        return self._children[row][1]


class SearchTexts:
    """What the elements of a scene are found by: of each one text, made anew when the element is another."""

    def __init__(self) -> None:
        self._texts: dict[str, tuple[ElementRecord, str]] = {}

    def find(self, text: str, nodes: Iterable[ElementRecord]) -> list[str]:
        """Of some elements those that have all words of a text, in the order of their ids; none for no words."""
        words = text.lower().split()
        found = [node.id for node in nodes if all(map(self._text(node).__contains__, words))]
        return sorted(found, key=id_order) if words else []

    def forget(self, eid: str) -> None:
        """There is no such element any more."""
        self._texts.pop(eid, None)

    def _text(self, node: ElementRecord) -> str:
        known = self._texts.get(node.id)
        if known is None or known[0] is not node:
            values = (str(v) for prop in node.properties.values() for v in prop.values if isinstance(v, str))
            known = self._texts[node.id] = node, " ".join((node.id, node.label, *values)).lower()
        return known[1]
