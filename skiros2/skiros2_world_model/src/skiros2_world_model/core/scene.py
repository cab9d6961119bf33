"""The scene: an index of elements that answers every lookup from dictionaries.

Elements by id, relations both ways by predicate, ids by type and by label. It knows no ontology and checks nothing; the
world model does that before it calls. The same index is the server's truth and a client's replica.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any

from skiros2_common.core.property import Property
from skiros2_common.core.world_element import Element, RelationDict

#: The element that everything in a scene hangs on.
ROOT = "skiros:Scene-0"

_NUMBER = re.compile(r"-(\d+)$")

#: One direction of the relations: name -> predicate -> other name -> the relation as a dict, once it was read.
_Links = dict[str, dict[str, dict[str, "RelationDict | None"]]]
_NOTHING: dict[str, dict[str, RelationDict | None]] = {}


def id_number(eid: str) -> int:
    """The number at the end of an id, or -1."""
    found = _NUMBER.search(eid)
    return int(found.group(1)) if found else -1


@dataclass(frozen=True, slots=True)
class Provenance:
    """The change that made something so: its number, when it was (s since the epoch), and who asked for it."""

    version: int = 0
    stamp: float = 0.0
    author: str = ""


_UNKNOWN = Provenance()


@dataclass(frozen=True, slots=True)
class Node:
    """What the scene holds of one element. Never changed: a change puts another node in its place."""

    id: str
    type: str
    label: str
    properties: dict[str, Property]
    made: Provenance = _UNKNOWN


@dataclass
class Dirty:
    """What was touched since somebody looked: ids of elements, and relations."""

    nodes: set[str] = field(default_factory=set)
    relations: set[tuple[str, str, str]] = field(default_factory=set)


class Scene:
    """The index. Its owner holds a lock while it is read or changed.

    A change can be taken back: after `begin`, `roll_back` restores what was there, `commit` keeps what is.

    :param dirty: notes what is touched, for one who mirrors the scene.
    """

    def __init__(self, dirty: Dirty | None = None) -> None:
        self.dirty = dirty
        self._nodes: dict[str, Node] = {}
        self._out: _Links = {}
        self._in: _Links = {}
        self._by_type: dict[str, dict[str, None]] = {}
        self._by_label: dict[str, dict[str, None]] = {}
        self._numbers: dict[int, int] = {}
        self._next_number = 0
        self._relation_cache: dict[str, tuple[RelationDict, ...]] = {}
        self._undo: list[Callable[[], None]] | None = None
        self._touched: dict[str, bool] = {}  # whether it is more than the subject of another relation

    # -- elements ----------------------------------------------------------------------------------------------

    def __len__(self) -> int:
        return len(self._nodes)

    def __contains__(self, eid: object) -> bool:
        return eid in self._nodes

    def __iter__(self) -> Iterator[Node]:
        return iter(self._nodes.values())

    def node(self, eid: str) -> Node | None:
        return self._nodes.get(eid)

    def element(self, eid: str) -> Element | None:
        """The element as others get it: its content is shared until they change it."""
        node = self._nodes.get(eid)
        if node is None:
            return None
        element = Element.shared(node.type, node.label, eid, node.properties, self.relations_of(eid), node.made.version)
        element._last_update = node.made.stamp
        return element

    def types(self) -> list[str]:
        """The classes that have elements."""
        return list(self._by_type)

    def of_type(self, etype: str) -> Iterable[str]:
        """The ids of the elements of exactly that class."""
        return self._by_type.get(etype, ())

    def of_label(self, label: str) -> Iterable[str]:
        """The ids of the elements with that label."""
        return self._by_label.get(label, ())

    def put(self, node: Node) -> None:
        """Adds an element, or puts new content in the place of the old; relations stay."""
        before = self._nodes.get(node.id)
        self._place(node.id, node)
        if self._undo is not None:
            self._undo.append(lambda: self._place(node.id, before))

    def drop(self, eid: str) -> None:
        """Removes an element with all relations from and to it."""
        for src, pred, dst in list(self.relations(eid)):
            self.unrelate(src, pred, dst)
        for src, pred, dst in list(self.relations(dst=eid)):
            self.unrelate(src, pred, dst)
        before = self._nodes[eid]
        self._place(eid, None)
        if self._undo is not None:
            self._undo.append(lambda: self._place(eid, before))

    def free_id(self, etype: str, desired: int = -1) -> str:
        """An id for a new element: with the desired number (from 0) if that is free, else with the next free one."""
        number = desired if desired >= 0 else self._next_number
        if number in self._numbers and len(self._numbers) >= self._next_number:
            number = self._next_number  # all below are taken
        while number in self._numbers:
            number += 1
        return f"{etype}-{number}"

    # -- relations ---------------------------------------------------------------------------------------------

    def relations_of(self, eid: str) -> tuple[RelationDict, ...]:
        """The relations of an element as dicts, outgoing and incoming; "-1" stands for the element."""
        cached = self._relation_cache.get(eid)
        if cached is None:
            relations: list[RelationDict] = []
            for pred, others in self._out.get(eid, _NOTHING).items():
                for dst, relation in others.items():
                    if relation is None:
                        relation = others[dst] = _relation("-1", pred, dst)
                    relations.append(relation)
            for pred, others in self._in.get(eid, _NOTHING).items():
                for src, relation in others.items():
                    if relation is None:
                        relation = others[src] = _relation(src, pred, "-1")
                    relations.append(relation)
            cached = self._relation_cache[eid] = tuple(relations)
        return cached

    def related(self, src: str, pred: str, dst: str) -> bool:
        """Whether there is exactly that relation."""
        return dst in self._out.get(src, _NOTHING).get(pred, ())

    def predicates(self) -> set[str]:
        """The predicates of all relations."""
        return {pred for links in self._out.values() for pred in links}

    def targets(self, src: str, pred: str) -> Iterable[str]:
        """What an element is related to by exactly that predicate."""
        return self._out.get(src, _NOTHING).get(pred, ())

    def sources(self, pred: str, dst: str) -> Iterable[str]:
        """What is related to an element by exactly that predicate."""
        return self._in.get(dst, _NOTHING).get(pred, ())

    def relations(
        self, src: str = "", preds: Iterable[str] | None = None, dst: str = ""
    ) -> Iterator[tuple[str, str, str]]:
        """The relations with that subject, one of those predicates, and that object; "" and None match any."""
        wanted = None if preds is None else set(preds)
        if src:
            for pred, others in self._out.get(src, _NOTHING).items():
                if wanted is None or pred in wanted:
                    if not dst:
                        for other in others:
                            yield src, pred, other
                    elif dst in others:
                        yield src, pred, dst
        elif dst:
            for pred, others in self._in.get(dst, _NOTHING).items():
                if wanted is None or pred in wanted:
                    for other in others:
                        yield other, pred, dst
        else:
            for name in self._out:
                yield from self.relations(name, wanted)

    def relate(self, src: str, pred: str, dst: str) -> bool:
        """Adds a relation; False when it was there."""
        if self.related(src, pred, dst):
            return False
        self._link(src, pred, dst)
        if self._undo is not None:
            self._undo.append(lambda: self._unlink(src, pred, dst))
        return True

    def unrelate(self, src: str, pred: str, dst: str) -> bool:
        """Removes a relation; False when it was not there."""
        if not self.related(src, pred, dst):
            return False
        self._unlink(src, pred, dst)
        if self._undo is not None:
            self._undo.append(lambda: self._link(src, pred, dst))
        return True

    # -- changes as a whole ------------------------------------------------------------------------------------

    def begin(self) -> None:
        """From now on changes are noted, until `commit` or `roll_back`."""
        self._undo = []
        self._touched = {}

    def touched(self) -> list[str]:
        """The ids of what was changed since `begin`, gone elements too.

        An element that is the subject of another relation than before is not among them: its own content is the same.
        """
        return [eid for eid, more in self._touched.items() if more]

    def roll_back(self) -> None:
        """Takes back everything since `begin`."""
        undo, self._undo = self._undo or [], None
        for step in reversed(undo):
            step()
        self._touched = {}

    def commit(self, made: Provenance) -> list[str]:
        """Keeps everything since `begin`, and returns the ids of the elements whose content or relations changed."""
        self._undo = None
        touched = [eid for eid in self._touched if eid in self._nodes]
        for eid in touched:
            old = self._nodes[eid]
            self._nodes[eid] = Node(eid, old.type, old.label, old.properties, made)
        self._touched = {}
        return touched

    def clear(self) -> None:
        """Removes everything."""
        for eid in list(self._nodes):
            self.drop(eid)

    # -- the index itself --------------------------------------------------------------------------------------

    def _place(self, eid: str, node: Node | None) -> None:
        before = self._nodes.get(eid)
        if before is not None and (node is None or node.type != before.type):
            _discard(self._by_type, before.type, eid)
        if before is not None and (node is None or node.label != before.label):
            _discard(self._by_label, before.label, eid)
        if node is None:
            del self._nodes[eid]
            self._relation_cache.pop(eid, None)
            self._count(eid, -1)
        else:
            self._nodes[eid] = node
            self._by_type.setdefault(node.type, {})[eid] = None
            self._by_label.setdefault(node.label, {})[eid] = None
            if before is None:
                self._count(eid, 1)
        self._touched[eid] = True
        if self.dirty is not None:
            self.dirty.nodes.add(eid)

    def _count(self, eid: str, change: int) -> None:
        number = id_number(eid)
        if number < 0:
            return
        count = self._numbers.get(number, 0) + change
        if count:
            self._numbers[number] = count
            self._next_number = max(self._next_number, number + 1)
        else:
            del self._numbers[number]

    def _link(self, src: str, pred: str, dst: str) -> None:
        self._out.setdefault(src, {}).setdefault(pred, {})[dst] = None
        self._in.setdefault(dst, {}).setdefault(pred, {})[src] = None
        self._note_relation(src, pred, dst)

    def _unlink(self, src: str, pred: str, dst: str) -> None:
        for links, here, there in ((self._out, src, dst), (self._in, dst, src)):
            by_predicate = links[here]
            del by_predicate[pred][there]
            if not by_predicate[pred]:
                del by_predicate[pred]
                if not by_predicate:
                    del links[here]
        self._note_relation(src, pred, dst)

    def _note_relation(self, src: str, pred: str, dst: str) -> None:
        self._relation_cache.pop(src, None)
        self._relation_cache.pop(dst, None)
        self._touched.setdefault(src, False)
        self._touched[dst] = True
        if self.dirty is not None:
            self.dirty.relations.add((src, pred, dst))


def _relation(src: str, pred: str, dst: str) -> dict[str, Any]:
    return {"src": src, "type": pred, "dst": dst, "state": True, "abstract": False}


def _discard(index: dict[str, dict[str, None]], key: str, eid: str) -> None:
    del index[key][eid]
    if not index[key]:
        del index[key]
