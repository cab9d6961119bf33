"""Templates: individuals of the ontologies from which elements are copied."""

from __future__ import annotations

from collections.abc import Iterator

from skiros2_common.core.errors import UnknownName
from skiros2_common.core.names import full_name
from skiros2_common.core.world_element import Element
from skiros2_world_model.core.changes import Add, Instantiate, relation_dict
from skiros2_world_model.core.checks import made_property
from skiros2_world_model.core.ontology import Individual, Ontology


def template_element(ontology: Ontology, name: str) -> Element:
    """Returns a template as an element without id: its class, properties, and relations to other individuals.

    :param name: the individual's name, which becomes the label and the property `skiros:Template`.
    :raises UnknownName: the ontologies have no such individual.
    """
    individual = _individual(ontology, name)
    element = Element(individual.type, individual.name)
    for key, values in individual.values.items():
        element._put(key, made_property(key, values, ontology.value_limits(individual.type, key)))
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
        for relation in relations:
            element._rels = [*element._rels, {**relation_dict("", "", ""), **relation}]
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
