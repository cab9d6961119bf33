"""The command lint: checks skills, ontologies and scenes without a robot, a world model or a master."""

from __future__ import annotations

import argparse
import importlib.util
import logging
import os
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import NoReturn

from skiros2_common.command_line.command import (
    OK,
    REFUSED,
    USAGE,
    CommandResult,
    Parser,
    command_arguments,
    end,
    quiet,
    run_command,
)
from skiros2_common.core.errors import UnknownName
from skiros2_common.tools.libraries import find_libraries
from skiros2_skill.client.description import did_you_mean
from skiros2_skill.command_line.lint_files import ENDINGS, file_findings, knowledge_files
from skiros2_skill.command_line.local_world_model import ontology_folders, world_model_of
from skiros2_skill.core.lint.codes import MEANINGS, Meaning
from skiros2_skill.core.lint.findings import ERROR, NOTE, WARNING, Finding
from skiros2_skill.core.lint.linter import lint_libraries

#: Its skills are known in every check.
_STANDARD = "skiros2_std_skills"

_EPILOG = (
    "The ontologies of skiros2, those in the folders owl, ontology, ontologies and scene of the packages, and those of "
    "the workspace are known; these files and the scenes beside them are checked, too. "
    "Exit status: 0 no errors, 1 errors, 2 wrong usage, or a package that cannot be read."
)


def run(arguments: Sequence[str] | None = None) -> NoReturn:
    """Runs the command and ends the process with its status.

    :param arguments: of the command line; None: those of this process.
    """
    parser = Parser(prog="lint", description="Checks skill libraries with their ontologies and scenes.", epilog=_EPILOG)
    parser.add_argument(
        "packages", nargs="*", metavar="PACKAGE", help="a Python package with skills, or a file: an ontology or a scene"
    )
    parser.add_argument("--explain", nargs="?", const="", metavar="CODE", help="explain a code; without one, all")
    parser.add_argument(
        "--uses", nargs="+", default=[], metavar="PACKAGE", help="further packages whose skills are used"
    )
    parser.add_argument("--workspace", type=Path, metavar="DIR", help="a folder with ontologies")
    parser.add_argument("--strict", action="store_true", help="warnings count as errors")
    parser.add_argument("--notes", action="store_true", help="also list what could not be checked")
    parser.add_argument("--json", action="store_true", help="print JSON")
    given = parser.parse_args(command_arguments(arguments))
    if not given.packages and given.explain is None:
        parser.error("expected a PACKAGE, or --explain")
    work = _lint if given.explain is None else _explain
    end(run_command("lint", lambda: work(given), given.json, refused=USAGE))


def _explain(given: argparse.Namespace) -> CommandResult:
    if given.explain and given.explain not in MEANINGS:
        raise UnknownName(f"there is no code {given.explain!r}; {did_you_mean(given.explain, MEANINGS)}")
    wanted = {code: MEANINGS[code] for code in ([given.explain] if given.explain else MEANINGS)}
    lines = [line for code, meaning in wanted.items() for line in ("", *_explained(code, meaning))]
    return CommandResult(lines[1:], {code: asdict(meaning) for code, meaning in wanted.items()})


def _explained(code: str, meaning: Meaning) -> list[str]:
    examples = [
        f"  {word:7}{line}"
        for word, example in (("wrong", meaning.wrong), ("right", meaning.right))
        for line in example.splitlines()
    ]
    return [f"{code}: {meaning.text}", f"  {meaning.advice}", *examples]


# Skipped modules and broken files are among the findings.
@quiet(logging.CRITICAL, "skiros2_common", "skiros2_world_model")
def _lint(given: argparse.Namespace) -> CommandResult:
    used = [*given.uses, *([_STANDARD] if importlib.util.find_spec(_STANDARD) else [])]
    named = [Path(name) for name in given.packages if name.endswith(ENDINGS)]
    packages = [name for name in given.packages if not name.endswith(ENDINGS)]
    workspace = given.workspace or (named[0].parent if named else None)
    find_libraries([*packages, *used], *(file.parent for file in named))
    folders = [*ontology_folders(packages), *([given.workspace] if given.workspace else [])]
    with world_model_of([*packages, *used], workspace, "lint", skip_broken=True) as wmi:
        findings = lint_libraries(packages, wmi, used) if packages else []
        for file in [*named, *knowledge_files(folders)]:
            findings += file_findings(file, wmi.model.knowledge_base)
    shown = [finding for finding in findings if finding.severity != NOTE or given.notes]
    counts = Counter(finding.severity for finding in findings)
    failed = counts[ERROR] + (counts[WARNING] if given.strict else 0)
    return CommandResult(
        [*map(_line, shown), _summary(counts)], [finding.to_dict() for finding in shown], REFUSED if failed else OK
    )


def _line(finding: Finding) -> str:
    """Formats a finding; a file below the present folder is relative to it."""
    file = os.path.relpath(finding.file) if finding.file else ""
    name = finding.file if file.startswith("..") else file
    return str(replace(finding, file=name))


def _summary(counts: Counter[str]) -> str:
    named = [f"{counts[s]} {s}{'' if counts[s] == 1 else 's'}" for s in (ERROR, WARNING)]
    more = f"; {counts[NOTE]} not checked (--notes)" if counts[NOTE] else ""
    hint = "; lint --explain CODE explains a code" if counts[ERROR] + counts[WARNING] else ""
    return ", ".join(named) + more + hint
