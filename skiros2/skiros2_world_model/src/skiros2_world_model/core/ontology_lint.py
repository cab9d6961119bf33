"""Mistakes in ontology files: undeclared names, wrong literals, relations between wrong classes, unused prefixes.

OWL allows all of them: a misspelt class is simply another class. The declarations of all loaded ontologies are known.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import pyoxigraph as ox

from skiros2_common.core.errors import WrongType, WrongValue
from skiros2_common.core.names import local_name, nearest
from skiros2_world_model.core.datatypes import as_datatype
from skiros2_world_model.core.ontology import Individual, NamedTriple, Ontology
from skiros2_world_model.core.prefixes import STANDARD, Prefixes
from skiros2_world_model.core.rdf import python_value
from skiros2_world_model.core.report import WARNING, Finding

UNKNOWN_CLASS, UNKNOWN_RELATION, UNKNOWN_PROPERTY = "unknown-class", "unknown-relation", "unknown-property"
WRONG_LITERAL, WRONG_ENDS, UNUSED_PREFIX = "wrong-literal", "domain-range", "unused-prefix"

_RDF = """
    Alt Bag HTML JSON List PlainLiteral Property Seq Statement XMLLiteral first langString nil object predicate
    rest subject type value
"""
_RDFS = """
    Class Container ContainerMembershipProperty Datatype Literal Resource comment domain isDefinedBy label
    member range seeAlso subClassOf subPropertyOf
"""
_OWL = """
    AllDifferent AllDisjointClasses AllDisjointProperties Annotation AnnotationProperty AsymmetricProperty Axiom
    Class DataRange DatatypeProperty DeprecatedClass DeprecatedProperty FunctionalProperty
    InverseFunctionalProperty IrreflexiveProperty NamedIndividual NegativePropertyAssertion Nothing
    ObjectProperty Ontology OntologyProperty ReflexiveProperty Restriction SymmetricProperty Thing
    TransitiveProperty allValuesFrom annotatedProperty annotatedSource annotatedTarget assertionProperty
    backwardCompatibleWith bottomDataProperty bottomObjectProperty cardinality complementOf datatypeComplementOf
    deprecated differentFrom disjointUnionOf disjointWith distinctMembers equivalentClass equivalentProperty
    hasKey hasSelf hasValue imports incompatibleWith intersectionOf inverseOf maxCardinality
    maxQualifiedCardinality members minCardinality minQualifiedCardinality onClass onDataRange onDatatype
    onProperties onProperty oneOf priorVersion propertyChainAxiom propertyDisjointWith qualifiedCardinality
    rational real sameAs someValuesFrom sourceIndividual targetIndividual targetValue topDataProperty
    topObjectProperty unionOf versionIRI versionInfo withRestrictions
"""
_XSD = """
    anySimpleType anyType anyURI base64Binary boolean byte date dateTime dateTimeStamp dayTimeDuration decimal
    double duration float gDay gMonth gMonthDay gYear gYearMonth hexBinary int integer language long Name NCName
    negativeInteger NMTOKEN nonNegativeInteger nonPositiveInteger normalizedString positiveInteger short string
    time token unsignedByte unsignedInt unsignedLong unsignedShort yearMonthDuration
"""

#: All terms of the standard vocabularies.
_TERMS = frozenset(
    f"{prefix}:{term}"
    for prefix, terms in (("rdf", _RDF), ("rdfs", _RDFS), ("owl", _OWL), ("xsd", _XSD))
    for term in terms.split()
)
#: The objects of these predicates are classes, and of those below properties.
_OF_CLASSES = (
    *("rdf:type", "rdfs:subClassOf", "owl:equivalentClass", "owl:disjointWith", "owl:complementOf", "rdfs:domain"),
    *("rdfs:range", "owl:onClass", "owl:onDataRange", "owl:someValuesFrom", "owl:allValuesFrom"),
)
_OF_PROPERTIES = ("rdfs:subPropertyOf", "owl:onProperty", "owl:inverseOf", "owl:equivalentProperty")

_TURTLE_NOISE = re.compile(r'"""[\s\S]*?"""|"(?:\\.|[^"\\\n])*"|<[^<>\s]*>|#.*')
_TURTLE_PREFIX = re.compile(r"(?:@prefix|\bPREFIX)\s+([\w.-]*):", re.IGNORECASE)


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """A hint with the name whose local part is nearest; "" when none is near."""
    by_local = {local_name(other): other for other in sorted(known, reverse=True)}
    near = nearest(local_name(name), by_local, 1)
    return f"; did you mean {by_local[near[0]]}?" if near else ""


class OntologyLint:
    """Checks files against all loaded ontologies.

    :param ontology: the index of all ontologies.
    :param described: the subjects of all triples; other names are only referred to.
    """

    def __init__(self, ontology: Ontology, described: set[str]) -> None:
        self._ontology = ontology
        self._classes = described.intersection(ontology.classes())
        self._properties = {*ontology.relations(), *ontology.data_properties()}
        self._own = ontology.prefixes()

    def findings(self, path: Path, triples: Iterable[NamedTriple]) -> list[Finding]:
        """The mistakes in the triples of a file, once for each element and name."""
        found: dict[Finding, None] = {}
        for subject, predicate, obj in triples:
            for code, name, text in self._of_triple(subject, predicate, obj):
                element = "" if subject.startswith("_:") else subject
                found.setdefault(Finding(WARNING, str(path), element, name, text, code))
        return list(found)

    def _of_triple(self, subject: str, predicate: str, obj: Any) -> Iterator[tuple[str, str, str]]:
        """Yields code, the name concerned, and text."""
        individual = self._ontology.individual(subject)
        is_node = isinstance(obj, str)
        if predicate.partition(":")[0] in STANDARD:
            if predicate not in _TERMS and not re.fullmatch(r"rdf:_\d+", predicate):
                yield UNKNOWN_PROPERTY, predicate, f"unknown property{did_you_mean(predicate, _TERMS)}"
        elif predicate not in self._properties and (individual is not None or prefix_of_name(predicate) in self._own):
            code, known = UNKNOWN_PROPERTY, self._ontology.data_properties()
            if is_node:
                code, known = UNKNOWN_RELATION, self._ontology.relations()
            yield code, predicate, f"{code.replace('-', ' ')}{did_you_mean(predicate, known)}"
        if predicate in _OF_CLASSES:
            yield from self._of_class(predicate, obj)
        elif predicate in _OF_PROPERTIES and is_node and not obj.startswith("_:"):
            if obj not in self._properties and obj not in _TERMS:
                yield UNKNOWN_PROPERTY, obj, f"unknown property, after {predicate}{did_you_mean(obj, self._properties)}"
        elif individual is not None and predicate in self._properties:
            yield from self._of_individual(individual, predicate, obj)

    def _of_class(self, predicate: str, obj: Any) -> Iterator[tuple[str, str, str]]:
        if not isinstance(obj, str):
            yield WRONG_LITERAL, predicate, "expected a class, got a literal"
        elif not obj.startswith("_:") and obj not in self._classes and obj not in _TERMS:
            known = _TERMS if obj.partition(":")[0] in STANDARD else self._classes
            yield UNKNOWN_CLASS, obj, f"unknown class, after {predicate}{did_you_mean(obj, known)}"

    def _of_individual(self, individual: Individual, key: str, obj: Any) -> Iterator[tuple[str, str, str]]:
        """The mistakes in a value or relation of an individual."""
        ontology = self._ontology
        other = ontology.individual(obj) if isinstance(obj, str) else None
        for text in ontology.domain_range_violations(individual.type, key, other.type if other is not None else ""):
            yield WRONG_ENDS, key, text
        if isinstance(obj, str) and not ontology.has_relation(key):
            yield WRONG_LITERAL, key, f"expected a literal, got {obj}"
        elif isinstance(obj, tuple) and not ontology.has_data_property(key):
            yield WRONG_LITERAL, key, "expected an element, got a literal"
        elif isinstance(obj, tuple) and obj[0] != "":  # existing ontologies write an unknown number as ""
            try:
                as_datatype(obj[0], ontology.value_limits(individual.type, key)[0])
            except WrongType as error:
                yield WRONG_LITERAL, key, str(error)


def literal_findings(path: Path, triples: Iterable[ox.Triple], prefixes: Prefixes) -> Iterator[Finding]:
    """The literals of a file whose text is not one of their datatype."""
    for triple in triples:
        if isinstance(triple.object, ox.Literal) and triple.object.value != "":
            try:
                python_value(triple.object)
            except WrongValue as error:
                datatype = prefixes.name(triple.object.datatype.value)
                subject = triple.subject.value if isinstance(triple.subject, ox.NamedNode) else ""
                key = prefixes.name(triple.predicate.value)
                text = f"wrong {datatype}: {error}"
                yield Finding(WARNING, str(path), prefixes.name(subject), key, text, WRONG_LITERAL)


def unused_prefixes(path: Path) -> list[Finding]:
    """The prefixes that a Turtle file declares and does not use."""
    text = _TURTLE_NOISE.sub(" ", path.read_text(errors="replace"))
    used = set(re.findall(r"([\w.-]*):", _TURTLE_PREFIX.sub(" ", text)))
    unused = [prefix for prefix in dict.fromkeys(_TURTLE_PREFIX.findall(text)) if prefix not in used]
    return [Finding(WARNING, str(path), "", f"{p}:", "the prefix is not used", UNUSED_PREFIX) for p in unused]


def prefix_of_name(name: str) -> str:
    """The prefix of a name such as `skiros:Product`."""
    return name.partition(":")[0]
