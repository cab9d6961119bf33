"""Scene files, read without a world model."""

from __future__ import annotations

import logging
from pathlib import Path

import rospkg

from skiros2_common.core.world_element import Element
from skiros2_world_model.core.changes import relation_dict
from skiros2_world_model.core.checks import Checks
from skiros2_world_model.core.local_world_model import source_ontologies
from skiros2_world_model.core.ontology_base import OntologyBase
from skiros2_world_model.core.rdf_files import read_triples
from skiros2_world_model.core.scene import Provenance
from skiros2_world_model.core.scene_rdf import read_scene


def read_scene_file(path: Path) -> list[Element]:
    """The elements of a scene file, each with its outgoing relations. What the ontologies do not know is kept.

    :raises WrongValue: the file is not there, or does not parse.
    :raises WrongType: a value is not of its property's type.
    """
    triples = read_triples(path)
    core = logging.getLogger("skiros2_world_model.core")
    level = core.level
    core.setLevel(logging.ERROR)  # who compares does not check
    try:
        base = OntologyBase(_ontologies())
        checks = Checks(base.index, base.prefixes, str(path))
        content = read_scene(triples, base.index, base.prefixes, checks, str(path), Provenance())
    finally:
        core.setLevel(level)
    outgoing: dict[str, list[dict[str, object]]] = {}
    for src, pred, dst in content.relations:
        outgoing.setdefault(src, []).append(relation_dict("-1", pred, dst))
    return [Element.shared(n.type, n.label, n.id, dict(n.properties), outgoing.get(n.id, ())) for n in content.nodes]


def _ontologies() -> Path:
    """The folder of the package's own ontologies."""
    try:
        return Path(rospkg.RosPack().get_path("skiros2")) / "ontologies"
    except rospkg.ResourceNotFound:
        return source_ontologies()
