"""A scene as it should be: plain dictionaries, and every answer by brute force. The world model is compared with it.

It follows the contract, not the code: it has no index, no undo and no store, and it takes the class and relation
hierarchies from the ontologies with rdflib.
"""

from __future__ import annotations

import functools
import re
from collections.abc import Iterable, Iterator, Sequence
from copy import deepcopy
from dataclasses import dataclass, field
from typing import Any

import rdflib

from skiros2_common.core.operations import Add, Instantiate, Operation, Patch, Relate, Remove, Update
from support.lab import DATATYPES, LAB, MOST_VALUES, NAMESPACES, TEMPLATES
from support.ros import ROOT as REPOSITORY

ROOT = "skiros:Scene-0"
CONTAINMENT = "skiros:spatiallyRelated"


class Refusal(Exception):
    """The request has to be refused, with a text that names one of these."""


@dataclass
class Thing:
    """An element without its relations."""

    type: str
    label: str
    values: dict[str, list[Any]] = field(default_factory=dict)

    @property
    def reasoners(self) -> list[Any]:
        return self.values.get("skiros:DiscreteReasoner", [])


Relation = tuple[str, str, str]


@dataclass
class SceneModel:
    """A scene.

    :param is_inspected: there is a reasoner `Inspector`, which opens its elements and rejects those called `rejected`.
    """

    things: dict[str, Thing] = field(default_factory=dict)
    relations: set[Relation] = field(default_factory=set)
    is_inspected: bool = False

    def comparable(self) -> Any:
        """The content in a form in which NaN equals itself, and 1, 1.0 and True differ."""
        things = {eid: (t.type, t.label, repr(sorted(t.values.items()))) for eid, t in self.things.items()}
        return things, self.relations

    def as_read_from_a_file(self) -> SceneModel:
        """What RDF keeps of it: the values of a property are a set, and one without values is none."""
        copy = deepcopy(self)
        for thing in copy.things.values():
            by_text = {key: {repr(v): v for v in values} for key, values in thing.values.items() if values}
            thing.values = {key: sorted(values.values(), key=repr) for key, values in by_text.items()}
        return copy

    # -- requests ----------------------------------------------------------------------------------------------

    def after(self, operations: Sequence[Operation], ids: Iterator[str] | None = None) -> SceneModel:
        """The scene after a request.

        :param ids: what the world model called the new elements, in order; None: not asked yet.
        :raises Refusal: it has to be refused.
        """
        copy = deepcopy(self)
        request = _Request(copy, ids)
        for operation in operations:
            request.apply(operation)
        for eid, relation in request.links:
            request.link(eid, relation)
        for thing in copy.things.values() if self.is_inspected else ():
            if "Inspector" in thing.reasoners:
                thing.values["lab:open"] = [True]
                if thing.label == "rejected":
                    raise Refusal("Inspector refuses")
        return copy

    # -- questions ---------------------------------------------------------------------------------------------

    def resolve(self, etype: str, label: str, values: dict[str, Any]) -> set[str]:
        return {
            eid
            for eid, thing in self.things.items()
            if under(thing.type, etype, "subClassOf")
            and label in ("", thing.label)
            and all(any(_alike(v, value) for v in thing.values.get(key, ())) for key, value in values.items())
        }

    def branch(self, root: str, pred: str, etype: str = "") -> set[str]:
        found = {root}
        while True:
            more = {d for s, p, d in self.relations if s in found and d in self.things and is_under(p, pred)} - found
            if not more:
                return {eid for eid in found if not etype or under(self.things[eid].type, etype, "subClassOf")}
            found |= more

    def related(self, src: str, pred: str, dst: str) -> set[Relation]:
        return {
            (s, p, d)
            for s, p, d in self.relations
            if src in ("", s) and dst in ("", d) and (not pred or is_under(p, pred))
        }

    def removed_with(self, root: str, pred: str, etype: str) -> set[str]:
        """The element and what is under it, without what something else holds too."""
        gone = self.branch(root, pred, etype) | {root}
        while True:
            held = {d for s, p, d in self.relations if d in gone and s not in gone and is_under(p, pred)} - {root}
            if not held:
                return gone
            gone -= held


class _Request:
    """One request on its way into a model."""

    def __init__(self, scene: SceneModel, ids: Iterator[str] | None) -> None:
        self.scene = scene
        self.ids = ids
        self.references: dict[str, str] = {}
        self.links: list[tuple[str, Relation]] = []

    def apply(self, operation: Operation) -> None:
        things = self.scene.things
        if isinstance(operation, Add):
            e = operation.element
            self.add(e.type, e.label, e.id, _given_values(e), _facts(e.relation_view), operation.reference)
        elif isinstance(operation, Instantiate):
            self.copy_template(operation)
        elif isinstance(operation, Remove):
            self.element(operation.id)
            gone = {operation.id}
            if operation.recursive:
                gone = self.scene.removed_with(
                    operation.id, full(operation.relation_filter), full(operation.type_filter)
                )
            if ROOT in gone:
                raise Refusal(ROOT)
            for eid in gone:
                del things[eid]
            self.scene.relations -= {r for r in self.scene.relations if r[0] in gone or r[2] in gone}
        elif isinstance(operation, Relate):
            self.relate(operation)
        elif isinstance(operation, Update):
            e, thing = operation.element, self.element(operation.element.id)
            etype = class_name(e.type)
            if operation.keys is not None:
                kept = {key: v for key, v in thing.values.items() if key not in operation.keys}
                values = checked(thing.type, _given_values(e))
                thing.values = kept | {key: v for key, v in values.items() if key in operation.keys}
            else:
                things[e.id] = Thing(etype, text(e.label), checked(etype, _given_values(e)))
            if operation.relations:
                wanted = [self.ends(e.id, r) for r in _facts(e.relation_view)]
                self.scene.relations -= {r for r in self.scene.relations if e.id in (r[0], r[2]) and r not in wanted}
                self.links += [(e.id, r) for r in _facts(e.relation_view)]
        else:
            assert isinstance(operation, Patch)
            self.patch(operation)

    def add(
        self, etype: str, label: str, wish: str, values: dict[str, list[Any]], relations: list[Relation], reference: str
    ) -> str:
        etype = class_name(etype)
        eid = self.new_id(etype, wish)
        if reference:
            self.references[reference] = eid
        values = checked(etype, values)
        self.scene.things[eid] = Thing(etype, text(label), values)
        self.links += [(eid, r) for r in relations]
        if values.get("skiros:Template"):
            self.links.append((eid, ("-1", "skiros:hasTemplate", values["skiros:Template"][0])))
        return eid

    def copy_template(self, operation: Instantiate) -> None:
        waiting = [(full(operation.uri), operation.reference or "copy", _facts(operation.relations), operation.known)]
        for name, reference, relations, above in waiting:
            if name not in TEMPLATES:
                raise Refusal(name)
            template = TEMPLATES[name]
            held = [r for r in template.relations if any(is_under(r[0], full(f)) for f in operation.relation_filter)]
            own = [("-1", pred, dst) for pred, dst in template.relations if (pred, dst) not in held]
            values = {**template.values, "skiros:Template": [name]}
            eid = self.add(template.type, name, "", values, own + relations, reference)
            for pred, part in held if operation.recursive else ():
                if part not in above | {name}:
                    waiting.append((part, f"{eid} {part}", [(eid, pred, "-1")], above | {name}))

    def patch(self, operation: Patch) -> None:
        eid, changes = operation.id, operation.changes
        thing = self.element(eid)
        etype = thing.type if changes.type is None else class_name(changes.type)
        label = thing.label if changes.label is None else text(changes.label)
        removed = {full(key) for key in changes.removed_properties}
        values = {key: v for key, v in thing.values.items() if key not in removed}
        values = checked(etype, values | {full(key): p.values for key, p in changes.properties.items()})
        self.scene.things[eid] = Thing(etype, label, values)
        self.scene.relations -= {self.ends(eid, r) for r in _facts(changes.removed_relations)}
        self.links += [(eid, r) for r in _facts(changes.added_relations)]

    def relate(self, operation: Relate) -> None:
        relation = self.ends("", (operation.src, operation.pred, operation.dst))
        if operation.value:
            self.link("", relation)
            return
        src, pred, dst = relation
        self.element(src)
        if not is_name(pred):
            raise Refusal(pred)
        dst = self.target(dst)
        self.scene.relations -= {
            (s, p, d) for s, p, d in self.scene.relations if (s, d) == (src, dst) and is_under(p, pred)
        }

    def link(self, eid: str, relation: Relation) -> None:
        src, pred, dst = self.ends(eid, relation)
        if not is_name(pred):
            raise Refusal(pred)
        self.element(src)
        dst = self.target(dst)
        if is_under(pred, CONTAINMENT) and src in self.scene.branch(dst, CONTAINMENT) | {dst}:
            raise Refusal("in itself")
        self.scene.relations.add((src, pred, dst))

    def target(self, dst: str) -> str:
        if dst in self.scene.things:
            return dst
        if not is_name(dst) or re.search(r"-\d+$", dst):
            raise Refusal(dst)
        return full(dst)

    def ends(self, eid: str, relation: Relation) -> Relation:
        src, pred, dst = relation
        return self.end(eid, src), full(pred), self.end(eid, dst)

    def end(self, eid: str, name: str) -> str:
        if name == "-1":
            return eid
        if name.startswith("#"):
            if name[1:] not in self.references:
                raise Refusal(name)
            return self.references[name[1:]]
        return name

    def element(self, eid: str) -> Thing:
        if eid not in self.scene.things:
            raise Refusal(eid)
        return self.scene.things[eid]

    def new_id(self, etype: str, wish: str) -> str:
        """The id of a new element: the number wished for if it is free, else the next free one, else a new one."""
        taken = {n for eid in self.scene.things if (n := number(eid)) is not None}
        wanted = number(wish)
        if wanted is not None:
            while wanted in taken:
                wanted += 1
        if self.ids is None:
            return f"{etype}-{max(1_000_000, *taken) + 1 if wanted is None else wanted}"
        given = next(self.ids)
        assert given.startswith(f"{etype}-") and number(given) not in taken, f"{given} for a new {etype}"
        assert wanted is None or number(given) == wanted, f"{given}, wished for {wish}"
        return given


# -- names and values --------------------------------------------------------------------------------------------------


def number(eid: str) -> int | None:
    found = re.search(r"-(\d+)$", eid)
    return int(found[1]) if found else None


def full(name: str) -> str:
    """`prefix:Name`; what has no prefix is of `skiros`."""
    for prefix, namespace in NAMESPACES.items():
        if name.startswith(namespace):
            return f"{prefix}:{name.removeprefix(namespace)}"
    if not name or ":" in name[1:]:
        return name
    return f"skiros:{name.removeprefix(':')}"


def is_name(name: str) -> bool:
    """Whether RDF can hold it as the local part of an IRI."""
    local = full(name).partition(":")[2]
    return bool(local) and not re.search(r'[\x00-\x20\x7f-\x9f<>"{}|\\^`#%\[\]\ud800-\udfff]', name)


def class_name(name: str) -> str:
    if not is_name(name):
        raise Refusal(name if name.isprintable() else "class")
    return full(name)


def text(label: str) -> str:
    if re.search("[\ud800-\udfff]", label):
        raise Refusal("label")
    return label


def checked(etype: str, given: dict[str, list[Any]]) -> dict[str, list[Any]]:
    """The values as the properties of a class take them."""
    taken: dict[str, list[Any]] = {}
    wrong: list[str] = []
    for key, values in given.items():
        try:
            taken[full(key)] = _checked_values(etype, key, values)
        except Refusal as refusal:
            wrong += refusal.args
    if wrong:
        raise Refusal(*wrong)
    return taken


def _checked_values(etype: str, key: str, given: list[Any]) -> list[Any]:
    if not is_name(key) or full(key) in ("rdf:type", "rdfs:label"):
        raise Refusal(key)
    key = full(key)
    datatype = DATATYPES.get(key)
    values = [v for v in given if v != "" or datatype not in (float, int, bool)]
    if len(values) > MOST_VALUES.get((etype, key), len(values)):
        raise Refusal(key)
    if datatype is not None:
        values = [_as(v, datatype, key) for v in values]
    elif len({type(v) for v in values}) > 1:
        are_numbers = {type(v) for v in values} <= {int, float}
        values = [float(v) if are_numbers else str(v) for v in values]
    if any(isinstance(value, str) and re.search("[\ud800-\udfff]", value) for value in values):
        raise Refusal(key)
    return values


def _alike(one: Any, other: Any) -> bool:
    """Whether two values are equal, where a number or bool equals its text."""
    if isinstance(one, str) and not isinstance(other, str):
        one, other = other, one
    if isinstance(other, str) and isinstance(one, (bool, int, float)):
        try:
            other = _as(other, type(one), "")
        except Refusal:
            return False
    return isinstance(one, bool) == isinstance(other, bool) and one == other


def _as(value: Any, datatype: type, key: str) -> Any:
    try:
        if isinstance(value, str) and datatype is not str:
            known = {"true": True, "1": True, "false": False, "0": False}
            return known[value.strip().lower()] if datatype is bool else datatype(value)
        is_number = isinstance(value, (int, float)) and not isinstance(value, bool)
        if (
            isinstance(value, datatype)
            if datatype in (str, bool)
            else is_number and (datatype is float or value % 1 == 0)
        ):
            return datatype(value)
        raise Refusal(key)
    except (ValueError, KeyError, OverflowError):
        raise Refusal(key) from None


def _given_values(element: Any) -> dict[str, Any]:
    return {key: prop.values for key, prop in element.property_view.items()}


def _facts(relations: Iterable[Any]) -> list[Relation]:
    return [(r["src"], r["type"], r["dst"]) for r in relations if r.get("state", True) and not r.get("abstract", False)]


# -- hierarchies -------------------------------------------------------------------------------------------------------


@functools.cache
def _ontologies() -> rdflib.Graph:
    graph = rdflib.Graph()
    for path in sorted((REPOSITORY / "ontologies").glob("*.ttl")):
        graph.parse(path)
    return graph.parse(data=LAB, format="turtle")


@functools.cache
def under(name: str, above: str, relation: str) -> bool:
    """Whether a class or relation is another one or under it."""
    start, end = rdflib.URIRef(_iri(name)), rdflib.URIRef(_iri(above))
    return name == above or end in _ontologies().transitive_objects(start, rdflib.RDFS[relation])


def is_under(pred: str, above: str) -> bool:
    return under(pred, above, "subPropertyOf")


def _iri(name: str) -> str:
    prefix, _, local = name.partition(":")
    return NAMESPACES.get(prefix, f"urn:other:{prefix}#") + local
