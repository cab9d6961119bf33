"""Validation of scenes: everything that loading would refuse or warn of, and SHACL shapes.

pySHACL works on rdflib graphs, so the scene is copied into one, together with the ontologies. This takes about 0.5 ms
per element.
"""

from __future__ import annotations

import logging
import math
import os
from collections.abc import Collection, Iterable, Iterator, Sequence
from itertools import chain, count
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pyoxigraph as ox

from skiros2_common.core.errors import WrongValue
from skiros2_common.core.operations import SCENE, SPATIAL
from skiros2_common.core.world_element import REASONER_PROPERTY
from skiros2_world_model.core.checks import CollectingChecks
from skiros2_world_model.core.context import Context
from skiros2_world_model.core.knowledge_base import KnowledgeBase, is_shapes_file
from skiros2_world_model.core.ontology import Ontology
from skiros2_world_model.core.prefixes import Prefixes
from skiros2_world_model.core.rdf import read_triples
from skiros2_world_model.core.report import INFO, VIOLATION, WARNING, Finding, Report
from skiros2_world_model.core.scene import ROOT, ChangeInfo, ElementRecord, Scene
from skiros2_world_model.core.scene_rdf import scene_triples

if TYPE_CHECKING:
    import rdflib

log = logging.getLogger(__name__)

_PHYSICAL = "sumo:Object"


def scene_file_triples(path: Path) -> list[ox.Triple]:
    """Reads the triples of a scene file.

    :raises WrongValue: the file is missing, does not parse, or holds shapes.
    """
    if is_shapes_file(path.name):
        raise WrongValue(f"{path}: expected a scene; this file holds shapes")
    return read_triples(path)


def keep_refused(path: Path, knowledge_base: KnowledgeBase, strict: bool) -> None:
    """Before a file is overwritten: renames it if it cannot be loaded, so that its content is kept.

    :param strict: treats a file with violations as one that cannot be loaded.
    """
    if not os.path.isfile(path):  # unlike Path.is_file, False for an invalid name
        return
    try:
        triples = scene_file_triples(path)
        refused = strict and validate(triples, str(path), knowledge_base, strict=True).count(VIOLATION) > 0
    except WrongValue:
        refused = True
    if refused:
        names = (path.with_name(f"{path.name}.broken{number or ''}") for number in count())
        kept = next(name for name in names if not name.exists())
        path.rename(kept)
        log.warning("%s cannot be loaded; it is kept as %s before it is overwritten", path, kept.name)


def validate_file(path: Path, knowledge_base: KnowledgeBase, context: str = SCENE, strict: bool = False) -> Report:
    """Validates a scene file for a context. Takes about 1 ms per element.

    :param knowledge_base: the ontologies and the shape files.
    :param strict: reports undeclared names as violations.
    :raises WrongValue: the file cannot be read, or a shape file is invalid.
    """
    return validate(scene_file_triples(path), str(path), knowledge_base, context, strict)


def validate(
    triples: Iterable[ox.Triple], origin: str, knowledge_base: KnowledgeBase, context: str = SCENE, strict: bool = False
) -> Report:
    """Validates the triples of a scene; see `validate_file`.

    :param origin: the file or context, for the findings.
    """
    checks = CollectingChecks(knowledge_base, origin, strict)
    scene, extras = Context(context, knowledge_base).read(triples, checks, ChangeInfo())
    placed: Iterable[Finding] = ()
    if context == SCENE:
        ontology = knowledge_base.index
        placed = chain(misplaced(scene, ontology, origin), unconnected_frames(scene, ontology, origin))
    return Report(origin, [*checks.findings, *placed, *shape_findings(scene, extras, knowledge_base, origin)])


def shape_findings(
    scene: Scene, extras: Iterable[ox.Triple], knowledge_base: KnowledgeBase, origin: str
) -> list[Finding]:
    """The findings of the shapes in a scene and its extra triples.

    :raises WrongValue: a shape file is invalid.
    """
    described = chain(scene_triples(scene, knowledge_base.index, knowledge_base.prefixes), extras)
    return shacl_findings(described, knowledge_base.triples(), knowledge_base.shapes, knowledge_base.prefixes, origin)


def misplaced(scene: Scene, ontology: Ontology, origin: str) -> Iterator[Finding]:
    """Findings for physical elements that no element, or more than one, contains."""
    physical, holding = ontology.subclasses(_PHYSICAL), ontology.subproperties(SPATIAL)
    for etype in physical.intersection(scene.types()):
        for eid in scene.of_type(etype):
            holders = sorted({src for src, _, _ in scene.relations("", holding, eid)})
            if not holders and eid != ROOT:
                yield Finding(WARNING, origin, eid, "", "it is nowhere: no element contains it or has it")
            elif len(holders) > 1:
                listed = ", ".join(holders[:3]) + (", ..." if len(holders) > 3 else "")
                yield Finding(WARNING, origin, eid, "", f"it is in several places: {listed}")


_SPATIAL_REASONER = "AauSpatialReasoner"
_PUBLISH = "skiros:PublishTf"
_POSE = [f"skiros:Position{axis}" for axis in "XYZ"] + [f"skiros:Orientation{axis}" for axis in "XYZW"]


def unconnected_frames(scene: Scene, ontology: Ontology, origin: str) -> Iterator[Finding]:
    """Findings for published elements whose parent frame has no known pose.

    A parent that has a pose but is not published is skipped in favour of its own parent. A parent without a pose but
    with its own `skiros:FrameId` is assumed to be published by another node.
    """
    holding = ontology.subproperties(SPATIAL)
    for record in scene:
        if not (_is_spatial(record) and _is_published(record) and _has_pose(record)):
            continue
        frame, base, passed = record, _holder(scene, holding, record), {record.id}
        while base is not None and base.id not in passed and _has_pose(base) and not _is_published(base):
            passed.add(base.id)
            frame, base = base, _holder(scene, holding, base)
        if base is None or base.id == ROOT or _has_pose(base) or _text(base, "skiros:LinkedToFrameId"):
            continue
        if _text(base, "skiros:FrameId") in ("", base.id) and _text(frame, "skiros:BaseFrameId") in ("", base.id):
            text = f"its frame is connected to nothing: {base.id}, in whose frame it is, has no complete pose"
            yield Finding(WARNING, origin, record.id, _PUBLISH, text)


def _holder(scene: Scene, holding: Collection[str], record: ElementRecord) -> ElementRecord | None:
    """The nearest ancestor with a frame."""
    above = {record.id: record}
    for eid in (waiting := [record.id]):
        for src, _, _ in scene.relations("", holding, eid):
            found = scene.record(src)
            if found is not None and src not in above:
                if _is_spatial(found):
                    return found
                above[src] = found
                waiting.append(src)
    return None


def _is_spatial(record: ElementRecord) -> bool:
    prop = record.properties.get(REASONER_PROPERTY)
    return prop is not None and _SPATIAL_REASONER in prop.values


def _is_published(record: ElementRecord) -> bool:
    return _text(record, _PUBLISH).lower() in ("", "true", "1")  # true by default


def _has_pose(record: ElementRecord) -> bool:
    try:
        return all(math.isfinite(float(_text(record, key))) for key in _POSE)
    except ValueError:
        return False


def _text(record: ElementRecord, key: str) -> str:
    prop = record.properties.get(key)
    return "" if prop is None or prop.value is None else str(prop.value)


_SHACL = "http://www.w3.org/ns/shacl#"
_SEVERITIES = {_SHACL + "Violation": VIOLATION, _SHACL + "Warning": WARNING, _SHACL + "Info": INFO}


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
