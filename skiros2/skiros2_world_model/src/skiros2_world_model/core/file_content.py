"""The content of a scene file, read and checked for a context without the lock of the world model."""

from __future__ import annotations

from pathlib import Path

from skiros2_common.core.changeset import UNKNOWN
from skiros2_common.core.collector import collector_paused
from skiros2_world_model.core.checks import FileChecks
from skiros2_world_model.core.context import Context
from skiros2_world_model.core.knowledge_base import KnowledgeBase
from skiros2_world_model.core.report import Report
from skiros2_world_model.core.validation import scene_file_triples, shape_findings


class FileContent:
    """A scene file that was read.

    :param context: it is not changed.
    :param strict: refuses a file with findings.
    :param adds_root: adds the root to a scene without one, instead of refusing it.
    :raises SkirosError: the file is missing, does not parse, or is refused.
    :ivar index: the ontologies that it was checked with.
    :ivar scene: its elements have no change_info yet.
    :ivar extras: its triples that belong to no element.
    :ivar findings: they were logged.
    """

    @collector_paused()
    def __init__(
        self, context: Context, path: Path, knowledge_base: KnowledgeBase, strict: bool, adds_root: bool
    ) -> None:
        self.path = path
        self.index = knowledge_base.index
        checks = FileChecks(knowledge_base, path, strict)
        self.scene, self.extras = context.read(scene_file_triples(path), checks, UNKNOWN, adds_root)
        if strict:
            findings = shape_findings(self.scene, self.extras, knowledge_base, str(path))
            Report(str(path), findings).refuse_violations()
        self.findings = frozenset(checks.findings)
