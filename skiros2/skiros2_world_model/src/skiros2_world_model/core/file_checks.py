"""Checks of a file that collect all flaws, with their lines and how loading handles them."""

from __future__ import annotations

import logging
import re
from dataclasses import dataclass
from pathlib import Path

from skiros2_common.core.errors import SkirosError, WrongValue
from skiros2_common.core.names import local_name
from skiros2_world_model.core.checks import Checks, issue_text
from skiros2_world_model.core.knowledge_base import KnowledgeBase
from skiros2_world_model.core.report import VIOLATION, WARNING, Finding

log = logging.getLogger(__name__)

KEPT = "kept"
LEFT_OUT = "left out"


@dataclass(frozen=True)
class Flaw:
    """A flaw in a file, and how loading handles it."""

    finding: Finding
    done: str


class CollectingChecks(Checks):
    """Checks that collect flaws instead of raising errors."""

    def __init__(self, knowledge_base: KnowledgeBase, origin: str, strict: bool) -> None:
        super().__init__(knowledge_base.index, knowledge_base.prefixes, origin, strict)
        self.flaws: list[Flaw] = []

    @property
    def findings(self) -> list[Finding]:
        return [flaw.finding for flaw in self.flaws]

    def refuse(self, who: str, what: str, error: SkirosError, done: str = LEFT_OUT) -> None:
        text = str(error).removeprefix(f"{self._origin}: ")
        if text.startswith((f"{who}: ", f"{who} {what} ")):  # the finding names them itself
            text = text.partition(": ")[2]
        text = text.removeprefix(f"{what}: ")
        self.flaws.append(Flaw(Finding(VIOLATION, self._origin, who, what, text), done))

    def finish(self) -> None:
        severity = VIOLATION if self._strict else WARNING
        for (kind, name), users in self._unknown.items():
            element, *predicate = users[0].split(" ")  # an element, or a relation
            prop = predicate[0] if predicate else name if kind in ("property", "relation") else ""
            others = f" ({len(users) - 1} more have it)" if len(users) > 1 else ""
            finding = Finding(severity, self._origin, element, prop, f"{issue_text(kind, name)}{others}")
            self.flaws.append(Flaw(finding, KEPT))


class FileChecks(CollectingChecks):
    """Checks of a loaded file: all flaws are logged in one warning; with `strict` they refuse the file."""

    def __init__(self, knowledge_base: KnowledgeBase, path: Path, strict: bool) -> None:
        super().__init__(knowledge_base, str(path), strict)
        self._path = path

    def finish(self) -> None:
        """Logs all flaws in one warning.

        :raises WrongValue: there are flaws, and the checks are strict; the text lists all of them.
        """
        super().finish()
        if not self.flaws:
            return
        lines = SourceLines(self._path)
        text = "\n    ".join(self._format(flaw, lines) for flaw in self.flaws)
        count = f"{len(self.flaws)} flaw{'s' if len(self.flaws) > 1 else ''}"
        if self._strict:
            raise WrongValue(f"{self._path}: refused with {count}:\n    {text}")
        log.warning("%s: loaded with %s:\n    %s", self._path, count, text)

    def _format(self, flaw: Flaw, lines: SourceLines) -> str:
        found = flaw.finding
        line = lines.find(found.element, found.property)
        location = f"{self._path}, line {line}" if line else str(self._path)
        what = " ".join(part for part in (found.element, found.property) if part)
        done = "" if self._strict else f"; {flaw.done}"
        return ": ".join(part for part in (location, what, found.text) if part) + done


class SourceLines:
    """Finds the lines of names in a Turtle or RDF/XML file."""

    def __init__(self, path: Path) -> None:
        try:
            self._lines = path.read_text(errors="replace").splitlines()
        except OSError:
            self._lines = []

    def find(self, element: str, prop: str = "") -> int | None:
        """The line number (from 1) of an element's description, or of its property there; None when it is not found."""
        if not element:
            return None
        name = _token(element)
        subject = re.compile(rf"(?:^|\.)\s*(?:[\w.-]*:|<[^<>\s]*[#/]){name}|about=\"[^\"]*{name}")
        start = next((i for i, line in enumerate(self._lines) if subject.search(line)), None)
        if start is None or not prop:
            return None if start is None else start + 1
        wanted = re.compile(rf"[:#/<]{_token(prop)}")
        for index in range(start, len(self._lines)):
            if wanted.search(self._lines[index]):
                return index + 1
            if index > start and subject.pattern and _ENDS.search(self._lines[index]):
                break
        return start + 1


#: The end of a description: of a Turtle statement, or of an RDF/XML element.
_ENDS = re.compile(r"(?:^|\s)\.\s*(?:#.*)?$|^\s*</(?:\w+:)?(?:NamedIndividual|Description)>")


def _token(name: str) -> str:
    return re.escape(local_name(name).rpartition("#")[2]) + r"(?![\w-])"
