"""SHACL shapes: their files, and the validation of a scene with pySHACL.

pySHACL works on rdflib graphs, so the scene is copied into one, together with the ontologies. This takes about 0.5 ms
per element; `Validator` does it in a subprocess.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Sequence
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pyoxigraph as ox

from skiros2_common.core.errors import ConfigurationError, WrongValue
from skiros2_world_model.core.prefixes import Prefixes
from skiros2_world_model.core.rdf_files import read_triples
from skiros2_world_model.core.report import INFO, VIOLATION, WARNING, Finding

if TYPE_CHECKING:
    import rdflib

_SHACL = "http://www.w3.org/ns/shacl#"
_SEVERITIES = {_SHACL + "Violation": VIOLATION, _SHACL + "Warning": WARNING, _SHACL + "Info": INFO}


def is_shapes_file(name: str) -> bool:
    """Whether a file with this name holds shapes."""
    return ".shapes." in name


def shape_files(*folders: Path | None) -> list[Path]:
    """The shape files in folders and their subfolders, without duplicates.

    :raises ConfigurationError: a file does not parse.
    """
    found: dict[Path, Path] = {}
    for folder in folders:
        for parent, _, names in os.walk(folder) if folder is not None else ():
            for name in filter(is_shapes_file, names):
                path = Path(parent, name)
                found.setdefault(path.resolve(), path)
    files = sorted(found.values())
    for path in files:
        try:
            read_triples(path)
        except WrongValue as error:
            raise ConfigurationError(f"shapes {error}") from None
    return files


def shacl_findings(
    scene: Iterable[ox.Triple],
    ontologies: Iterable[ox.Triple],
    files: Sequence[Path],
    prefixes: Prefixes,
    origin: str,
) -> list[Finding]:
    """Validates a scene with shape files. Subclasses are the only inference.

    :param scene: the triples of the scene; findings about other subjects are ignored.
    :param origin: the file or context, for the findings.
    :raises WrongValue: a shape file cannot be read, or its shapes are invalid.
    """
    import pyshacl  # slow to import, and rarely needed

    shapes = _graph(triple for path in files for triple in read_triples(path))
    scene = list(scene)
    described = {_rdflib_term(triple.subject) for triple in scene}
    data = _graph(chain(scene, ontologies))
    try:
        _, results, text = pyshacl.validate(data, shacl_graph=shapes, inplace=True)
    except pyshacl.errors.ReportableRuntimeError as error:
        raise WrongValue(f"shapes {', '.join(map(str, files))}: {error}") from None
    if isinstance(results, Exception):  # pySHACL returns an exception when a shape fails
        raise WrongValue(f"shapes {', '.join(map(str, files))}: {text}")
    return [finding for node, finding in _findings(results, prefixes, origin) if node in described]


def _findings(results: Any, prefixes: Prefixes, origin: str) -> Iterator[tuple[Any, Finding]]:
    """The findings in a report of pySHACL, with their focus nodes."""
    from rdflib import RDF, SH, URIRef

    def name(node: Any) -> str:
        return prefixes.name(str(node)) if isinstance(node, URIRef) else ""

    for result in results.subjects(RDF.type, SH.ValidationResult):
        focus, value = results.value(result, SH.focusNode), results.value(result, SH.value)
        text = "; ".join(sorted(map(str, results.objects(result, SH.resultMessage))))
        if value is not None and value != focus:
            text += f", not {name(value) or value}"
        severity = _SEVERITIES.get(str(results.value(result, SH.resultSeverity)), VIOLATION)
        yield focus, Finding(severity, origin, name(focus), name(results.value(result, SH.resultPath)), text)


def _graph(triples: Iterable[ox.Triple]) -> rdflib.Graph:
    from rdflib import Graph

    graph = Graph()
    for triple in _rdflib_triples(triples):
        graph.add(triple)
    return graph


def _rdflib_triples(triples: Iterable[ox.Triple]) -> Iterator[tuple[Any, Any, Any]]:
    """Converts triples to terms of rdflib; equal terms become one object."""
    made: dict[Any, Any] = {}
    for triple in triples:
        terms = []
        for term in (triple.subject, triple.predicate, triple.object):
            known = made.get(term)
            if known is None:
                known = made[term] = _rdflib_term(term)
            terms.append(known)
        yield terms[0], terms[1], terms[2]


def _rdflib_term(term: Any) -> Any:
    """Converts a term of pyoxigraph to rdflib."""
    from rdflib import BNode, Literal, URIRef

    if isinstance(term, ox.NamedNode):
        return URIRef(term.value)
    if isinstance(term, ox.BlankNode):
        return BNode(term.value)
    if term.language:
        return Literal(term.value, lang=term.language)
    return Literal(term.value, datatype=URIRef(term.datatype.value))
