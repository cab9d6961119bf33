"""The classes, templates, relations and properties of the ontologies, with descriptions, units and limits, for editors.

Read by a worker thread; immutable, so any thread may use it.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, TypeVar

from skiros2_common.core.errors import WrongType, WrongValue
from skiros2_common.core.limits import Limits
from skiros2_common.core.names import local_name
from skiros2_common.core.operations import ONTOLOGY, SPATIAL
from skiros2_common.core.property import from_text
from skiros2_common.core.world_model_port import OntologyPort
from skiros2_world_model.core.datatypes import PYTHON_TYPES, as_datatype
from skiros2_world_model.core.ontology import STRUCTURE_QUERY, Ontology

T = TypeVar("T")

_TEXT_QUERY = """SELECT ?s ?p ?o WHERE { ?s ?p ?o . FILTER(!isBlank(?s))
    VALUES ?p { rdfs:comment skiros:Unit skiros:LowerBound skiros:UpperBound } }"""
#: The values of an enumerated datatype, with the position of each in its list.
_CHOICES_QUERY = """SELECT ?p ?value (COUNT(?before) AS ?position) WHERE {
    ?p rdfs:range/owl:oneOf ?list . ?list rdf:rest* ?before . ?before rdf:rest* ?cell . ?cell rdf:first ?value
    } GROUP BY ?p ?cell ?value ORDER BY ?position"""
_META = ("rdf:", "rdfs:", "owl:", "xsd:", "_:")
_NUMBER = re.compile(r"[-+]?[\d.]+(?:[eE][-+]?\d+)?")
_WITH_UNIT = re.compile(rf"({_NUMBER.pattern})\s*([^\d\s.,]\S*)")
_SKILL_RELATION = "skiros:skillProperty"
_VALUE_RELATION = "skiros:hasValue"
_DOMAIN, _RANGE = "rdfs:domain", "rdfs:range"
_COMMENT, _UNIT, _MINIMUM, _MAXIMUM = "rdfs:comment", "skiros:Unit", "skiros:LowerBound", "skiros:UpperBound"


@dataclass(frozen=True)
class Predicate:
    """A relation of the ontologies.

    :param domain: the classes of subjects; () for any.
    :param range: the classes of objects; () for any.
    """

    name: str
    description: str
    domain: tuple[str, ...] = ()
    range: tuple[str, ...] = ()


class Vocabulary:
    """:param triples: of the ontologies, without literals.
    :param texts: comments, units and bounds: subject, predicate, text.
    :param choices: the values of enumerated properties, in order: property, value.
    """

    def __init__(
        self,
        triples: Iterable[tuple[str, str, str]],
        texts: Iterable[tuple[str, str, str]],
        choices: Iterable[tuple[str, Any]] = (),
    ) -> None:
        triples = list(triples)
        self.ontology = Ontology(triples)
        self._texts: dict[str, dict[str, str]] = {}  # by predicate, then by name
        for subject, predicate, text in texts:
            self._texts.setdefault(predicate, {})[subject] = text
        self._choices: dict[str, tuple[Any, ...]] = {}
        for name, value in choices:
            self._choices[name] = (*self._choices.get(name, ()), value)
        self._ends: dict[str, dict[str, tuple[str, ...]]] = {_DOMAIN: {}, _RANGE: {}}
        for subject, predicate, obj in triples:
            if predicate in self._ends and not obj.startswith("_:"):
                ends = self._ends[predicate]
                ends[subject] = (*ends.get(subject, ()), obj)
        #: The relations from a parent to a child.
        self.spatial = self.ontology.subproperties(SPATIAL)
        #: The relations from a skill to its parts.
        self.parts = self.ontology.subproperties(_SKILL_RELATION) - self.ontology.subproperties(_VALUE_RELATION)

    # -- classes and templates ---------------------------------------------------------------------------------

    def classes(self) -> list[str]:
        """Returns all classes, sorted."""
        return sorted(name for name in self.ontology.classes() if not name.startswith(_META))

    def top_classes(self) -> list[str]:
        """Returns the classes without superclass."""
        return [name for name in self.classes() if not self._superclasses(name)]

    def subclasses(self, name: str) -> list[str]:
        """Returns the direct subclasses, sorted."""
        return sorted({c for c in self.ontology.direct_subclasses(name) if not c.startswith(_META)} - {name})

    def templates(self, etype: str = "", below: bool = False) -> list[str]:
        """Returns the templates of a class, and of its subclasses with `below`; "" for all."""
        if not etype:
            return sorted({name for cls in self.classes() for name in self.ontology.individuals(cls, False)})
        return self.ontology.individuals(etype, below)

    def type_of(self, template: str) -> str:
        """Returns the class of a template; "" if it does not exist."""
        found = self.ontology.individual(template)
        return found.type if found is not None else ""

    def description(self, name: str) -> str:
        """Returns the comment of a name, or ""."""
        return self._texts.get(_COMMENT, {}).get(name, "")

    def _superclasses(self, name: str) -> list[str]:
        return [c for c in self.ontology.direct_superclasses(name) if not c.startswith(_META) and c != name]

    # -- relations ---------------------------------------------------------------------------------------------

    def predicates(self) -> list[Predicate]:
        """Returns the relations, spatial ones first, then by name."""
        names = [name for name in self.ontology.relations() if not name.startswith(_META)]
        names.sort(key=lambda name: (name not in self.spatial, name))
        return [self.predicate(name) for name in names]

    def predicate(self, name: str) -> Predicate:
        """Returns a relation; domain and range are inherited from its superproperties."""
        domain, range_ = (self._inherited(self._ends[end], name) or () for end in (_DOMAIN, _RANGE))
        return Predicate(name, self.description(name), domain, range_)

    def mismatch(self, subject_type: str, predicate: str, object_type: str) -> str:
        """Returns why a relation violates its domain or range; "" if it does not. The world model accepts it."""
        return "; ".join(self.ontology.domain_range_violations(subject_type, predicate, object_type))

    def _inherited(self, known: Mapping[str, T], name: str) -> T | None:
        """Returns the value of a property, or else of the nearest superproperty that has one."""
        waiting = [name]
        for one in waiting:
            if one in known:
                return known[one]
            waiting += [above for above in sorted(self.ontology.superproperties(one)) if above not in waiting]
        return None

    # -- properties --------------------------------------------------------------------------------------------

    def data_properties(self) -> list[str]:
        """Returns all data properties, sorted."""
        return [name for name in self.ontology.data_properties() if not name.startswith(_META)]

    def unit(self, key: str) -> str:
        """Returns the unit of a property, or ""."""
        return self._inherited_text(key, _UNIT)

    def limits(self, key: str) -> Limits:
        """Returns the unit, the bounds and the enumerated values of a property; superproperties count."""
        low, high = (self._inherited_text(key, bound) for bound in (_MINIMUM, _MAXIMUM))
        choices = self._inherited(self._choices, key) or ()
        return Limits(self.unit(key), float(low) if low else None, float(high) if high else None, choices)

    def _inherited_text(self, key: str, predicate: str) -> str:
        return self._inherited(self._texts.get(predicate, {}), key) or ""

    def value_type(self, etype: str, key: str, current: type | None = None) -> type:
        """Returns the Python type of a property's values.

        :param etype: the class of the element.
        :param current: the type of the current values, used if the ontologies declare none.
        """
        datatype, _ = self.ontology.value_limits(etype, key)
        if datatype in PYTHON_TYPES:
            return PYTHON_TYPES[datatype]
        if choices := self.limits(key).choices:
            return type(choices[0])
        if current is not None:
            return current
        return float if self.unit(key) else str

    def is_declared(self, key: str) -> bool:
        """Returns whether the ontologies declare the property."""
        return self.ontology.has_data_property(key)

    def parsed(self, etype: str, key: str, text: str, current: type | None = None) -> object:
        """Parses the text of a value; a number may be followed by the property's unit.

        :raises WrongValue: the text is invalid, or has a different unit.
        """
        kind, unit = self.value_type(etype, key, current), self.unit(key)
        datatype, _ = self.ontology.value_limits(etype, key)
        if kind in (int, float):
            text = self._without_unit(key, text.strip(), unit)
        try:
            value = from_text(text, kind)
            if datatype:
                value = as_datatype(value, datatype)
        except (WrongType, WrongValue):
            what = {int: "a whole number", float: "a number", bool: "True or False"}.get(kind, kind.__name__)
            in_unit = f" (in {unit})" if unit else ""
            raise WrongValue(f"{local_name(key)}: expected {what}{in_unit}, got {text!r}") from None
        if isinstance(value, float) and (value != value or value in (float("inf"), float("-inf"))):
            raise WrongValue(f"{local_name(key)}: expected a finite number, got {text!r}")
        if problem := self.limits(key).problem([value]):
            raise WrongValue(f"{local_name(key)}: {problem}")
        return value

    def _without_unit(self, key: str, text: str, unit: str) -> str:
        match = _WITH_UNIT.fullmatch(text)
        if match is None or _NUMBER.fullmatch(text):
            return text
        if match[2] != unit:
            expected = f"expected {unit}" if unit else "expected none"
            raise WrongValue(f"{local_name(key)}: got the unit {match[2]!r}, {expected}")
        return match[1]


def read_vocabulary(world: OntologyPort) -> Vocabulary:
    """Reads the vocabulary of a world model. Blocks for three calls.

    :raises WmException: it does not answer.
    """
    _, triples = world.query_table(STRUCTURE_QUERY, ONTOLOGY)
    _, texts = world.query_table(_TEXT_QUERY, ONTOLOGY)
    _, choices = world.query_table(_CHOICES_QUERY, ONTOLOGY)
    return Vocabulary(
        [(str(s), str(p), str(o)) for s, p, o in triples],
        [(str(s), str(p), str(text)) for s, p, text in texts],
        [(str(key), value) for key, value, _ in choices],
    )
