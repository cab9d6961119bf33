"""Reads and validates scene files without a world model."""

from __future__ import annotations

import functools
import logging
from pathlib import Path

from skiros2_common.command_line.command import quiet
from skiros2_common.command_line.ros_packages import package_folder
from skiros2_common.core.element_content import RelationDict, relation_dict
from skiros2_common.core.world_element import Element
from skiros2_world_model.core.checks import CollectingChecks
from skiros2_world_model.core.knowledge_base import KnowledgeBase, is_knowledge_file
from skiros2_world_model.core.local_world_model import source_ontologies
from skiros2_world_model.core.rdf import read_triples
from skiros2_world_model.core.report import Report
from skiros2_world_model.core.scene import ChangeInfo
from skiros2_world_model.core.scene_rdf import SceneContent
from skiros2_world_model.core.validation import scene_file_triples, validate


def read_scene_file(path: Path) -> list[Element]:
    """Reads the elements of a scene file, each with its outgoing relations. Unknown names are kept.

    :raises WrongValue: the file is missing or does not parse.
    """
    triples = read_triples(path)
    with quiet(logging.ERROR, "skiros2_world_model"):  # no warnings in a comparison
        knowledge_base = KnowledgeBase(base_ontologies())
        checks = CollectingChecks(knowledge_base, str(path), False)
        content = SceneContent(triples, checks, ChangeInfo())
    outgoing: dict[str, list[RelationDict]] = {}
    for src, pred, dst in content.relations:
        outgoing.setdefault(src, []).append(relation_dict("-1", pred, dst))
    records = content.records.values()
    return [Element.shared(r.type, r.label, r.id, dict(r.properties), outgoing.get(r.id, ())) for r in records]


def validate_scene_file(
    path: Path, ontologies: Path | None, workspace: Path | None, context: str, strict: bool
) -> Report:
    """Validates a scene file.

    :param ontologies: the folder of the base ontologies; None: the package's own.
    :param workspace: the folder of the user's ontologies; None: the file's folder, if it has ontologies or shapes.
    :raises SkirosError: a file cannot be read.
    """
    triples = scene_file_triples(path)
    if workspace is None and any(is_knowledge_file(file.name) for file in path.parent.iterdir()):
        workspace = path.parent
    return validate(triples, str(path), _knowledge_base(ontologies or base_ontologies(), workspace), context, strict)


@functools.cache
def _knowledge_base(ontologies: Path, workspace: Path | None) -> KnowledgeBase:
    return KnowledgeBase(ontologies, workspace)


def base_ontologies() -> Path:
    """Returns the folder of the platform's own ontologies."""
    folder = package_folder("skiros2")
    return folder / "ontologies" if folder is not None else source_ontologies()
