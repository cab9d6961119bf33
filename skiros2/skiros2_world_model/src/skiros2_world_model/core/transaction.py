"""Applies the operations of one request to a scene."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace

from skiros2_common.core.changeset import ChangeSet, Relation, patched
from skiros2_common.core.element_content import relation_dict
from skiros2_common.core.errors import Conflict, Refused, UnknownName, WrongValue
from skiros2_common.core.names import full_name
from skiros2_common.core.operations import (
    SPATIAL,
    TEMPLATE,
    Add,
    Apply,
    Expect,
    Instantiate,
    Operation,
    Patch,
    Relate,
    Remove,
    Update,
)
from skiros2_common.core.property import Property
from skiros2_common.core.world_element import Element, ElementChanges, RelationDict
from skiros2_world_model.core.checks import Checks, made_property
from skiros2_world_model.core.conflicts import changed_parts
from skiros2_world_model.core.ontology import Individual, Ontology
from skiros2_world_model.core.prefixes import is_iri
from skiros2_world_model.core.queries import cascade_ids, containment_cycle, format_cycle
from skiros2_world_model.core.scene import ROOT, ElementRecord, Scene


def template_element(ontology: Ontology, name: str) -> Element:
    """Returns a template as an element without id: its class, properties, and relations to other individuals.

    :param name: the individual's name, which becomes the label and the property `skiros:Template`.
    :raises UnknownName: the ontologies have no such individual.
    """
    individual = _individual(ontology, name)
    element = Element(individual.type, individual.name)
    for key, values in individual.values.items():
        element.put(key, made_property(key, values, ontology.value_limits(individual.type, key)))
    element.setProperty("skiros:Template", individual.name)
    for pred, dst in individual.relations:
        element.addRelation("-1", pred, dst)
    return element


def copies_of(ontology: Ontology, request: Instantiate) -> Iterator[Add]:
    """The operations that copy a template, starting with the copy of the template itself.

    :raises UnknownName: the template does not exist.
    """
    filters = [full_name(pred) for pred in request.relation_filter]
    held = {pred for f in filters for pred in ontology.subproperties(f)}
    reference = request.reference or f"copy of {request.uri}"
    relations = list(request.relations)
    waiting = [(full_name(request.uri), reference, relations, request.known)]
    while waiting:
        name, reference, relations, above = waiting.pop(0)
        element = template_element(ontology, name)
        parts = [r["dst"] for r in element.getRelations("-1", sorted(held))]
        element.removeRelations(element.getRelations("-1", sorted(held)))
        element._relations += [{**relation_dict("", "", ""), **relation} for relation in relations]
        yield Add(element, reference)
        if not request.recursive:
            continue
        above = above | {name}
        for index, part in enumerate(parts):
            if part in above or ontology.individual(part) is None:
                continue
            for pred, dst in _individual(ontology, name).relations:
                if dst == part and pred in held:
                    link = relation_dict(f"#{reference}", pred, "-1")
                    waiting.append((part, f"{reference}/{index}", [link], above))


def _individual(ontology: Ontology, name: str) -> Individual:
    individual = ontology.individual(full_name(name))
    if individual is None:
        raise UnknownName(f"the ontologies have no individual {name!r}")
    return individual


HAS_TEMPLATE = "skiros:hasTemplate"


@dataclass(frozen=True)
class Visit:
    """A request of a thread that cannot wait for the end of the current one, which waits for the thread.

    Its changes are in the scene only while a reasoner parses the current request, and become a request of their own
    after it, whatever becomes of it.

    :param ids: as returned by `Transaction.run`.
    :param in_other_contexts: relations to add in other contexts.
    """

    author: str
    ids: list[str]
    changes: ChangeSet
    in_other_contexts: Mapping[str, list[Operation]]


class Transaction:
    """Applies the operations of one request to one scene, between its `begin` and `commit`. Used once.

    :param checks: the checks of names and values.
    :param others: the scenes of the other contexts, by name. They are not changed.
    """

    def __init__(
        self,
        scene: Scene,
        ontology: Ontology,
        checks: Checks,
        author: str,
        others: Mapping[str, Scene] | None = None,
    ) -> None:
        self._scene = scene
        self._ontology = ontology
        self._checks = checks
        self._author = author
        self._others = others or {}
        self._references: dict[str, str] = {}
        self._placed: dict[str, None] = {}  # elements placed in another one, not checked for cycles yet
        #: The elements of the operations: they are published as updated even if nothing has changed.
        self.updated: dict[str, None] = {}
        #: The relations of operations on relations: they are published as such, even if their ends are published.
        self.related: set[Relation] = set()
        self.removed_recursively = False
        self.renamed: list[tuple[str, str]] = []
        #: Relations to add whose subjects are in other contexts, with the context of each.
        self.in_other_contexts: dict[str, list[Operation]] = {}

    def run(self, operations: Iterable[Operation]) -> list[str]:
        """Applies the operations in order and returns the id that each affected.

        Relations of new elements are added last, so that the elements of a request may refer to each other.

        :raises SkirosError: an operation is refused; the caller must roll the scene back.
        """
        operations = list(operations)
        for operation in operations:
            if isinstance(operation, Expect):
                self._check_unchanged(operation)
        expanded: list[tuple[int, Operation]] = []
        for index, operation in enumerate(operations):
            if isinstance(operation, Instantiate):
                named = replace(operation, uri=self._checks.full(operation.uri))
                expanded += [(index, add) for add in copies_of(self._ontology, named)]
            else:
                expanded.append((index, operation))
        ids: dict[int, str] = {}
        links: list[tuple[str, RelationDict]] = []
        for index, operation in expanded:
            ids.setdefault(index, self._apply(operation, links))
        for eid, relation in links:
            if _is_fact(relation):
                self._link(*self._ends(eid, relation))
        self._check_containment()
        self._checks.finish()
        return list(ids.values())

    def include(self, operations: Iterable[Operation], checks: Checks, author: str) -> list[str]:
        """Applies further operations, such as those of a reasoner that parses this transaction; see `run`.

        :raises SkirosError: an operation is refused; none of them is applied.
        """
        part = Transaction(self._scene, self._ontology, checks, author, self._others)
        with self._scene.nested():
            ids = part.run(operations)
        self.updated.update(part.updated)
        self.related |= part.related
        self.renamed += part.renamed
        for context, relations in part.in_other_contexts.items():
            self.in_other_contexts.setdefault(context, []).extend(relations)
        self.removed_recursively |= part.removed_recursively
        return ids

    def visit(self, operations: Iterable[Operation], checks: Checks, author: str) -> Visit:
        """Same as `include`, for a request of another thread; see `Visit`."""
        part = Transaction(self._scene, self._ontology, checks, author, self._others)
        with self._scene.nested() as changes:
            ids = part.run(operations)
        return Visit(author, ids, changes, part.in_other_contexts)

    def complete(self, eid: str, changes: ElementChanges) -> None:
        """Applies the changes that a reasoner made to an element it parsed.

        :raises SkirosError: a change is refused.
        """
        links: list[tuple[str, RelationDict]] = []
        self.patch(eid, changes, links)
        for _, relation in links:
            if _is_fact(relation):
                self._link(*self._ends(eid, relation))
        self._check_containment()

    def _check_unchanged(self, expected: Expect) -> None:
        change_info = self._record(expected.id).change_info
        if change_info.version > expected.version:
            when = time.strftime("%H:%M:%S", time.localtime(change_info.stamp))
            raise Conflict(
                f"{self._author}: {expected.id} was changed by {change_info.author or 'somebody'} at {when} (change "
                f"{change_info.version}), after it was read (version {expected.version})"
            )

    def _apply(self, operation: Operation, links: list[tuple[str, RelationDict]]) -> str:
        if isinstance(operation, Add):
            return self._add(operation, links)
        if isinstance(operation, Expect):
            return operation.id
        if isinstance(operation, Relate) and operation.value:
            return self._relate(operation)
        self._check_containment()  # before a removal can break a cycle that the request added
        if isinstance(operation, Update):
            return self._update(operation, links)
        if isinstance(operation, Patch):
            return self.patch(operation.id, operation.changes, links)
        if isinstance(operation, Remove):
            return self._remove(operation)
        if isinstance(operation, Apply):
            return self._apply_change_set(operation.change_set)
        assert isinstance(operation, Relate)
        return self._relate(operation)

    # -- elements ----------------------------------------------------------------------------------------------

    def _add(self, operation: Add, links: list[tuple[str, RelationDict]]) -> str:
        element = operation.element
        etype = self._checks.class_name(element.type, repr(element))
        eid = self._scene.free_id(etype, element.getIdNumber(), list(self._others.values()))
        if element.id and element.id != eid:
            self.renamed.append((element.id, eid))
        if operation.reference:
            self._references[operation.reference] = eid
        properties = self._put(eid, etype, element.label, element.property_view)
        links += [(eid, relation) for relation in element.relation_view]
        if (template := properties.get(TEMPLATE)) is not None and template.value:
            links.append((eid, {"src": "-1", "type": HAS_TEMPLATE, "dst": template.value}))
        return eid

    def _update(self, operation: Update, links: list[tuple[str, RelationDict]]) -> str:
        element = operation.element
        record = self._record(element.id)
        if operation.keys is not None:
            self._checks.class_name(element.type, element.id)
            properties = self._checked(record.type, element.property_view, record.id)
            written = {key: prop for key, prop in properties.items() if key in operation.keys}
            kept = {key: prop for key, prop in record.properties.items() if key not in operation.keys}
            self._scene.put(ElementRecord(record.id, record.type, record.label, kept | written))
        else:
            self._put(record.id, element.type, element.label, element.property_view)
        self.updated[record.id] = None
        if operation.relations:
            wanted = {self._ends(record.id, r) for r in element.relation_view if _is_fact(r)}
            for relation in [*self._scene.relations(record.id), *self._scene.relations(dst=record.id)]:
                if relation not in wanted:
                    self._scene.unrelate(*relation)
            links += [(record.id, relation) for relation in element.relation_view]
        return record.id

    def patch(self, eid: str, changes: ElementChanges, links: list[tuple[str, RelationDict]]) -> str:
        """Changes parts of an element. Appends added relations to `links`."""
        record = self._record(eid)
        etype = record.type if changes.type is None else self._checks.class_name(changes.type, eid)
        label = record.label if changes.label is None else self._checks.label(changes.label, eid)
        if changes.properties or changes.removed_properties or etype != record.type or label != record.label:
            properties = dict(record.properties)
            for key in changes.removed_properties:
                properties.pop(full_name(key), None)
            unchecked = {self._checks.full(key): prop for key, prop in changes.properties.items()}
            if etype != record.type:  # existing properties may not be valid for the new class
                unchecked = properties | unchecked
            for key, prop in unchecked.items():
                checked = self._checks.property(etype, key, prop, eid)
                properties[checked.key] = checked
            self._scene.put(ElementRecord(eid, etype, label, properties))
        for relation in changes.removed_relations:
            self._scene.unrelate(*self._ends(eid, relation))
        links += [(eid, relation) for relation in changes.added_relations]
        self.updated[eid] = None
        return eid

    def _remove(self, operation: Remove) -> str:
        root = self._record(operation.id).id
        gone = [root]
        if operation.recursive:
            filters = operation.relation_filter, operation.type_filter
            gone = cascade_ids(self._scene, self._ontology, root, *filters)
            self.removed_recursively = True
        for eid in gone:
            self._drop(eid)
        return root

    def _drop(self, eid: str) -> None:
        if eid == ROOT:
            raise Refused(f"{self._author}: {ROOT} is the root of the scene and cannot be removed")
        self._scene.drop(eid)
        self.updated.pop(eid, None)

    def _apply_change_set(self, change_set: ChangeSet) -> str:
        """Applies a change set; returns the id of its first element, or the subject of its first relation.

        :raises Conflict: parts of the scene have changed since; the text has all of them.
        """
        if parts := changed_parts(change_set, self._scene):
            raise Conflict("; ".join(parts))
        for relation, added in change_set.relations.items():
            if not added:
                self._scene.unrelate(*relation)
        for eid, (before, after) in change_set.records.items():
            if after is None:
                self._drop(eid)
                continue
            current = self._scene.record(eid)
            content = after if before is None or current is None else patched(current, before, after)
            self._put(eid, content.type, content.label, content.properties)
            self.updated[eid] = None
        for relation, added in change_set.relations.items():
            if added:
                self._link(*relation)
        return next(iter(change_set.ids()), "")

    # -- relations ---------------------------------------------------------------------------------------------

    def _relate(self, operation: Relate) -> str:
        src, dst = self._end("", operation.src), self._end("", operation.dst)
        if operation.value:
            return self._link(src, self._checks.full(operation.pred), dst, alone=True)
        self._record(src)
        pred = self._checks.name(operation.pred, "relation", src)
        dst = self._target(src, pred, dst)
        for name in {pred, *self._ontology.subproperties(pred)}:
            self.related.add((src, name, dst))
            self._scene.unrelate(src, name, dst)
        return src

    def _link(self, src: str, pred: str, dst: str, alone: bool = False) -> str:
        """Checks and adds a relation; returns its subject.

        :param alone: the relation itself was requested.
        """
        who = f"{src} {pred} {dst}"
        pred = self._checks.relation_name(pred, who)
        dst = self._target(src, pred, dst)
        if src not in self._scene:
            if (context := next((name for name, scene in self._others.items() if src in scene), None)) is None:
                raise UnknownName(f"{self._author}: {who}: there is no element {src!r}")
            self.in_other_contexts.setdefault(context, []).append(Relate(src, pred, dst))
            return src
        self._checks.relation_ends(self._record(src), pred, self._scene.record(dst), who)
        if self._ontology.is_subproperty(pred, SPATIAL):
            self._placed[dst] = None
        if alone:
            self.related.add((src, pred, dst))
        self._scene.relate(src, pred, dst)
        return src

    def _target(self, src: str, pred: str, dst: str) -> str:
        """Resolves the object of a relation: an element of any context, or an individual of the ontologies."""
        if dst in self._scene or any(dst in scene for scene in self._others.values()):
            return dst
        return self._checks.individual(dst, f"{src} {pred} {dst}")

    def _check_containment(self) -> None:
        """Refuses containment cycles through elements that were placed since the last call."""
        placed, self._placed = self._placed, {}
        cycle = containment_cycle(self._scene, self._ontology.subproperties(SPATIAL), placed)
        if cycle:
            raise WrongValue(f"{self._author}: {format_cycle(cycle)}: an element cannot be in itself")

    # -- helpers -----------------------------------------------------------------------------------------------

    def _ends(self, eid: str, relation: RelationDict) -> tuple[str, str, str]:
        """Resolves the ids of a relation: "-1" is the element, `#name` a new element of the request."""
        src, dst = (self._end(eid, relation[side]) for side in ("src", "dst"))
        return src, self._checks.full(relation["type"]), dst

    def _end(self, eid: str, name: str) -> str:
        if name == "-1":
            return eid
        if name.startswith("#"):
            if name[1:] not in self._references:
                raise UnknownName(f"{self._author}: the request refers to {name}, but adds no such element")
            return self._references[name[1:]]
        return self._checks.full(name) if is_iri(name) else name

    def _put(self, eid: str, etype: str, label: str, properties: Mapping[str, Property]) -> dict[str, Property]:
        """Checks the content of an element and stores it. Returns the checked properties."""
        etype = self._checks.class_name(etype, eid)
        checked = self._checked(etype, properties, eid)
        self._scene.put(ElementRecord(eid, etype, self._checks.label(label, eid), checked))
        return checked

    def _checked(self, etype: str, properties: Mapping[str, Property], who: str) -> dict[str, Property]:
        checked = [self._checks.property(etype, key, prop, who) for key, prop in properties.items()]
        return {prop.key: prop for prop in checked}

    def _record(self, eid: str) -> ElementRecord:
        record = self._scene.record(eid)
        if record is None:
            raise UnknownName(f"{self._author}: there is no element {eid!r}")
        return record


def _is_fact(relation: RelationDict) -> bool:
    return bool(relation.get("state", True)) and not relation.get("abstract", False)
