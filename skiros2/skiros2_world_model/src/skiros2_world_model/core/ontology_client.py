"""What both adapters of the ontologies do alike."""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from collections.abc import Sequence
from functools import lru_cache

from skiros2_common.core.names import DEFAULT_PREFIX, full_name
from skiros2_common.core.world_element import Element
from skiros2_world_model.core.context_names import ONTOLOGY
from skiros2_world_model.core.datatypes import literal_text
from skiros2_world_model.core.ontology import Ontology
from skiros2_world_model.core.prefixes import is_iri, prefix_of
from skiros2_world_model.core.statement import Statement
from skiros2_world_model.core.world_model_abstract_interface import WmException

_NOT_PLAIN = re.compile(r"[^\w-]")


@lru_cache(maxsize=10_000)
def _named(name: str, default_prefix: str) -> str:
    return name if is_iri(name) else full_name(name, default_prefix)


class OntologyAbstractInterface(ABC):
    """The calls on ontologies, made of those that the adapters define. Safe to use from all threads.

    Names may be written `prefix:Name`, `:Name` and `Name` (in the default prefix), or as IRIs.
    """

    def __init__(self) -> None:
        self._default_prefix = DEFAULT_PREFIX
        self._own_namespaces: dict[str, str] = {}

    # -- what adapters define ----------------------------------------------------------------------------------

    @property
    @abstractmethod
    def _ontology(self) -> Ontology:
        """What the ontologies say now."""

    @abstractmethod
    def _query(self, query: str, cut_prefix: bool, context: str) -> list[str]:
        """The rows of a SPARQL query."""

    @abstractmethod
    def _modify(self, statements: Sequence[Statement], context: str) -> None:
        """Adds and removes statements, all or none."""

    # -- writing -----------------------------------------------------------------------------------------------

    def add_class(self, class_uri: str, parent_uri: str, context: str = "") -> None:
        """Declares a class under another one."""
        name, parent = self._term(class_uri), self._term(parent_uri)
        self._modify([(name, "rdf:type", "owl:Class", True), (name, "rdfs:subClassOf", parent, True)], context)

    def add_datatype(self, data_uri: str, parent_uri: str, context: str = "") -> None:
        """Declares a datatype property under another one."""
        name, parent = self._term(data_uri), self._term(parent_uri)
        statements = [(name, "rdf:type", "owl:DatatypeProperty", True), (name, "rdfs:subPropertyOf", parent, True)]
        self._modify(statements, context)

    def add_individual(self, element: Element, context: str = "") -> None:
        """Adds an individual, such as a template, with the element's class, properties and relations.

        Its name is the element's label.

        :raises WmException: the element has no label.
        """
        if not element.label:
            raise WmException(f"{element!r} cannot become an individual: its label, which names it, is missing")
        name = self._term(element.label)
        statements: list[Statement] = [
            (name, "rdf:type", "owl:NamedIndividual", True),
            (name, "rdf:type", self._term(element.type), True),
        ]
        for prop in element._props.values():
            datatype = self._ontology.datatype(prop.key)
            statements += [(name, self._term(prop.key), literal_text(v, datatype), True) for v in prop.values]
        statements += [
            (name, self._term(r["type"]), self._term(r["dst"]), True) for r in element._rels if r["src"] == "-1"
        ]
        self._modify(statements, context)

    def add_ontology(self, uri: str) -> None:
        """Declares an ontology, whose IRI then gives a prefix to all."""
        self._modify([(f"<{uri.strip('<>')}>", "rdf:type", "owl:Ontology", True)], "")

    # -- prefixes ----------------------------------------------------------------------------------------------

    def set_default_prefix(self, default_prefix: str) -> None:
        """What `:Name` and `Name` stand for in the calls and queries of this client."""
        self._default_prefix = default_prefix.rstrip(":")

    def add_prefix(self, uri: str) -> None:
        """Makes the prefix of an ontology's IRI known to the calls and queries of this client."""
        self._own_namespaces[prefix_of(uri)] = uri.rstrip("#") + "#"

    def remove_prefix(self, uri: str) -> None:
        """Takes back `add_prefix`; the IRI or the prefix tells which."""
        self._own_namespaces.pop(prefix_of(uri) if is_iri(uri) else uri.rstrip(":"), None)

    # -- reading -----------------------------------------------------------------------------------------------

    def query_ontology(self, query: str, cut_prefix: bool = True, context: str = "") -> list[str]:
        """The rows that a SPARQL query gives, one text each, the values parted by a space.

        :param cut_prefix: `prefix:name` and plain values; else N3.
        :param context: the one to ask, `ontology` for the ontologies alone; "" asks all.
        :raises WmException: the query cannot be answered, or there is no such context.
        """
        return self._query(self._prologue() + query, cut_prefix, context)

    def get_individuals(self, parent_class: str, recursive: bool = True) -> list[str]:
        """The individuals of a class in the ontologies (templates), and with `recursive` of all classes under it."""
        return self._ontology.individuals(self._name(parent_class), recursive)

    def knows(self, name: str) -> bool:
        """Whether it is a class, property or individual of the ontologies, or a term of RDF and OWL themselves."""
        return self._ontology.knows(self._name(name))

    def get_type(self, uri: str) -> str:
        """What something is: the class of an element or individual, `owl:Class` of a class, and so on.

        :raises WmException: nothing is known of it.
        """
        types = self.get_types(uri)
        classes = self._ontology.instance_types(types)
        return classes[0] if classes else next((t for t in types if t != "owl:NamedIndividual"), types[0])

    def get_types(self, uri: str) -> list[str]:
        """All that something is declared to be.

        :raises WmException: nothing is known of it.
        """
        types = self.query_ontology(f"SELECT DISTINCT ?t WHERE {{ {self._sparql(uri)} a ?t }}")
        if not types:
            raise WmException(f"nothing is known of {uri!r}")
        return sorted(types)

    def get_triples(
        self, subj: str | None = None, pred: str | None = None, obj: str | None = None
    ) -> list[tuple[str, str, str]]:
        """The triples of all contexts with that subject, predicate and object (None: any), as names and texts.

        :param obj: a name, or a literal in N3, such as `"Idle"`.
        """
        given = {"s": subj, "p": pred, "o": obj}
        fixed = " ".join(f"VALUES ?{v} {{ {self._sparql(text)} }}" for v, text in given.items() if text is not None)
        rows = self.query_ontology(f"SELECT DISTINCT ?s ?p ?o WHERE {{ {fixed} ?s ?p ?o }}")
        found = (row.split(" ", 2) for row in rows)
        return [(s, p, o) for s, p, o in found]

    def get_super_class(self, child_class: str) -> str:
        """The first class directly above; "" when there is none."""
        return next(iter(self._ontology.direct_superclasses(self._name(child_class))), "")

    def get_sub_classes(self, parent_class: str, recursive: bool = True) -> list[str]:
        """The classes directly under a class, or with `recursive` all under it, sorted; without itself."""
        name = self._name(parent_class)
        found = self._ontology.subclasses(name) if recursive else self._ontology.direct_subclasses(name)
        return sorted(set(found) - {name})

    def get_sub_properties(self, parent_property: str, recursive: bool = True) -> list[str]:
        """The properties directly under a property, or with `recursive` all under it, sorted; without itself."""
        name = self._name(parent_property)
        found = self._ontology.subproperties(name) if recursive else self._ontology.direct_subproperties(name)
        return sorted(set(found) - {name})

    def get_datatype(self, property: str) -> str:
        """The datatype that a property's values have, such as `xsd:float`; `xsd:string` when none is declared."""
        return self._ontology.datatype(self._name(property)) or "xsd:string"

    def is_subclass(self, child: str, parent: str) -> bool:
        """Whether a class is another one or under it."""
        return child == parent or self._ontology.is_subclass(self._name(child), self._name(parent))

    def is_subproperty(self, child: str, parent: str) -> bool:
        """Whether a property is another one or under it."""
        return child == parent or self._ontology.is_subproperty(self._name(child), self._name(parent))

    # -- names -------------------------------------------------------------------------------------------------

    def _name(self, name: str) -> str:
        return _named(name, self._default_prefix)

    def _term(self, name: str) -> str:
        """A name as the server reads it; prefixes that only this client knows are written out."""
        if is_iri(name):
            return f"<{name.strip('<>')}>"
        name = full_name(name, self._default_prefix)
        prefix, _, local = name.partition(":")
        return f"<{self._own_namespaces[prefix]}{local}>" if prefix in self._own_namespaces else name

    def _sparql(self, text: str) -> str:
        """A name or literal as SPARQL writes it."""
        if text[:1] in ('"', "<"):
            return text
        if is_iri(text):
            return f"<{text}>"
        prefix, _, local = full_name(text, self._default_prefix).partition(":")
        return f"{prefix}:" + _NOT_PLAIN.sub(lambda match: "\\" + match.group(), local)

    def _prologue(self) -> str:
        lines = [f"PREFIX {prefix}: <{namespace}>\n" for prefix, namespace in self._own_namespaces.items()]
        if self._default_prefix in self._own_namespaces:
            lines.append(f"PREFIX : <{self._own_namespaces[self._default_prefix]}>\n")
        elif self._default_prefix != DEFAULT_PREFIX:
            found = self._query(f"SELECT ?x WHERE {{ BIND({self._default_prefix}: AS ?x) }}", False, ONTOLOGY)
            lines.append(f"PREFIX : {found[0]}\n")
        return "".join(lines)
