"""Translates RDF statements about elements into operations on a scene."""

from __future__ import annotations

from collections.abc import Iterable

import pyoxigraph as ox

from skiros2_common.core.errors import UnknownName, WrongValue
from skiros2_common.core.property import Property, same_value
from skiros2_common.core.world_element import Element, ElementChanges
from skiros2_world_model.core.changes import Add, Operation, Patch, Relate
from skiros2_world_model.core.knowledge_base import KnowledgeBase
from skiros2_world_model.core.scene import Scene
from skiros2_world_model.core.terms import python_value

#: Instances of classes of these vocabularies belong to an ontology, not to a scene.
_META = ("owl:", "rdfs:", "rdf:")


def element_operations(
    knowledge_base: KnowledgeBase, scene: Scene, removed: Iterable[ox.Triple], added: Iterable[ox.Triple]
) -> list[Operation]:
    """The operations that have the effect of removing and adding triples.

    :raises UnknownName: a triple describes an element that does not exist, and no triple gives it a class.
    :raises WrongValue: a triple removes the class of an element.
    """
    prefixes = knowledge_base.prefixes
    new: dict[str, Element] = {}
    known: dict[str, Element] = {}
    operations: list[Operation] = []
    statements = [(t, False) for t in removed] + [(t, True) for t in added]
    for triple, value in sorted(statements, key=lambda s: prefixes.name(s[0].predicate.value) != "rdf:type"):
        item = triple.object
        if not isinstance(triple.subject, ox.NamedNode) or not isinstance(item, (ox.NamedNode, ox.Literal)):
            raise WrongValue(f"{triple}: elements are described without blank nodes")
        eid, key = prefixes.name(triple.subject.value), prefixes.name(triple.predicate.value)
        element = new.get(eid) or known.get(eid) or scene.element(eid)
        if key == "rdf:type":
            etype = prefixes.name(item.value)
            if not value:
                raise WrongValue(f"{eid}: an element has a class; remove the element instead")
            if etype == "owl:NamedIndividual":
                continue
            if etype.startswith(_META):
                raise WrongValue(f"{eid} is declared a {etype}, which belongs into the ontologies (context '')")
            if element is None:
                new[eid] = Element(etype, "", eid)
                continue
            element.type = etype
        elif element is None:
            raise UnknownName(f"there is no element {eid!r}, and nothing gives it a class")
        elif isinstance(item, ox.NamedNode):
            operations.append(Relate(eid, key, prefixes.name(item.value), value))
        elif key == "rdfs:label":
            element.label = item.value if value else ""
        else:
            _write_value(element, key, python_value(item), value)
        if eid not in new:
            known[eid] = element
    adds: list[Operation] = [Add(element) for element in new.values()]
    patches: list[Operation] = [Patch(eid, e.changes() or ElementChanges()) for eid, e in known.items() if e.changes()]
    return [*adds, *patches, *operations]


def _write_value(element: Element, key: str, item: object, present: bool) -> None:
    prop = element._props.get(key)
    values = [v for v in (prop.values if prop is not None else []) if not same_value(v, item)]
    if present:
        values.append(item)
    element.removeProperty(key)
    if values:
        element._put(key, Property(key, values if len({type(v) for v in values}) == 1 else [str(v) for v in values]))
