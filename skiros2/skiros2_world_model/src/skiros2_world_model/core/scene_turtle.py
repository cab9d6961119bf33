"""Scenes as sorted Turtle.

The elements of a class mostly have the same properties, one value each: their texts differ only in these values. Such
an element is one formatting of a template by `%`, in C; sorting and joining its statements takes three times as long.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from operator import attrgetter, itemgetter
from typing import Any, NamedTuple

import pyoxigraph as ox

from skiros2_common.core.changeset import Relation
from skiros2_world_model.core.datatypes import literal_parts
from skiros2_world_model.core.ontology import Ontology
from skiros2_world_model.core.prefixes import Prefixes
from skiros2_world_model.core.rdf import TurtleWriter
from skiros2_world_model.core.scene import ElementRecord

#: An element with more relations is written without a template.
_MAX_RELATIONS = 4

_values_of = attrgetter("current")
#: How values are written in a template, by type.
_FORMATS: dict[type, str] = {float: '"%r"', int: '"%s"', bool: '"%s"', str: "%s"}


def scene_turtle(
    records: Iterable[ElementRecord],
    relations: Iterable[Relation],
    extras: Iterable[ox.Triple],
    ontology: Ontology,
    prefixes: Prefixes,
) -> bytes:
    """Serializes elements, relations and extra triples as sorted Turtle, without building all triples first."""
    writer = _SceneWriter(ontology, prefixes)
    for triple in extras:
        writer.turtle.add(triple)
    outgoing: dict[str, list[tuple[str, str]]] = {}
    for src, pred, dst in relations:
        outgoing.setdefault(src, []).append((pred, dst))
    for record in records:
        writer.add(record, outgoing.pop(record.id, []))
    for src, more in outgoing.items():
        writer.relate(src, more)
    return writer.turtle.text()


class _Shape(NamedTuple):
    """What elements have in common that differ in their values only.

    :param template: of the paragraph, for the subject, the label, the values and the objects of relations.
    :param order: brings these into the order of the template.
    :param texts, flags: the indices of texts and of bools among them.
    """

    template: str
    order: Callable[[list[Any]], tuple[Any, ...]]
    texts: list[int]
    flags: list[int]


class _SceneWriter:
    """Adds elements and relations to `turtle`."""

    def __init__(self, ontology: Ontology, prefixes: Prefixes) -> None:
        self.turtle = TurtleWriter(prefixes.namespaces())
        self._ontology = ontology
        self._prefixes = prefixes
        self._names: dict[str, str] = {}
        self._predicates: dict[str, str] = {}
        self._forms: dict[tuple[str, str, type], tuple[str, str, str]] = {}
        self._shapes: dict[tuple[object, ...], _Shape | None] = {}

    def add(self, record: ElementRecord, relations: list[tuple[str, str]]) -> None:
        """Adds an element with its outgoing relations: predicate, object."""
        subject = self._written(record.id)
        text = "" if self.turtle.has(subject) else self._formatted(subject, record, relations)
        if text:
            self.turtle.add_paragraph(subject, text)
        else:
            self._add_statements(self.turtle.statements_on(subject), record)
            self.relate(record.id, relations)

    def relate(self, src: str, relations: Iterable[tuple[str, str]]) -> None:
        """Adds relations of an element."""
        statements = self.turtle.statements_on(self._written(src))
        for pred, dst in relations:
            statements.add(f"{self._predicate(pred)} {self._written(dst)}")

    def _written(self, name: str) -> str:
        known = self._names.get(name)
        if known is None:
            known = self._names[name] = self.turtle.node(self._prefixes.iri(name))
        return known

    def _predicate(self, name: str) -> str:
        known = self._predicates.get(name)
        if known is None:
            known = self._predicates[name] = self.turtle.predicate(self._prefixes.iri(name))
        return known

    # -- by a template -----------------------------------------------------------------------------------------

    def _formatted(self, subject: str, record: ElementRecord, relations: list[tuple[str, str]]) -> str:
        """The paragraph of an element; "" if there is no template for it."""
        if len(relations) > _MAX_RELATIONS:
            return ""
        properties = record.properties
        try:
            values: list[Any] = [value for [value] in map(_values_of, properties.values())]
        except ValueError:  # there are several, or none
            return ""
        ends = [(pred, self._written(dst)) for pred, dst in relations]
        ends.sort()
        preds = [pred for pred, _ in ends]
        key = (record.type, record.label == "", *properties, *map(type, values), *preds)
        try:
            shape = self._shapes[key]
        except KeyError:
            shape = self._shapes[key] = self._shape(record, values, preds)
        if shape is None:
            return ""
        values = [subject, record.label, *values, *[dst for _, dst in ends]]
        for index in shape.texts:
            values[index] = self.turtle.quoted(values[index])
        for index in shape.flags:
            values[index] = "true" if values[index] else "false"
        text = shape.template % shape.order(values)
        return "" if 'n"^^' in text or 'f"^^' in text else text  # it may have nan or inf, which are written differently

    def _shape(self, record: ElementRecord, values: list[Any], preds: list[str]) -> _Shape | None:
        """Makes a template; None if the order of the statements depends on the values, or they have other types."""
        types = [type(value) for value in values]
        if not _FORMATS.keys() >= set(types):
            return None
        slots = [(self._written("rdfs:label"), 1, "%s")] if record.label else []  # predicate, index, format
        for index, (key, value) in enumerate(zip(record.properties, values, strict=True), 2):
            predicate, _, suffix = self._form(record.type, key, value)
            slots.append((predicate, index, _FORMATS[type(value)] + _escaped(suffix)))
        single = [predicate for predicate, _, _ in slots]
        related = [self._predicate(pred) for pred in preds]
        if "" in related or len({*single, *related}) < len(single) + len(set(related)):
            return None
        slots += [(predicate, index, "%s") for index, predicate in enumerate(related, 2 + len(values))]
        slots.sort(key=itemgetter(0))
        types_of = sorted({self._written("owl:NamedIndividual"), self._written(record.type)})
        lines = [f"    a {_escaped(name)} ;\n" for name in types_of]
        lines += [f"    {_escaped(predicate)} {text} ;\n" for predicate, _, text in slots]
        return _Shape(
            f"%s\n{''.join(lines)}.\n",
            itemgetter(0, *[index for _, index, _ in slots]),
            [1] * bool(record.label) + [index for index, kind in enumerate(types, 2) if kind is str],
            [index for index, kind in enumerate(types, 2) if kind is bool],
        )

    # -- by statements -----------------------------------------------------------------------------------------

    def _add_statements(self, statements: set[str], record: ElementRecord) -> None:
        statements.add(f" {self._written('owl:NamedIndividual')}")
        statements.add(f" {self._written(record.type)}")
        if record.label:
            statements.add(f"{self._written('rdfs:label')} {self.turtle.quoted(record.label)}")
        for key, prop in record.properties.items():
            for value in prop.values:
                predicate, datatype, _ = self._form(record.type, key, value)
                statements.add(f"{predicate} {self.turtle.literal(literal_parts(value)[0], datatype)}")

    def _form(self, etype: str, key: str, value: object) -> tuple[str, str, str]:
        """The predicate of a value, the IRI of its datatype, and the suffix of its literal."""
        form = etype, key, value.__class__
        known = self._forms.get(form)
        if known is None:
            _, datatype = literal_parts(value, self._ontology.value_limits(etype, key)[0])
            known = self._forms[form] = self._written(key), datatype, self.turtle.datatype(datatype)
        return known


def _escaped(text: str) -> str:
    return text.replace("%", "%%")
