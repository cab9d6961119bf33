"""Conversion between scenes and RDF, and the graph sync that keeps a triple store in step with a scene."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import chain

import pyoxigraph as ox

from skiros2_common.core.changeset import ChangeSet
from skiros2_common.core.errors import SkirosError, WrongValue
from skiros2_common.core.names import id_number
from skiros2_common.core.property import Property
from skiros2_world_model.core.checks import LEFT_OUT, Checks
from skiros2_world_model.core.ontology import Ontology
from skiros2_world_model.core.prefixes import OWL, RDFS, Prefixes
from skiros2_world_model.core.rdf import RDF_TYPE, literal, python_value
from skiros2_world_model.core.scene import ChangeInfo, ElementRecord, Scene
from skiros2_world_model.core.triple_store import TripleStore

_TYPE = RDF_TYPE.value
_LABEL = ox.NamedNode(RDFS + "label")
_NAMED_INDIVIDUAL = ox.NamedNode(OWL + "NamedIndividual")


class SceneContent:
    """The elements that triples describe: individuals of a class, whether the ontologies declare it or not.

    :param checks: collects unknown names and findings.
    :param change_info: the last change of the elements.
    :ivar extras: triples that belong to no element, such as comments on the file; they are saved again.
    :raises WrongValue, WrongType: a value cannot be read, or has another type than its property.
    """

    def __init__(self, triples: Iterable[ox.Triple], checks: Checks, change_info: ChangeInfo) -> None:
        self.records: dict[str, ElementRecord] = {}
        self.relations: list[tuple[str, str, str]] = []
        self.extras: list[ox.Triple] = []
        self._ontology = checks.ontology
        self._prefixes = checks.prefixes
        self._checks = checks
        self._origin = checks.origin
        self._provenance = change_info
        self._names: dict[str, str] = {}  # of predicates and classes, by IRI
        self._plain: dict[tuple[str, str], tuple[type, ...]] = {}
        described: dict[str, list[ox.Triple]] = {}
        for triple in triples:
            if isinstance(triple.subject, ox.NamedNode):
                described.setdefault(triple.subject.value, []).append(triple)
            else:
                self.extras.append(triple)
        for iri, statements in described.items():
            eid = self._prefixes.name(iri)
            try:
                self._read(eid, statements)
            except SkirosError as error:
                checks.report(eid, "", error, LEFT_OUT)
        for src, relation, dst in self.relations:
            if src in self.records:
                checks.relation_ends(self.records[src], relation, self.records.get(dst), f"{src} {relation} {dst}")

    def _read(self, eid: str, triples: list[ox.Triple]) -> None:
        """Reads the triples of one subject."""
        statements = [(triple.predicate.value, triple.object, triple) for triple in triples]
        declared = [self._name(o.value) for p, o, _ in statements if p == _TYPE and isinstance(o, ox.NamedNode)]
        types = self._ontology.instance_types(declared)
        if not types and id_number(eid) >= 0 and "owl:Ontology" not in declared:
            types = [eid.rpartition("-")[0]]  # derive the class from the id
        if not types:
            self.extras += triples
            return
        etype = self._checks.class_name(types[0], eid)
        labels: list[str] = []
        values: dict[str, list[ox.Literal]] = {}
        for predicate, obj, triple in statements:
            if predicate == _TYPE:
                if not isinstance(obj, ox.NamedNode) or self._name(obj.value) not in (etype, "owl:NamedIndividual"):
                    self.extras.append(triple)
            elif isinstance(obj, ox.NamedNode):
                relation = self._checks.relation_name(self._name(predicate), eid)
                self.relations.append((eid, relation, self._prefixes.name(obj.value)))
            elif not isinstance(obj, ox.Literal):
                self.extras.append(triple)
            elif predicate == _LABEL.value:
                labels.append(obj.value)
            else:
                values.setdefault(self._name(predicate), []).append(obj)
        found = {key: self._property(eid, etype, key, values[key]) for key in sorted(values)}
        properties = {key: prop for key, prop in found.items() if prop is not None}
        self.records[eid] = ElementRecord(eid, etype, min(labels, default=""), properties, self._provenance)

    def _property(self, eid: str, etype: str, key: str, literals: list[ox.Literal]) -> Property | None:
        """The property with its valid values; None when no value is valid."""
        try:
            return self._checked(eid, etype, key, literals)
        except SkirosError:
            pass  # check the values one by one below
        most = self._ontology.value_limits(etype, key)[1]
        fitting = [v for v in literals if self._fits(eid, etype, key, v)]
        if most is not None and len(fitting) > most:
            listed = ", ".join(v.value for v in fitting)
            error = WrongValue(f"{self._origin}: {eid}: {key} has {len(fitting)} values ({listed}), allowed are {most}")
            self._checks.report(eid, key, error, f"kept {', '.join(v.value for v in fitting[:most])}")
            fitting = fitting[:most]
        if not fitting:
            return None
        return self._checked(eid, etype, key, fitting)

    def _checked(self, eid: str, etype: str, key: str, literals: list[ox.Literal]) -> Property:
        if len(literals) == 1:
            value = python_value(literals[0])
            if value.__class__ in self._plain_types(etype, key):
                return Property(key, value)
        values = [python_value(v) for v in sorted(literals, key=str)]
        prop = Property(key, values if len({type(v) for v in values}) == 1 else [str(v) for v in values])
        return self._checks.property(etype, key, prop, eid)

    def _plain_types(self, etype: str, key: str) -> tuple[type, ...]:
        """The types of which one value needs no further check for a property."""
        known = self._plain.get((etype, key))
        if known is None:
            known = self._plain[etype, key] = self._checks.plain_types(etype, key)
        return known

    def _fits(self, eid: str, etype: str, key: str, literal: ox.Literal) -> bool:
        """Whether a value is valid for a property; reports an invalid value to the checks."""
        try:
            self._checks.property(etype, key, Property(key, [python_value(literal)]), eid)
        except SkirosError as error:
            text = str(error).removeprefix(f"{self._origin}: {eid}: ").removeprefix(f"{key}: ")
            self._checks.report(eid, key, error.with_text(f"{self._origin}: {eid}: {key}: {text}"), LEFT_OUT)
            return False
        return True

    def _name(self, iri: str) -> str:
        name = self._names.get(iri)
        if name is None:
            name = self._names[iri] = self._prefixes.name(iri)
        return name


def element_triples(record: ElementRecord, ontology: Ontology, prefixes: Prefixes) -> Iterator[ox.Triple]:
    """The triples of an element, without its relations."""
    subject = ox.NamedNode(prefixes.iri(record.id))
    yield ox.Triple(subject, RDF_TYPE, _NAMED_INDIVIDUAL)
    yield ox.Triple(subject, RDF_TYPE, ox.NamedNode(prefixes.iri(record.type)))
    if record.label:
        yield ox.Triple(subject, _LABEL, ox.Literal(record.label))
    for key, prop in record.properties.items():
        if prop.values:
            predicate = ox.NamedNode(prefixes.iri(key))
            datatype = ontology.value_limits(record.type, key)[0]
            for value in prop.values:
                yield ox.Triple(subject, predicate, literal(value, datatype))


def relation_triple(relation: tuple[str, str, str], prefixes: Prefixes) -> ox.Triple:
    """The triple of a relation."""
    src, pred, dst = (ox.NamedNode(prefixes.iri(name)) for name in relation)
    return ox.Triple(src, pred, dst)


def scene_triples(
    scene: Scene, ontology: Ontology, prefixes: Prefixes, extras: Iterable[ox.Triple] = ()
) -> Iterator[ox.Triple]:
    """All triples of the current state of a scene and extra triples, generated lazily. Iterating needs no lock."""
    records, relations = list(scene), list(scene.relations())
    elements = (triple for record in records for triple in element_triples(record, ontology, prefixes))
    return chain(elements, (relation_triple(relation, prefixes) for relation in relations), extras)


class GraphSync:
    """Keeps the graph of one context in step with its scene.

    `flush` runs before a query. The first call writes the whole scene, later calls write `Scene.unsynced`.
    """

    def __init__(self, store: TripleStore, context: str) -> None:
        self._store = store
        self._context = context
        self._generation = store.generation

    def flush(self, scene: Scene, extras: Iterable[ox.Triple], ontology: Ontology, prefixes: Prefixes) -> None:
        """Writes all pending changes of the scene to the store. The caller holds the lock of the scene.

        The store gets iterables over a snapshot, and makes the triples of it without the lock.
        """
        unsynced = scene.unsynced
        if unsynced is None or self._generation != self._store.generation:
            self._generation = self._store.generation
            self._store.replace(self._context, scene_triples(scene, ontology, prefixes, list(extras)))
        elif unsynced:
            self._update(unsynced, set(extras), ontology, prefixes)
        scene.unsynced = ChangeSet()  # only after success, so that a failed flush is repeated

    def _update(self, unsynced: ChangeSet, extras: set[ox.Triple], ontology: Ontology, prefixes: Prefixes) -> None:
        def subjects() -> Iterator[ox.NamedNode]:
            return (ox.NamedNode(prefixes.iri(eid)) for eid in unsynced.records)

        def relations(wanted: bool) -> Iterator[ox.Triple]:
            return (relation_triple(r, prefixes) for r, added in unsynced.relations.items() if added == wanted)

        def added() -> Iterator[ox.Triple]:
            for _, record in unsynced.records.values():
                if record is not None:
                    yield from element_triples(record, ontology, prefixes)
            yield from relations(True)
            if extras:  # what the lines above remove of them
                changed = set(subjects())
                yield from (triple for triple in extras if triple.subject in changed)
                yield from extras.intersection(relations(False))

        self._store.rewrite(self._context, subjects(), relations(False), added())
