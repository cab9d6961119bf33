"""`rosrun skiros2_skill lint`: checks skill libraries without a robot, a world model or a master."""

from __future__ import annotations

import argparse
import importlib.util
import logging
import os
import shutil
import tempfile
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NoReturn

import rospkg

from skiros2_common.command_line.answer import OK, REFUSED, USAGE, Answer
from skiros2_common.command_line.frame import Parser, answered, end, given_arguments
from skiros2_common.core.errors import ConfigurationError
from skiros2_skill.core.lint import ERROR, NOTE, WARNING, Fault, lint_libraries
from skiros2_world_model.core.local_world_model import LocalWorldModel, source_ontologies
from skiros2_world_model.core.ontology_base import is_knowledge_file
from skiros2_world_model.core.world_model import WorldModel

#: Its skills may be used by those of any library.
_STANDARD = "skiros2_std_skills"

#: Where a package keeps its ontologies.
_FOLDERS = ("owl", "ontology", "ontologies")

_EPILOG = (
    "The ontologies of skiros2, those in the folders owl, ontology and ontologies of the packages, and those of the "
    "workspace are known. Exit status: 0 no errors, 1 errors, 2 wrong usage, or a package that cannot be read."
)


def run(arguments: Sequence[str] | None = None) -> NoReturn:
    """Runs the command and ends the process with its status.

    :param arguments: of the command line; None: of this process's.
    """
    parser = Parser(prog="lint", description="Checks skill libraries.", epilog=_EPILOG)
    parser.add_argument("packages", nargs="+", metavar="PACKAGE", help="a Python package with skills")
    parser.add_argument(
        "--uses", nargs="+", default=[], metavar="PACKAGE", help="further packages whose skills are used"
    )
    parser.add_argument("--workspace", type=Path, metavar="DIR", help="has your ontologies")
    parser.add_argument("--strict", action="store_true", help="warnings count as errors")
    parser.add_argument("--notes", action="store_true", help="tell also what could not be checked")
    parser.add_argument("--json", action="store_true", help="print JSON")
    given = parser.parse_args(given_arguments(arguments))
    end(answered("lint", lambda: _lint(given), given.json, refused=USAGE))


def _lint(given: argparse.Namespace) -> Answer:
    logging.getLogger("skiros2_common").setLevel(logging.CRITICAL)  # what is skipped is among the faults
    logging.getLogger("skiros2_world_model").setLevel(logging.ERROR)
    if given.workspace is not None and not given.workspace.is_dir():
        raise ConfigurationError(f"workspace {given.workspace}: there is no such folder")
    used = [*given.uses, *([_STANDARD] if importlib.util.find_spec(_STANDARD) else [])]
    with tempfile.TemporaryDirectory(prefix="skiros-lint-") as folder:
        _gather([*_folders([*given.packages, *used]), *([given.workspace] if given.workspace else [])], Path(folder))
        wmi = LocalWorldModel("lint", WorldModel(_ontologies(), Path(folder)))
        faults = lint_libraries(given.packages, wmi, used)
    shown = [fault for fault in faults if fault.severity != NOTE or given.notes]
    counts = Counter(fault.severity for fault in faults)
    failed = counts[ERROR] + (counts[WARNING] if given.strict else 0)
    return Answer(
        [*map(_line, shown), _summary(counts)], [fault.to_dict() for fault in shown], REFUSED if failed else OK
    )


def _line(fault: Fault) -> str:
    """A fault, with the file as seen from the present folder where it is below that."""
    file = os.path.relpath(fault.file) if fault.file else ""
    name = fault.file if file.startswith("..") else file
    return str(Fault(fault.severity, fault.code, fault.skill, fault.text, name, fault.line))


def _summary(counts: Counter[str]) -> str:
    named = [f"{counts[s]} {s}{'' if counts[s] == 1 else 's'}" for s in (ERROR, WARNING)]
    more = f"; {counts[NOTE]} not checked (--notes)" if counts[NOTE] else ""
    return ", ".join(named) + more


def _folders(packages: Sequence[str]) -> Iterator[Path]:
    """The folders with the ontologies of packages."""
    packs = rospkg.RosPack()
    for package in packages:
        try:
            root = Path(packs.get_path(package.partition(".")[0]))
        except rospkg.ResourceNotFound:
            found = _root(package)
            if found is None:
                continue
            root = found
        yield from (root / name for name in _FOLDERS if (root / name).is_dir())


def _root(package: str) -> Path | None:
    """The folder of the ROS package that a Python package lies in; None when there is none."""
    spec = importlib.util.find_spec(package.partition(".")[0])
    if spec is None or not spec.origin:
        return None
    return next((folder for folder in Path(spec.origin).parents if (folder / "package.xml").is_file()), None)


def _gather(folders: Sequence[Path], into: Path) -> None:
    """Copies the ontologies of some folders into one."""
    for number, folder in enumerate(folders):
        for file in sorted(folder.rglob("*")):
            if file.is_file() and is_knowledge_file(file.name):
                shutil.copyfile(file, into / f"{number:03}_{file.name}")


def _ontologies() -> Path:
    """The folder of the platform's own ontologies."""
    try:
        return Path(rospkg.RosPack().get_path("skiros2")) / "ontologies"
    except rospkg.ResourceNotFound:
        return source_ontologies()
