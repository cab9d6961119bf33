"""The commands `validate` and `validate_scene`."""

from __future__ import annotations

import argparse
from typing import Any, Protocol

from skiros2_common.command_line.command import OK, REFUSED, CommandResult
from skiros2_common.command_line.layout import Screen, table
from skiros2_world_model.core.report import VIOLATION, Report


class WithValidation(Protocol):
    """A world model that validates."""

    def validate(self, context_id: str = "scene") -> Report: ...


def validate(wm: WithValidation, arguments: argparse.Namespace, screen: Screen) -> CommandResult:
    """Validates the current scene against the ontologies and the shapes."""
    report = wm.validate(arguments.context)
    return CommandResult(_lines(report, screen), _json(report), _status(report))


def validate_scene(_wm: None, arguments: argparse.Namespace, screen: Screen) -> CommandResult:
    """Validates scene files without a world model: everything that loading would refuse or warn of, and the shapes."""
    from skiros2_world_model.command_line.scene_file import validate_scene_file  # takes time, and an RDF library

    folders = arguments.ontologies, arguments.workspace
    reports = [validate_scene_file(file, *folders, arguments.context, arguments.strict) for file in arguments.files]
    lines = [line for report in reports for line in _lines(report, screen)]
    return CommandResult(lines, [_json(report) for report in reports], max(map(_status, reports)))


def _status(report: Report) -> int:
    return REFUSED if report.count(VIOLATION) else OK


def _lines(report: Report, screen: Screen) -> list[str]:
    rows = [(f.severity, f.element, f.property, f.text) for f in report.findings]
    lines = table(screen, rows, ("severity", "element", "property", "what")) if rows else []
    return [screen.fitted(f"{report.origin}: {report.summary}"), *lines]


def _json(report: Report) -> dict[str, Any]:
    keys = ("severity", "element", "property", "text")
    findings = [{key: getattr(finding, key) for key in keys} for finding in report.findings]
    return {"validated": report.origin, "violations": report.count(VIOLATION), "findings": findings}
