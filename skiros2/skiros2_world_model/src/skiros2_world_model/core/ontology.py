"""An index of the ontologies: classes, properties, restrictions, individuals, and their closures.

An `Ontology` is immutable; a change of the ontologies creates a new one. The server builds it from its triple store, a
client from the answer to `STRUCTURE_QUERY`.
"""

from __future__ import annotations

import copy
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

from skiros2_common.core.names import local_name
from skiros2_world_model.core.prefixes import STANDARD, prefix_of

#: A triple of names. A literal object is a pair of value and datatype, such as `(1.0, "xsd:float")`.
NamedTriple = tuple[str, str, Any]

#: Selects what a client needs of the ontologies: all triples except those with literals.
#: It is answered from memory, without SPARQL.
STRUCTURE_QUERY = "SELECT ?s ?p ?o WHERE { ?s ?p ?o . FILTER(!isLiteral(?o)) }"
#: Answered with yes by a server that is there, similarly.
ALIVE_QUERY = "ASK {}"

_META = ("rdf:", "rdfs:", "owl:", "xsd:")
_CLASS_TYPES = ("owl:Class", "rdfs:Class", "owl:class")
_RELATION_TYPES = (
    "owl:ObjectProperty",
    "owl:TransitiveProperty",
    "owl:SymmetricProperty",
    "owl:InverseFunctionalProperty",
)
_FUNCTIONAL = "owl:FunctionalProperty"
_DATA_TYPES = ("owl:DatatypeProperty",)
_FILLERS = ("owl:someValuesFrom", "owl:allValuesFrom", "owl:onClass", "owl:hasValue", "owl:onDataRange")
_EXACT = ("owl:qualifiedCardinality", "owl:cardinality")
_MOST = ("owl:maxQualifiedCardinality", "owl:maxCardinality")


@dataclass(frozen=True)
class Restriction:
    """An OWL restriction on one property of a class: the named fillers and the maximum cardinality (None: any)."""

    property: str
    fillers: tuple[str, ...]
    most: int | None = None


@dataclass
class Individual:
    """An individual of an ontology; templates are individuals."""

    name: str
    types: list[str] = field(default_factory=list)
    relations: list[tuple[str, str]] = field(default_factory=list)
    values: dict[str, list[Any]] = field(default_factory=dict)

    @property
    def type(self) -> str:
        """The most specific declared class; "" when there is none."""
        return self.types[0] if self.types else ""


class Ontology:
    """The classes, properties and individuals declared by triples. Immutable and thread-safe."""

    def __init__(self, triples: Iterable[NamedTriple]) -> None:
        self._superclasses: dict[str, list[str]] = {}
        self._superproperties: dict[str, list[str]] = {}
        self._relations: set[str] = set()
        self._data_properties: set[str] = set()
        self._domains: dict[str, list[str]] = {}
        self._ranges: dict[str, list[str]] = {}
        self._types: dict[str, list[str]] = {}
        self._individuals: dict[str, Individual] = {}
        self._by_class: dict[str, list[str]] = {}
        self._restrictions: dict[str, list[Restriction]] = {}
        self._closures: dict[tuple[str, str], frozenset[str]] = {}
        self._limits: dict[tuple[str, str], tuple[str, int | None]] = {}
        self._violations: dict[tuple[str, str, str], list[str]] = {}
        self._read(list(triples))
        self._subclasses = _inverse(self._superclasses)
        self._subproperties = _inverse(self._superproperties)

    # -- classes and properties --------------------------------------------------------------------------------

    def has_class(self, name: str) -> bool:
        return name in self._superclasses

    def has_relation(self, name: str) -> bool:
        """Whether a name is an object property."""
        return name in self._relations or _is_standard(name)

    def has_data_property(self, name: str) -> bool:
        return name in self._data_properties or _is_standard(name)

    def has_property(self, name: str) -> bool:
        """Whether a name is a declared property of any kind."""
        return name in self._superproperties

    def knows(self, name: str) -> bool:
        """Whether a name is a class, property or individual of the ontologies, or a term of RDF or OWL."""
        return (
            name in self._superclasses
            or name in self._superproperties
            or name in self._types
            or name in self._individuals
            or _is_standard(name)
        )

    def prefixes(self) -> frozenset[str]:
        """The prefixes of the declared ontologies, and the standard ones."""
        declared = (prefix_of(name) for name, types in self._types.items() if "owl:Ontology" in types)
        return frozenset([*STANDARD, *declared])

    def classes(self) -> list[str]:
        return list(self._superclasses)

    def relations(self) -> list[str]:
        """All object properties."""
        return sorted(self._relations)

    def data_properties(self) -> list[str]:
        return sorted(self._data_properties)

    def declared(self, kind: str) -> list[str]:
        """The names of a declared type, such as `owl:Class`, sorted; without blank nodes."""
        return sorted(name for name, types in self._types.items() if kind in types and not name.startswith("_:"))

    def direct_superclasses(self, name: str) -> list[str]:
        return list(self._superclasses.get(name, ()))

    def direct_subclasses(self, name: str) -> list[str]:
        return list(self._subclasses.get(name, ()))

    def direct_subproperties(self, name: str) -> list[str]:
        return list(self._subproperties.get(name, ()))

    def superclasses(self, name: str) -> frozenset[str]:
        """The class and all its superclasses."""
        return self._closure("superclasses", self._superclasses, name)

    def subclasses(self, name: str) -> frozenset[str]:
        """The class and all its subclasses."""
        return self._closure("subclasses", self._subclasses, name)

    def superproperties(self, name: str) -> frozenset[str]:
        """The property and all its superproperties."""
        return self._closure("superproperties", self._superproperties, name)

    def subproperties(self, name: str) -> frozenset[str]:
        """The property and all its subproperties."""
        return self._closure("subproperties", self._subproperties, name)

    def is_subclass(self, child: str, parent: str) -> bool:
        """Whether `child` is `parent` or one of its subclasses."""
        return child == parent or parent in self.superclasses(child)

    def is_subproperty(self, child: str, parent: str) -> bool:
        """Whether `child` is `parent` or one of its subproperties."""
        return child == parent or parent in self.superproperties(child)

    def domain_range_violations(self, subject_type: str, relation: str, object_type: str) -> list[str]:
        """The violations of `rdfs:domain` and `rdfs:range` by a relation between two classes, as texts.

        Undeclared classes violate nothing.

        :param object_type: "" when the object has no class.
        """
        key = (subject_type, relation, object_type)
        if (broken := self._violations.get(key)) is not None:
            return broken
        sides = ("subject", subject_type, self._domains), ("object", object_type, self._ranges)
        broken = [
            f"the {side} of {name} is a {cls}, which {etype} is not"
            for name in sorted(self.superproperties(relation) | {relation})
            for side, etype, stated in sides
            for cls in stated.get(name, ())
            if self.has_class(etype) and self.has_class(cls) and not self.is_subclass(etype, cls)
        ]
        self._violations[key] = broken  # complete: other threads read it at once
        return broken

    # -- values ------------------------------------------------------------------------------------------------

    def datatype(self, prop: str) -> str:
        """The range of a data property or of its superproperties; "" when none is declared."""
        for name in [prop, *sorted(self.superproperties(prop) - {prop})]:
            if self._ranges.get(name):
                return self._ranges[name][0]
        return ""

    def value_limits(self, etype: str, prop: str) -> tuple[str, int | None]:
        """The datatype ("": any) and the maximum number (None: any) of values of a property for a class."""
        key = (etype, prop)
        limits = self._limits.get(key)
        if limits is None:
            functional = any(_FUNCTIONAL in self._types.get(name, ()) for name in self.superproperties(prop))
            most: int | None = 1 if functional else None
            datatype = self.datatype(prop)
            for restriction in self.restrictions(etype):
                if restriction.property == prop:
                    datatype = datatype or next((f for f in restriction.fillers if f.startswith("xsd:")), "")
                    if restriction.most is not None:
                        most = restriction.most if most is None else min(most, restriction.most)
            limits = self._limits[key] = (datatype, most)
        return limits

    # -- restrictions ------------------------------------------------------------------------------------------

    def restrictions(self, etype: str) -> list[Restriction]:
        """The restrictions of a class and of its superclasses."""
        return [r for name in sorted(self.superclasses(etype)) for r in self._restrictions.get(name, ())]

    def allows(self, subject_type: str, relation: str, object_type: str) -> bool:
        """Whether the restrictions allow a relation between two classes.

        True if the subject's class, or one of its superclasses or subclasses, has a restriction on the relation or on a
        subproperty, with the object's class, a superclass or a subclass of it as a filler.
        """
        subjects = self.superclasses(subject_type) | self.subclasses(subject_type)
        return any(
            self.is_subproperty(restriction.property, relation)
            and any(self.is_subclass(f, object_type) or self.is_subclass(object_type, f) for f in restriction.fillers)
            for name in subjects
            for restriction in self._restrictions.get(name, ())
        )

    # -- individuals -------------------------------------------------------------------------------------------

    def types(self, name: str) -> list[str]:
        """The declared types of a name: `owl:Class`, or the classes of an individual."""
        return list(self._types.get(name, ()))

    def instance_types(self, types: Iterable[str]) -> list[str]:
        """The domain classes among the declared types of an individual, most specific first."""
        classes = sorted(t for t in set(types) if not t.startswith(_META) and not t.startswith("_:"))
        return sorted(classes, key=lambda t: sum(self.is_subclass(other, t) for other in classes))

    def individual(self, name: str) -> Individual | None:
        return self._individuals.get(name)

    def individuals(self, parent_class: str, recursive: bool = True) -> list[str]:
        """The individuals of a class, and with `recursive` of its subclasses, sorted."""
        wanted = self.subclasses(parent_class) if recursive else {parent_class}
        return sorted({name for cls in wanted for name in self._by_class.get(cls, ())})

    def individuals_related(self, subject: str, relation: str, obj: str) -> bool:
        """Whether one individual has a relation, or a subproperty of it, to another."""
        found = self._individuals.get(subject)
        return found is not None and any(o == obj and self.is_subproperty(p, relation) for p, o in found.relations)

    def with_classes(self, triples: Sequence[NamedTriple]) -> Ontology | None:
        """Returns a copy with additional classes; None when the triples declare anything else.

        Skill managers declare many classes when they start; copying avoids reading all triples again.
        """
        if not all(_is_class_statement(*triple) for triple in triples):
            return None
        other = copy.copy(self)
        other._superclasses = {name: list(above) for name, above in self._superclasses.items()}
        other._types = {name: list(types) for name, types in self._types.items()}
        other._closures, other._limits, other._violations = {}, {}, {}
        for subject, predicate, obj in triples:
            if predicate == "rdf:type":
                _append(other._types.setdefault(subject, []), obj)
            other._read_terms(subject, [(predicate, obj)], {})
        other._subclasses = _inverse(other._superclasses)
        return other

    # -- reading -----------------------------------------------------------------------------------------------

    def _read(self, triples: list[NamedTriple]) -> None:
        described: dict[str, list[tuple[str, Any]]] = {}
        for subject, predicate, obj in triples:
            described.setdefault(subject, []).append((predicate, obj))
            if predicate == "rdf:type":
                self._types.setdefault(subject, []).append(obj)
        for subject, statements in described.items():
            if not subject.startswith("_:"):
                self._read_terms(subject, statements, described)
        for name, types in self._types.items():
            classes = self.instance_types(types)
            if classes and not name.startswith("_:"):
                self._read_individual(name, classes, described[name])

    def _read_terms(
        self, subject: str, statements: list[tuple[str, Any]], described: dict[str, list[tuple[str, Any]]]
    ) -> None:
        for predicate, obj in statements:
            if not isinstance(obj, str):
                continue
            if predicate == "rdf:type":
                self._declare(subject, obj)
            elif predicate in ("rdfs:subClassOf", "owl:equivalentClass"):
                self._read_superclass(subject, obj, described, predicate == "owl:equivalentClass")
            elif predicate == "rdfs:subPropertyOf" and not obj.startswith("_:"):
                self._superproperties.setdefault(obj, [])
                _append(self._superproperties.setdefault(subject, []), obj)
            elif predicate == "rdfs:domain" and not obj.startswith("_:"):
                _append(self._domains.setdefault(subject, []), obj)
            elif predicate == "rdfs:range" and not obj.startswith("_:"):
                _append(self._ranges.setdefault(subject, []), obj)

    def _declare(self, subject: str, declared: str) -> None:
        if declared in _CLASS_TYPES:
            self._superclasses.setdefault(subject, [])
        elif declared in _RELATION_TYPES:
            self._superproperties.setdefault(subject, [])
            self._relations.add(subject)
        elif declared in _DATA_TYPES:
            self._superproperties.setdefault(subject, [])
            self._data_properties.add(subject)
        elif declared in ("rdf:Property", "owl:AnnotationProperty"):
            self._superproperties.setdefault(subject, [])
            self._relations.add(subject)
            self._data_properties.add(subject)

    def _read_superclass(
        self, subject: str, obj: str, described: dict[str, list[tuple[str, Any]]], equivalent: bool
    ) -> None:
        if not obj.startswith("_:"):
            self._superclasses.setdefault(obj, [])
            _append(self._superclasses.setdefault(subject, []), obj)
            if equivalent:
                _append(self._superclasses[obj], subject)
            return
        self._superclasses.setdefault(subject, [])
        for node in _members(obj, "owl:intersectionOf", described):
            if not node.startswith("_:"):
                self._superclasses.setdefault(node, [])
                _append(self._superclasses[subject], node)
                continue
            restriction = _restriction(described.get(node, []), described)
            if restriction is not None:
                self._restrictions.setdefault(subject, []).append(restriction)

    def _read_individual(self, name: str, classes: list[str], statements: list[tuple[str, Any]]) -> None:
        individual = Individual(name, classes)
        for predicate, obj in sorted(statements, key=str):
            if predicate in ("rdf:type", "rdfs:label"):
                continue
            if isinstance(obj, str):
                if not obj.startswith("_:"):
                    individual.relations.append((predicate, obj))
            else:
                individual.values.setdefault(predicate, []).append(obj[0])
        self._individuals[name] = individual
        for cls in classes:
            self._by_class.setdefault(cls, []).append(name)

    def _closure(self, kind: str, edges: dict[str, list[str]], name: str) -> frozenset[str]:
        key = (kind, name)
        closure = self._closures.get(key)
        if closure is None:
            seen = {name}
            waiting = [name]
            while waiting:
                for other in edges.get(waiting.pop(), ()):
                    if other not in seen:
                        seen.add(other)
                        waiting.append(other)
            closure = self._closures[key] = frozenset(seen)
        return closure


def _restriction(statements: list[tuple[str, Any]], described: dict[str, list[tuple[str, Any]]]) -> Restriction | None:
    prop = next((o for p, o in statements if p == "owl:onProperty" and isinstance(o, str)), "")
    if not prop or prop.startswith("_:"):
        return None
    fillers: list[str] = []
    most: int | None = None
    for predicate, obj in statements:
        if predicate in _FILLERS and isinstance(obj, str):
            fillers += [f for f in _members(obj, "owl:unionOf", described) if not f.startswith("_:")]
        elif predicate in (*_EXACT, *_MOST) and not isinstance(obj, str) and isinstance(obj[0], int):
            most = obj[0]
    return Restriction(prop, tuple(fillers), most)


def _members(
    node: str,
    operator: Literal["owl:unionOf", "owl:intersectionOf"],
    described: dict[str, list[tuple[str, Any]]],
) -> list[str]:
    """The members of a union or intersection; the node itself when it is neither of them."""
    link = next((o for p, o in described.get(node, ()) if p == operator), None)
    if not isinstance(link, str):
        return [node]
    members: list[str] = []
    seen: set[str] = set()
    while link not in seen and link != "rdf:nil":
        seen.add(link)
        cell = dict(described.get(link, ()))
        if isinstance(cell.get("rdf:first"), str):
            members.append(cell["rdf:first"])
        link = cell.get("rdf:rest", "rdf:nil")
    return members


def _is_class_statement(subject: str, predicate: str, obj: Any) -> bool:
    is_named = isinstance(obj, str) and not subject.startswith("_:") and not obj.startswith("_:")
    return is_named and (predicate == "rdfs:subClassOf" or (predicate == "rdf:type" and obj == "owl:Class"))


def _is_standard(name: str) -> bool:
    return name.startswith(_META) and bool(local_name(name))


def _append(items: list[str], item: str) -> None:
    if item not in items:
        items.append(item)


def _inverse(edges: dict[str, list[str]]) -> dict[str, list[str]]:
    inverse: dict[str, list[str]] = {}
    for child, parents in edges.items():
        for parent in parents:
            inverse.setdefault(parent, []).append(child)
    return inverse
