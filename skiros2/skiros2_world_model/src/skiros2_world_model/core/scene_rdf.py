"""Scenes as RDF: elements from triples, triples from elements, and a store that follows a scene."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
from itertools import chain

import pyoxigraph as ox

from skiros2_common.core.errors import WrongValue
from skiros2_common.core.names import id_number
from skiros2_common.core.property import Property
from skiros2_world_model.core.checks import Checks
from skiros2_world_model.core.ontology import Ontology
from skiros2_world_model.core.prefixes import OWL, RDFS, Prefixes
from skiros2_world_model.core.scene import Dirty, Node, Provenance, Scene
from skiros2_world_model.core.terms import RDF_TYPE, literal, python_value
from skiros2_world_model.core.triple_store import TripleStore

_LABEL = ox.NamedNode(RDFS + "label")
_NAMED_INDIVIDUAL = ox.NamedNode(OWL + "NamedIndividual")


@dataclass
class SceneContent:
    """What a file says of a scene.

    :param extras: triples that no element holds, such as comments on the file itself; they are kept and saved again.
    """

    nodes: list[Node] = field(default_factory=list)
    relations: list[tuple[str, str, str]] = field(default_factory=list)
    extras: list[ox.Triple] = field(default_factory=list)


def read_scene(
    triples: Iterable[ox.Triple],
    ontology: Ontology,
    prefixes: Prefixes,
    checks: Checks,
    origin: str,
    made: Provenance,
) -> SceneContent:
    """The elements that triples describe: the individuals of a class of the ontologies, or of an unknown one.

    :param checks: notes unknown names.
    :param origin: the file, for messages.
    :param made: what the elements are to know of their last change.
    :raises WrongValue, WrongType: a value cannot be read, or is not of its property's type.
    """
    content = SceneContent()
    described: dict[ox.NamedNode, list[ox.Triple]] = {}
    for triple in triples:
        if isinstance(triple.subject, ox.NamedNode):
            described.setdefault(triple.subject, []).append(triple)
        else:
            content.extras.append(triple)
    for subject, statements in described.items():
        node = _read_element(prefixes.name(subject.value), statements, ontology, prefixes, checks, origin, content)
        if node is not None:
            content.nodes.append(replace(node, made=made))
    return content


def _read_element(
    eid: str,
    statements: list[ox.Triple],
    ontology: Ontology,
    prefixes: Prefixes,
    checks: Checks,
    origin: str,
    content: SceneContent,
) -> Node | None:
    """The element that the statements about one subject describe; what is beside it goes into `content`."""
    declared = [
        prefixes.name(t.object.value)
        for t in statements
        if t.predicate == RDF_TYPE and isinstance(t.object, ox.NamedNode)
    ]
    types = ontology.instance_types(declared)
    if not types and id_number(eid) >= 0 and "owl:Ontology" not in declared:
        types = [eid.rpartition("-")[0]]  # the id says it
    if not types:
        content.extras += statements
        return None
    etype = checks.class_name(types[0], eid)
    labels: list[str] = []
    values: dict[str, list[ox.Literal]] = {}
    for triple in statements:
        obj = triple.object
        if triple.predicate == RDF_TYPE:
            if prefixes.name(getattr(obj, "value", "")) not in (etype, "owl:NamedIndividual"):
                content.extras.append(triple)
        elif isinstance(obj, ox.NamedNode):
            pred = checks.relation_name(prefixes.name(triple.predicate.value), eid)
            content.relations.append((eid, pred, prefixes.name(obj.value)))
        elif not isinstance(obj, ox.Literal):
            content.extras.append(triple)
        elif triple.predicate == _LABEL:
            labels.append(obj.value)
        else:
            values.setdefault(prefixes.name(triple.predicate.value), []).append(obj)
    properties: dict[str, Property] = {}
    for key in sorted(values):
        try:
            found = [python_value(v) for v in sorted(values[key], key=str)]
        except WrongValue as error:
            raise WrongValue(f"{origin}: {eid}: {key}: {error}") from None
        prop = Property(key, found if len({type(v) for v in found}) == 1 else [str(v) for v in found])
        properties[key] = checks.property(etype, key, prop, eid)
    return Node(eid, etype, min(labels, default=""), properties)


def element_triples(node: Node, ontology: Ontology, prefixes: Prefixes) -> Iterator[ox.Triple]:
    """The triples of an element, without its relations."""
    subject = ox.NamedNode(prefixes.iri(node.id))
    yield ox.Triple(subject, RDF_TYPE, _NAMED_INDIVIDUAL)
    yield ox.Triple(subject, RDF_TYPE, ox.NamedNode(prefixes.iri(node.type)))
    if node.label:
        yield ox.Triple(subject, _LABEL, ox.Literal(node.label))
    for key, prop in node.properties.items():
        if prop.values:
            predicate = ox.NamedNode(prefixes.iri(key))
            datatype = ontology.value_limits(node.type, key)[0]
            for value in prop.values:
                yield ox.Triple(subject, predicate, literal(value, datatype))


def relation_triple(relation: tuple[str, str, str], prefixes: Prefixes) -> ox.Triple:
    """The triple of a relation."""
    src, pred, dst = (ox.NamedNode(prefixes.iri(name)) for name in relation)
    return ox.Triple(src, pred, dst)


def scene_triples(scene: Scene, ontology: Ontology, prefixes: Prefixes) -> Iterator[ox.Triple]:
    """All triples of a scene."""
    for node in scene:
        yield from element_triples(node, ontology, prefixes)
    for relation in scene.relations():
        yield relation_triple(relation, prefixes)


class Mirror:
    """Keeps one context of the store in step with a scene.

    `flush` brings the store up to date, in one go, before somebody asks it: with the whole scene at first, from then on
    with what the scene notes as touched.
    """

    def __init__(self, store: TripleStore, context: str) -> None:
        self._store = store
        self._context = context

    def flush(self, scene: Scene, extras: Iterable[ox.Triple], ontology: Ontology, prefixes: Prefixes) -> None:
        """Brings the store up to date. The caller holds the lock of the scene."""
        dirty = scene.dirty
        if dirty is None:
            self._store.replace(self._context, chain(scene_triples(scene, ontology, prefixes), extras))
        elif dirty.nodes or dirty.relations:
            self._update(scene, dirty, set(extras), ontology, prefixes)
        scene.dirty = Dirty()  # only now: what fails is done again

    def _update(
        self, scene: Scene, dirty: Dirty, extras: set[ox.Triple], ontology: Ontology, prefixes: Prefixes
    ) -> None:
        removed: set[ox.Triple] = set()
        added: set[ox.Triple] = set()
        for eid in dirty.nodes:
            subject = ox.NamedNode(prefixes.iri(eid))
            for triple in self._store.triples(self._context, subject):
                if triple.predicate == RDF_TYPE or not isinstance(triple.object, ox.NamedNode):
                    removed.add(triple)
            node = scene.node(eid)
            if node is not None:
                added.update(element_triples(node, ontology, prefixes))
        for relation in dirty.relations:
            (added if scene.related(*relation) else removed).add(relation_triple(relation, prefixes))
        self._store.update(self._context, removed - added - extras, added)
