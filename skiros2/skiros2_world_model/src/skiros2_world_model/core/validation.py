"""Validation of scenes: what loading one would refuse or warn of, all of it, and what the shapes find."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import chain
from pathlib import Path

import pyoxigraph as ox

from skiros2_common.core.errors import SkirosError, WrongValue
from skiros2_world_model.core.changes import SPATIAL
from skiros2_world_model.core.checks import Checks
from skiros2_world_model.core.context import Context
from skiros2_world_model.core.context_names import SCENE
from skiros2_world_model.core.ontology import Ontology
from skiros2_world_model.core.ontology_base import OntologyBase
from skiros2_world_model.core.rdf_files import read_triples
from skiros2_world_model.core.report import VIOLATION, WARNING, Finding, Report
from skiros2_world_model.core.scene import ROOT, Provenance, Scene
from skiros2_world_model.core.scene_rdf import scene_triples
from skiros2_world_model.core.shapes import is_shapes_file, shacl_findings

_PHYSICAL = "sumo:Object"


def scene_file_triples(path: Path) -> list[ox.Triple]:
    """The triples of a scene file.

    :raises WrongValue: it is not there, does not parse, or holds shapes.
    """
    if is_shapes_file(path.name):
        raise WrongValue(f"{path}: expected a scene; this file holds shapes")
    return read_triples(path)


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
    checks = _CollectingChecks(base, origin, strict)
    scene, extras = Context(context, base).read(triples, checks, origin, Provenance())
    placed = misplaced(scene, base.index, origin) if context == SCENE else ()
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


class _CollectingChecks(Checks):
    """Checks that note what is wrong and go on."""

    def __init__(self, base: OntologyBase, origin: str, strict: bool) -> None:
        super().__init__(base.index, base.prefixes, origin, strict)
        self.findings: list[Finding] = []

    def refuse(self, who: str, what: str, error: SkirosError) -> None:
        text = str(error).removeprefix(f"{self._origin}: ")
        if text.startswith((f"{who}: ", f"{who} {what} ")):  # the element, or the relation, which is told beside it
            text = text.partition(": ")[2]
        text = text.removeprefix(f"{what}: ")
        self.findings.append(Finding(VIOLATION, self._origin, who, what, text))

    def finish(self) -> None:
        severity = VIOLATION if self._strict else WARNING
        for (kind, name), users in self._unknown.items():
            element, *place = users[0].split(" ")  # an element, or a relation
            prop = place[0] if place else name if kind in ("property", "relation") else ""
            others = f" ({len(users) - 1} more have it)" if len(users) > 1 else ""
            self.findings.append(Finding(severity, self._origin, element, prop, f"unknown {kind} {name}{others}"))
