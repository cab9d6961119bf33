"""`make audit`: what it reports, and its exit status."""

from __future__ import annotations

import json
from importlib.machinery import SourceFileLoader
from importlib.util import module_from_spec, spec_from_loader
from pathlib import Path
from typing import Any

import pytest

from support.source import ROOT

VULNERABLE = {
    "pip-audit": {
        "dependencies": [
            {"name": "a", "version": "1", "vulns": [{"id": "CVE-1", "fix_versions": ["2"]}]},
            {"name": "b", "version": "1", "vulns": []},
            {"name": "c", "skip_reason": "unknown"},
        ]
    },
    "npm": {"auditReportVersion": 2, "vulnerabilities": {"d": {"range": "<3", "severity": "high"}}},
}
FINE = {"pip-audit": {"dependencies": []}, "npm": {"auditReportVersion": 2, "vulnerabilities": {}}}
SILENT = {"pip-audit": None, "npm": {"message": "405 Method Not Allowed"}}


@pytest.mark.parametrize(
    ("answers", "status", "texts"),
    [
        (VULNERABLE, 1, ["list.txt: a 1: CVE-1, fixed in 2", "npm: d <3: high"]),
        (FINE, 0, ["no vulnerability was reported"]),
        (SILENT, 2, ["NOT CHECKED: Python packages", "NOT CHECKED: npm packages"]),
        ({**VULNERABLE, "npm": SILENT["npm"]}, 1, ["CVE-1", "NOT CHECKED: npm packages"]),
    ],
)
def test_audit_reports_findings_and_what_was_not_checked(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any, answers: dict[str, Any], status: int, texts: list[str]
) -> None:
    loader = SourceFileLoader("audit", str(ROOT / ".ci/audit"))
    audit: Any = module_from_spec(spec_from_loader("audit", loader))  # type: ignore[arg-type]
    loader.exec_module(audit)
    for folder, name in (("build/audit/bin", "pip-audit"), (".venv/bin", "npm")):
        program = tmp_path / folder / name
        program.parent.mkdir(parents=True)
        text = json.dumps(answers[name]) if answers[name] is not None else "no network"
        program.write_text(f"#!/bin/sh\ncat <<'END'\n{text}\nEND\nexit 1\n")
        program.chmod(0o755)
    (tmp_path / "requirements").mkdir()
    (tmp_path / "requirements/list.txt").write_text("")
    monkeypatch.setattr(audit, "ROOT", tmp_path)
    monkeypatch.setattr(audit, "NPM", [tmp_path])
    assert audit.main() == status
    printed = capsys.readouterr().out
    assert all(text in printed for text in texts), printed
