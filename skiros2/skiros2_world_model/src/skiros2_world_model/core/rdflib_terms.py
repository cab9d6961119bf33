"""Converts RDF terms between pyoxigraph and rdflib."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

import pyoxigraph as ox
from rdflib import BNode, Literal, URIRef

#: rdflib uses Python's texts of these floats instead of those of XML Schema.
_OF_PYTHON = {"nan": "NaN", "inf": "INF", "-inf": "-INF"}


def rdflib_triples(triples: Iterable[ox.Triple]) -> Iterator[tuple[Any, Any, Any]]:
    """Converts triples to terms of rdflib; equal terms become one object."""
    made: dict[Any, Any] = {}
    for triple in triples:
        terms = []
        for term in (triple.subject, triple.predicate, triple.object):
            known = made.get(term)
            if known is None:
                known = made[term] = rdflib_term(term)
            terms.append(known)
        yield terms[0], terms[1], terms[2]


def rdflib_term(term: Any) -> Any:
    """Converts a term of pyoxigraph to rdflib."""
    if isinstance(term, ox.NamedNode):
        return URIRef(term.value)
    if isinstance(term, ox.BlankNode):
        return BNode(term.value)
    if term.language:
        return Literal(term.value, lang=term.language)
    return Literal(term.value, datatype=URIRef(term.datatype.value))


def store_term(term: Any) -> Any:
    """Converts a term of rdflib to pyoxigraph; None stays None."""
    if isinstance(term, URIRef):
        return ox.NamedNode(str(term))
    if isinstance(term, BNode):
        return ox.BlankNode(str(term))
    if isinstance(term, Literal):
        if term.language:
            return ox.Literal(str(term), language=term.language)
        if term.datatype is None:
            return ox.Literal(str(term))
        text = _OF_PYTHON.get(str(term), str(term)) if isinstance(term.value, float) else str(term)
        return ox.Literal(text, datatype=ox.NamedNode(str(term.datatype)))
    return None
