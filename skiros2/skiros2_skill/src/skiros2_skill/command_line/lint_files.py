"""Checks of ontology and scene files, for `rosrun skiros2_skill lint`."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from skiros2_common.core.errors import WrongValue
from skiros2_skill.core.lint.findings import ERROR, NOTE, WARNING, Finding
from skiros2_world_model.core import report
from skiros2_world_model.core.checks import SourceLines
from skiros2_world_model.core.knowledge_base import KnowledgeBase, is_knowledge_file, is_shapes_file
from skiros2_world_model.core.ontology_lint import unused_prefixes
from skiros2_world_model.core.rdf import read_triples
from skiros2_world_model.core.validation import validate

#: Files with these endings are ontologies, scenes or shapes.
ENDINGS = (".ttl", ".owl", ".rdf")

_SEVERITIES = {report.VIOLATION: ERROR, report.WARNING: WARNING}


def knowledge_files(folders: Iterable[Path]) -> list[Path]:
    """The ontologies, scenes and shapes in folders, sorted, without duplicates."""
    found = (file for folder in folders for file in folder.rglob("*") if file.suffix in ENDINGS and file.is_file())
    return sorted({file.resolve(): file for file in found}.values())


def file_findings(file: Path, knowledge_base: KnowledgeBase) -> list[Finding]:
    """The findings of a file.

    :param knowledge_base: has all ontologies; this file too, if it is one.
    """
    try:
        triples = read_triples(file)
        if is_shapes_file(file.name):
            return []
        if is_knowledge_file(file.name):
            found = knowledge_base.lint(file, triples)
        else:
            found = validate(triples, str(file), knowledge_base).findings
    except WrongValue as error:
        text = str(error).removeprefix(str(file)).lstrip(",: ")
        return [Finding(ERROR, "syntax", file.name, text, str(file), error.position[0], "the file is skipped")]
    lines = SourceLines(file)
    return [_finding(finding, lines) for finding in [*found, *unused_prefixes(file)]]


def _finding(finding: report.Finding, lines: SourceLines) -> Finding:
    line = lines.find(finding.element, finding.property) or lines.mention(finding.property) or 0
    name = " ".join(part for part in (finding.element, finding.property) if part)
    severity = _SEVERITIES.get(finding.severity, NOTE)
    return Finding(severity, finding.code or "scene", name, finding.text, finding.file, line)
