"""Validation of scenes: what loading one would refuse or warn of, all of it, and what the shapes find."""

from __future__ import annotations

import logging
import os
from collections.abc import Iterable, Iterator
from itertools import chain, count
from pathlib import Path

import pyoxigraph as ox

from skiros2_common.core.errors import WrongValue
from skiros2_world_model.core.changes import SPATIAL
from skiros2_world_model.core.context import Context
from skiros2_world_model.core.context_names import SCENE
from skiros2_world_model.core.file_checks import CollectingChecks
from skiros2_world_model.core.frame_validation import unconnected_frames
from skiros2_world_model.core.ontology import Ontology
from skiros2_world_model.core.ontology_base import OntologyBase
from skiros2_world_model.core.rdf_files import read_triples
from skiros2_world_model.core.report import VIOLATION, WARNING, Finding, Report
from skiros2_world_model.core.scene import ROOT, Provenance, Scene
from skiros2_world_model.core.scene_rdf import scene_triples
from skiros2_world_model.core.shapes import is_shapes_file, shacl_findings

log = logging.getLogger(__name__)

_PHYSICAL = "sumo:Object"


def scene_file_triples(path: Path) -> list[ox.Triple]:
    """The triples of a scene file.

    :raises WrongValue: it is not there, does not parse, or holds shapes.
    """
    if is_shapes_file(path.name):
        raise WrongValue(f"{path}: expected a scene; this file holds shapes")
    return read_triples(path)


def keep_refused(path: Path, base: OntologyBase, strict: bool) -> None:
    """Renames a file that is about to be overwritten and could not be loaded, so that its content is kept.

    :param strict: whether a file with flaws is refused.
    """
    if not os.path.isfile(path):  # unlike Path's, False for an impossible name
        return
    try:
        triples = scene_file_triples(path)
        refused = strict and validate(triples, str(path), base, strict=True).count(VIOLATION) > 0
    except WrongValue:
        refused = True
    if refused:
        names = (path.with_name(f"{path.name}.broken{number or ''}") for number in count())
        kept = next(name for name in names if not name.exists())
        path.rename(kept)
        log.warning("%s cannot be loaded and is overwritten now; it is kept as %s", path, kept.name)


def validate_file(path: Path, base: OntologyBase, context: str = SCENE, strict: bool = False) -> Report:
    """Validates a scene file, as it would be loaded into a context. It takes about 1 ms for each element.

    :param base: the ontologies and the files of shapes.
    :param strict: names that the ontologies do not know are violations, as for a world model that is strict.
    :raises WrongValue: the file cannot be read, or a file of shapes makes no sense.
    """
    return validate(scene_file_triples(path), str(path), base, context, strict)


def validate(
    triples: Iterable[ox.Triple], origin: str, base: OntologyBase, context: str = SCENE, strict: bool = False
) -> Report:
    """Validates what triples say of a scene; see `validate_file`.

    :param origin: the file or context, for the findings.
    """
    checks = CollectingChecks(base, origin, strict)
    scene, extras = Context(context, base).read(triples, checks, origin, Provenance())
    placed: Iterable[Finding] = ()
    if context == SCENE:
        placed = chain(misplaced(scene, base.index, origin), unconnected_frames(scene, base.index, origin))
    return Report(origin, [*checks.findings, *placed, *shape_findings(scene, extras, base, origin)])


def shape_findings(scene: Scene, extras: Iterable[ox.Triple], base: OntologyBase, origin: str) -> list[Finding]:
    """What the shapes find in a scene and what is beside it.

    :raises WrongValue: a file of shapes makes no sense.
    """
    described = chain(scene_triples(scene, base.index, base.prefixes), extras)
    return shacl_findings(described, base.triples(), base.shapes, base.prefixes, origin)


def misplaced(scene: Scene, ontology: Ontology, origin: str) -> Iterator[Finding]:
    """The physical elements that are nowhere, or in several places."""
    physical, holding = ontology.subclasses(_PHYSICAL), ontology.subproperties(SPATIAL)
    for etype in physical.intersection(scene.types()):
        for eid in scene.of_type(etype):
            holders = sorted({src for src, _, _ in scene.relations("", holding, eid)})
            if not holders and eid != ROOT:
                yield Finding(WARNING, origin, eid, "", "it is nowhere: no element contains it or has it")
            elif len(holders) > 1:
                told = ", ".join(holders[:3]) + (", ..." if len(holders) > 3 else "")
                yield Finding(WARNING, origin, eid, "", f"it is in several places: {told}")
