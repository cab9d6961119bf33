"""The calls of a world model client that concern the ontologies."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from functools import lru_cache

from skiros2_common.core.errors import WrongValue
from skiros2_common.core.names import DEFAULT_PREFIX, full_name
from skiros2_common.core.operations import ONTOLOGY, SCENE, Statement
from skiros2_common.core.property import from_text
from skiros2_common.core.world_element import Element
from skiros2_common.core.world_model_port import Cell
from skiros2_world_model.core.datatypes import PYTHON_TYPES, literal_text
from skiros2_world_model.core.prefixes import Prefixes, is_iri
from skiros2_world_model.core.transport import Transport
from skiros2_world_model.core.wm_errors import WmException, wm_errors

_NOT_PLAIN = re.compile(r"[^\w-]")


@lru_cache(maxsize=10_000)
def _named(name: str, default_prefix: str) -> str:
    return name if is_iri(name) else full_name(name, default_prefix)


def table(text: str) -> tuple[list[str], list[list[Cell]]]:
    """The names of the columns and the rows of an answer in the SPARQL JSON format; see `query_table`."""
    answer = json.loads(text)
    if "boolean" in answer:
        return [], [[answer["boolean"]]]
    names, prefixes = answer["head"]["vars"], Prefixes()
    bindings = answer["results"]["bindings"]
    return names, [[_cell(row.get(name), prefixes) for name in names] for row in bindings]


def _cell(term: dict[str, str] | None, prefixes: Prefixes) -> Cell:
    """The name or Python value of a term in the SPARQL JSON format."""
    if term is None:
        return None
    if term["type"] == "uri":
        return prefixes.name(term["value"])
    if term["type"] == "bnode":
        return f"_:{term['value']}"
    try:
        value: Cell = from_text(term["value"], PYTHON_TYPES.get(prefixes.name(term.get("datatype", "")), str))
        return value
    except WrongValue:
        return term["value"]


class OntologyClient:
    """The calls of a client that concern the ontologies, and the RDF view of all contexts. Thread-safe.

    Names may be written as `prefix:Name`, as `:Name` or `Name` (in the default prefix), or as IRIs. Every call may
    raise `WmException` when the world model refuses or does not answer; then nothing has changed.

    :param transport: the connection to the world model.
    """

    def __init__(self, transport: Transport) -> None:
        self.transport = transport
        self._default_prefix = DEFAULT_PREFIX

    def is_connected(self) -> bool:
        """Returns whether the server answers."""
        return self.transport.server.is_connected()

    def lock(self) -> bool:
        """Acquires the advisory lock of the world model; blocks until it is free. Returns True."""
        return self.transport.server.lock()

    def unlock(self) -> bool:
        """Releases the advisory lock. Returns False when it is not held."""
        return self.transport.server.unlock()

    # -- files -------------------------------------------------------------------------------------------------

    def load(self, filename: str = "", context: str = SCENE) -> bool:
        """Replaces a context with the content of a file of the server's workspace. Returns True.

        :param filename: relative to the workspace; "": the file that the context was last loaded from or saved to.
        :raises WmException: the file is refused; the current content stays.
        """
        with wm_errors():
            self.transport.load(filename, context)
        return True

    def save(self, filename: str = "", context: str = SCENE) -> bool:
        """Writes a context to a file of the server's workspace as Turtle; `filename` as for `load`. Returns True.

        :raises WmException: the file is refused.
        """
        with wm_errors():
            self.transport.server.save(filename, context)
        return True

    # -- writing -----------------------------------------------------------------------------------------------

    def add_class(self, class_uri: str, parent_uri: str, context: str = "") -> bool:
        """Declares a class as a subclass of another one. Returns True."""
        name, parent = self._term(class_uri), self._term(parent_uri)
        self._modify([(name, "rdf:type", "owl:Class", True), (name, "rdfs:subClassOf", parent, True)], context)
        return True

    def add_datatype(self, data_uri: str, parent_uri: str, context: str = "") -> bool:
        """Declares a datatype property as a subproperty of another one. Returns True."""
        name, parent = self._term(data_uri), self._term(parent_uri)
        statements = [(name, "rdf:type", "owl:DatatypeProperty", True), (name, "rdfs:subPropertyOf", parent, True)]
        self._modify(statements, context)
        return True

    def add_individual(self, element: Element, context: str = "") -> bool:
        """Adds an individual, such as a template, with the element's class, properties and relations. Returns True.

        :param element: its label becomes the name of the individual.
        :raises WmException: the element has no label.
        """
        if not element.label:
            raise WmException(f"{element!r} cannot become an individual: its label, which names it, is missing")
        name = self._term(element.label)
        statements: list[Statement] = [
            (name, "rdf:type", "owl:NamedIndividual", True),
            (name, "rdf:type", self._term(element.type), True),
        ]
        for prop in element.property_view.values():
            datatype = self.transport.ontology.datatype(self._name(prop.key))
            statements += [(name, self._term(prop.key), literal_text(v, datatype), True) for v in prop.values]
        statements += [
            (name, self._term(r["type"]), self._term(r["dst"]), True) for r in element.relation_view if r["src"] == "-1"
        ]
        self._modify(statements, context)
        return True

    def add_ontology(self, uri: str) -> bool:
        """Declares an ontology, whose IRI defines a prefix for all clients. Returns True."""
        self._modify([(f"<{uri.strip('<>')}>", "rdf:type", "owl:Ontology", True)], "")
        return True

    # -- prefixes ----------------------------------------------------------------------------------------------

    def set_default_prefix(self, default_prefix: str) -> None:
        """Sets the prefix of `:Name` and `Name` in the calls and queries of this client."""
        self._default_prefix = default_prefix.rstrip(":")

    def add_prefix(self, uri: str) -> str:
        """Returns a name with its prefix: adds the default prefix to `X` and `:X`, and `<...>` around an IRI."""
        return self._term(uri)

    def remove_prefix(self, uri: str) -> str:
        """Returns a name without its prefix: the part after the last `#`, or else after the last `:`."""
        text = uri.strip("<>")
        return text.rpartition("#" if "#" in text else ":")[2]

    # -- reading -----------------------------------------------------------------------------------------------

    def query_ontology(self, query: str, cut_prefix: bool = True, context: str = "") -> list[str]:
        """Answers a SPARQL query with a text for each row; in rows of several columns a space follows each value.

        :param cut_prefix: returns `prefix:name` and plain values instead of N3.
        :param context: the context to query; "": all, `ontology`: only the ontologies.
        :raises WmException: the query cannot be answered.
        """
        return self._query(self._prologue() + query, cut_prefix, context)

    def query_table(self, query: str, context: str = "") -> tuple[list[str], list[list[Cell]]]:
        """Answers a SPARQL query with the names of the columns and the rows.

        A cell is a name, a Python value, or None where nothing is bound. An ASK query has one cell and no names.

        :param context: as for `query_ontology`.
        :raises WmException: the query cannot be answered.
        """
        with wm_errors():
            return table(self.transport.server.query_json(self._prologue() + query, context))

    def get_individuals(self, parent_class: str, recursive: bool = True) -> list[str]:
        """The individuals of a class in the ontologies (templates) and the elements of the scene, sorted.

        :param recursive: includes the subclasses.
        """
        name = self._name(parent_class)
        with wm_errors():
            elements = self.transport.scene.matching(Element(name), SCENE)
        found = [e.id for e in elements if recursive or e.type == name]
        return sorted({*self.get_templates(parent_class, recursive), *found})

    def get_templates(self, parent_class: str, recursive: bool = True) -> list[str]:
        """The individuals of a class in the ontologies, and with `recursive` of its subclasses, sorted."""
        return self.transport.ontology.individuals(self._name(parent_class), recursive)

    def knows(self, name: str) -> bool:
        """Whether a name is a class, property or individual of the ontologies, or a term of RDF or OWL."""
        return self.transport.ontology.knows(self._name(name))

    def get_type(self, uri: str) -> list[str]:
        """The types of an element, individual, class or property, sorted; [] for an unknown name."""
        return sorted(self.query_ontology(f"SELECT DISTINCT ?t WHERE {{ {self._sparql(uri)} a ?t }}"))

    def get_types(self, uri: str) -> list[str]:
        """The names of all elements, individuals, classes or properties of a type, sorted."""
        return sorted(self.query_ontology(f"SELECT DISTINCT ?x WHERE {{ ?x a {self._sparql(uri)} }}"))

    def declared_names(self, kind: str) -> list[str]:
        """The names that the ontologies declare with a type such as `owl:Class` or `owl:NamedIndividual`, sorted.

        From memory.
        """
        return self.transport.ontology.declared(self._name(kind))

    def properties_of_range(self, datatype: str) -> list[str]:
        """The data properties with a range such as `xsd:boolean`, sorted; from memory."""
        ontology, wanted = self.transport.ontology, self._name(datatype)
        return [name for name in ontology.data_properties() if ontology.datatype(name) == wanted]

    def get_triples(self, subj: str | None = None, pred: str | None = None, obj: str | None = None) -> list[str]:
        """The triples of all contexts that match a subject, predicate and object, as texts.

        A text has the parts that are None, separated by a space; all three when all are given.

        :param obj: a name, or a literal in N3, such as `"Idle"`.
        """
        given = {"?s": subj, "?p": pred, "?o": obj}
        fixed = " ".join(f"VALUES {v} {{ {self._sparql(text)} }}" for v, text in given.items() if text is not None)
        columns = [v for v, text in given.items() if text is None] or list(given)
        rows = self.query_ontology(f"SELECT DISTINCT {' '.join(columns)} WHERE {{ {fixed} ?s ?p ?o }}")
        return [row.removesuffix(" ") for row in rows] if len(columns) > 1 else rows

    def get_super_class(self, child_class: str) -> str:
        """The first direct superclass; "" when there is none."""
        return next(iter(self.transport.ontology.direct_superclasses(self._name(child_class))), "")

    def get_sub_classes(self, parent_class: str, recursive: bool = True) -> list[str]:
        """The class and all its subclasses, or without `recursive` only its direct subclasses, sorted.

        [] for an unknown class.
        """
        name = self._name(parent_class)
        if not recursive:
            return sorted(set(self.transport.ontology.direct_subclasses(name)) - {name})
        return sorted(self.transport.ontology.subclasses(name)) if self.transport.ontology.has_class(name) else []

    def get_sub_properties(self, parent_property: str, recursive: bool = True) -> list[str]:
        """The property and all its subproperties, or without `recursive` only its direct subproperties, sorted.

        [] for an unknown property.
        """
        name = self._name(parent_property)
        if not recursive:
            return sorted(set(self.transport.ontology.direct_subproperties(name)) - {name})
        return sorted(self.transport.ontology.subproperties(name)) if self.transport.ontology.has_property(name) else []

    def get_datatype(self, property: str) -> str | None:
        """The datatype of a property, such as `xsd:float`; None when none is declared."""
        return self.transport.ontology.datatype(self._name(property)) or None

    def is_subclass(self, child: str, parent: str) -> bool:
        """Whether `child` is `parent` or one of its subclasses."""
        prefix = self._default_prefix
        return child == parent or self.transport.ontology.is_subclass(_named(child, prefix), _named(parent, prefix))

    def is_subproperty(self, child: str, parent: str) -> bool:
        """Whether `child` is `parent` or one of its subproperties."""
        prefix = self._default_prefix
        return child == parent or self.transport.ontology.is_subproperty(_named(child, prefix), _named(parent, prefix))

    # -- helpers -----------------------------------------------------------------------------------------------

    def _query(self, query: str, cut_prefix: bool, context: str) -> list[str]:
        with wm_errors():
            return self.transport.server.query(query, cut_prefix, context)

    def _modify(self, statements: Sequence[Statement], context: str) -> None:
        with wm_errors():
            self.transport.modify(statements, context)

    def _name(self, name: str) -> str:
        return _named(name, self._default_prefix)

    def _term(self, name: str) -> str:
        """A name in the server's syntax."""
        return f"<{name.strip('<>')}>" if is_iri(name) else full_name(name, self._default_prefix)

    def _sparql(self, text: str) -> str:
        """A name or literal in SPARQL syntax."""
        if text[:1] in ('"', "<"):
            return text
        if is_iri(text):
            return f"<{text}>"
        name = full_name(text, self._default_prefix)
        prefix, _, local = name.partition(":")
        if prefix not in self.transport.ontology.prefixes():
            return f"<{self._iri(name)}>"
        return f"{prefix}:" + _NOT_PLAIN.sub(lambda match: "\\" + match.group(), local)

    def _iri(self, name: str) -> str:
        """The IRI of a name whose prefix no ontology declares: in a namespace that a scene uses, or the default one."""
        prefix, _, local = name.partition(":")
        try:
            (namespace,) = self._query(f"SELECT ?x WHERE {{ BIND({prefix}: AS ?x) }}", False, ONTOLOGY)
        except WmException:
            return Prefixes().iri(name)
        return namespace.strip("<>") + local

    def _prologue(self) -> str:
        if self._default_prefix == DEFAULT_PREFIX:
            return ""
        found = self._query(f"SELECT ?x WHERE {{ BIND({self._default_prefix}: AS ?x) }}", False, ONTOLOGY)
        return f"PREFIX : {found[0]}\n"
