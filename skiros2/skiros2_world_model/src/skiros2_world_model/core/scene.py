"""The scene: an index of elements that answers every lookup from dictionaries.

Elements by id, relations both ways by predicate, ids by type, by label and by the values of properties that were asked
for. It knows no ontology and checks nothing; the world model does that before it calls. The same index is the server's
truth and a client's replica.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from sys import intern
from typing import Any

from skiros2_common.core.property import Property
from skiros2_common.core.world_element import Element, RelationDict
from skiros2_world_model.core.id_index import IdIndex
from skiros2_world_model.core.id_numbers import IdNumbers
from skiros2_world_model.core.property_pool import PropertyPool
from skiros2_world_model.core.removals import Removals
from skiros2_world_model.core.value_index import ValueIndex

#: The element that everything in a scene hangs on.
ROOT = "skiros:Scene-0"

#: So many relations of an element are kept as dicts for the next read; fewer are made anew in no time.
_MANY = 20


@dataclass(frozen=True, slots=True)
class Provenance:
    """The change that made something so: its number, when it was (s since the epoch), and who asked for it."""

    version: int = 0
    stamp: float = 0.0
    author: str = ""


_UNKNOWN = Provenance()
_NO_PROPERTIES: Mapping[str, Property] = {}


@dataclass(frozen=True, slots=True)
class Node:
    """What the scene holds of one element. Never changed: a change puts another node in its place."""

    id: str
    type: str
    label: str
    properties: dict[str, Property]
    made: Provenance = _UNKNOWN

    @property
    def version(self) -> int:
        """The number of the last change."""
        return self.made.version


@dataclass
class Dirty:
    """What was touched since somebody looked: ids of elements, and relations."""

    nodes: set[str] = field(default_factory=set)
    relations: set[tuple[str, str, str]] = field(default_factory=set)


@dataclass
class Step:
    """What was changed in a scene since its `begin`, in order: elements that were put or dropped, and relations."""

    contents: dict[str, None] = field(default_factory=dict)
    relations: dict[tuple[str, str, str], None] = field(default_factory=dict)

    def elements(self) -> dict[str, None]:
        """The elements whose content or relations were changed, gone ones too."""
        return {**self.contents, **dict.fromkeys(eid for src, _, dst in self.relations for eid in (src, dst))}


class Scene:
    """The index. Its owner holds a lock while it is read or changed.

    A change can be taken back: after `begin`, `roll_back` restores what was there, `commit` keeps what is.
    """

    def __init__(self) -> None:
        self.dirty: Dirty | None = None  #: what is touched from now on, where one who mirrors the scene wants to know
        self._nodes: dict[str, Node] = {}
        self._out: dict[str, IdIndex] = {}  # by predicate: the objects of each subject
        self._in: dict[str, IdIndex] = {}  # by predicate: the subjects of each object
        self._by_type = IdIndex()
        self._by_label = IdIndex()
        self._by_value: dict[str, ValueIndex] = {}  # by property, once it was asked for
        self._numbers = IdNumbers()
        self._pool = PropertyPool()
        self._relation_cache: dict[str, tuple[RelationDict, ...]] = {}
        self._undo: list[Callable[[], None]] | None = None
        self.step = Step()
        self.removals = Removals()

    # -- elements ----------------------------------------------------------------------------------------------

    def __len__(self) -> int:
        return len(self._nodes)

    def __contains__(self, eid: object) -> bool:
        return eid in self._nodes

    def __iter__(self) -> Iterator[Node]:
        return iter(self._nodes.values())

    def node(self, eid: str) -> Node | None:
        return self._nodes.get(eid)

    @property
    def marks(self) -> Callable[[str], Node | None]:
        """As `node`, quicker; needs no lock."""
        return self._nodes.get

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
        return [str(etype) for etype in self._by_type]

    def of_type(self, etype: str) -> Collection[str]:
        """The ids of the elements of exactly that class."""
        return self._by_type.ids(etype)

    def of_label(self, label: str) -> Collection[str]:
        """The ids of the elements with that label."""
        return self._by_label.ids(label)

    def of_value(self, key: str, value: Any) -> list[Collection[str]] | None:
        """Groups of ids in which are all elements that have a value of a property; None when it cannot tell.

        They hold few others, and one id may be in several.
        The first question for a property looks at all elements; from then on the answer is kept up to date.
        """
        index = self._by_value.get(key)
        if index is None:
            index = ValueIndex()
            for node in self._nodes.values():
                if key in node.properties:
                    index.add(node.id, node.properties[key].values)
            self._by_value[key] = index
        return index.candidates(value)

    def put(self, node: Node) -> None:
        """Adds an element, or puts new content in the place of the old; relations stay."""
        before = self._nodes.get(node.id)
        eid = before.id if before is not None else node.id
        known = before.properties if before is not None else _NO_PROPERTIES
        properties = {intern(k): p if known.get(k) is p else self._pool.shared(p) for k, p in node.properties.items()}
        self._place(eid, Node(eid, intern(node.type), node.label, properties, node.made))
        if self._undo is not None:
            self._undo.append(lambda: self._place(eid, before))

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

    def free_id(self, etype: str, desired: int = -1, others: Sequence[Scene] = ()) -> str:
        """An id for a new element: with the desired number (from 0) if that is free, else with the next free one.

        :param others: further scenes in which the number is to be free.
        """
        return f"{etype}-{self._numbers.free(desired, [scene._numbers for scene in others])}"

    @property
    def next_number(self) -> int:
        """All numbers from this one on are free for ids; it never goes down, so that no id is given twice."""
        return self._numbers.next

    def reserve(self, next_number: int) -> None:
        """No number below this one is given from now on."""
        self._numbers.reserve(next_number)

    # -- relations ---------------------------------------------------------------------------------------------

    def relations_of(self, eid: str) -> tuple[RelationDict, ...]:
        """The relations of an element as dicts, outgoing and incoming; "-1" stands for the element."""
        cached = self._relation_cache.get(eid)
        if cached is not None:
            return cached
        relations: list[RelationDict] = []
        for pred, index in self._out.items():
            found = index.get(eid)
            if found is not None:
                for dst in (found,) if isinstance(found, str) else found:
                    relations.append(_relation("-1", pred, dst))
        for pred, index in self._in.items():
            found = index.get(eid)
            if found is not None:
                for src in (found,) if isinstance(found, str) else found:
                    relations.append(_relation(src, pred, "-1"))
        told = tuple(relations)
        if len(told) >= _MANY:
            self._relation_cache[eid] = told
        return told

    def related(self, src: str, pred: str, dst: str) -> bool:
        """Whether there is exactly that relation."""
        index = self._out.get(pred)
        return index is not None and index.has(src, dst)

    def predicates(self) -> set[str]:
        """The predicates of all relations."""
        return set(self._out)

    def targets(self, src: str, pred: str) -> Collection[str]:
        """What an element is related to by exactly that predicate."""
        index = self._out.get(pred)
        return index.ids(src) if index is not None else ()

    def sources(self, pred: str, dst: str) -> Collection[str]:
        """What is related to an element by exactly that predicate."""
        index = self._in.get(pred)
        return index.ids(dst) if index is not None else ()

    def relations(
        self, src: str = "", preds: Collection[str] | None = None, dst: str = ""
    ) -> Iterator[tuple[str, str, str]]:
        """The relations with that subject, one of those predicates, and that object; "" and None match any."""
        for pred, index in self._out.items():
            if preds is not None and pred not in preds:
                continue
            if src and dst:
                if index.has(src, dst):
                    yield src, pred, dst
            elif src:
                for other in index.ids(src):
                    yield src, pred, other
            elif dst:
                for other in self._in[pred].ids(dst):
                    yield other, pred, dst
            else:
                for name in index:
                    for other in index.ids(name):
                        yield str(name), pred, other

    def relate(self, src: str, pred: str, dst: str) -> bool:
        """Adds a relation; False when it was there."""
        if self.related(src, pred, dst):
            return False
        src, dst = (self._nodes[name].id if name in self._nodes else name for name in (src, dst))  # one text of each
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
        self.step = Step()

    def touched(self) -> list[str]:
        """The ids of what was changed since `begin`, gone elements too.

        An element that is the subject of another relation than before is not among them: its own content is the same.
        """
        return list({**self.step.contents, **dict.fromkeys(dst for _, _, dst in self.step.relations)})

    def roll_back(self) -> None:
        """Takes back everything since `begin`."""
        self.roll_back_to(0)
        self._undo, self.step = None, Step()

    def mark(self) -> int:
        """A point between `begin` and `commit` that `roll_back_to` returns to."""
        return len(self._undo or ())

    def roll_back_to(self, mark: int) -> None:
        """Takes back everything since a mark."""
        while self._undo is not None and len(self._undo) > mark:
            self._undo.pop()()

    def commit(self, made: Provenance) -> list[str]:
        """Keeps everything since `begin`, and returns the ids of the elements whose content or relations changed."""
        self._undo = None
        touched = []
        for eid in self.step.elements():
            old = self._nodes.get(eid)
            self.removals.note(eid, made if old is None else None)
            if old is not None:
                self._nodes[eid] = Node(eid, old.type, old.label, old.properties, made)
                touched.append(eid)
        self.step = Step()
        return touched

    def succeed(self, before: Scene, made: Provenance | None) -> None:
        """Takes over the removals of a scene that this one replaces with a change (None: not known)."""
        self.removals.succeed(before.removals, before._nodes, made, self._nodes.__contains__)

    def clear(self) -> None:
        """Removes everything."""
        for eid in list(self._nodes):
            self.drop(eid)

    # -- the index itself --------------------------------------------------------------------------------------

    def _place(self, eid: str, node: Node | None) -> None:
        before = self._nodes.get(eid)
        if before is not None and (node is None or node.type != before.type):
            self._by_type.discard(before.type, eid)
        if before is not None and (node is None or node.label != before.label):
            self._by_label.discard(before.label, eid)
        for key, index in self._by_value.items():
            old, new = _property(before, key), _property(node, key)
            if old is not new:
                index.discard(eid, old.values if old is not None else ())
                index.add(eid, new.values if new is not None else ())
        if node is None:
            del self._nodes[eid]
            self._relation_cache.pop(eid, None)
            self._numbers.count(eid, -1)
        else:
            self._nodes[eid] = node
            self._by_type.add(node.type, eid)
            self._by_label.add(node.label, eid)
            if before is None:
                self._numbers.count(eid, 1)
        if self._undo is not None:
            self.step.contents[eid] = None
        if self.dirty is not None:
            self.dirty.nodes.add(eid)

    def _link(self, src: str, pred: str, dst: str) -> None:
        for links, here, there in ((self._out, src, dst), (self._in, dst, src)):
            index = links.get(pred)
            if index is None:
                index = links[pred] = IdIndex()
            index.add(here, there)
        self._note_relation(src, pred, dst)

    def _unlink(self, src: str, pred: str, dst: str) -> None:
        for links, here, there in ((self._out, src, dst), (self._in, dst, src)):
            links[pred].discard(here, there)
            if not links[pred]:
                del links[pred]
        self._note_relation(src, pred, dst)

    def _note_relation(self, src: str, pred: str, dst: str) -> None:
        self._relation_cache.pop(src, None)
        self._relation_cache.pop(dst, None)
        if self._undo is not None:
            self.step.relations[src, pred, dst] = None
        if self.dirty is not None:
            self.dirty.relations.add((src, pred, dst))


def _relation(src: str, pred: str, dst: str) -> dict[str, Any]:
    return {"src": src, "type": pred, "dst": dst, "state": True, "abstract": False}


def _property(node: Node | None, key: str) -> Property | None:
    return node.properties.get(key) if node is not None else None
