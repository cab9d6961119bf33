"""Faults of skills."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from skiros2_common.core.source_location import SourceLocation
from skiros2_skill.core.library.description import Described, class_location

ERROR, WARNING, NOTE = "error", "warning", "note"

UNKNOWN_SKILL, NOT_DESCRIBED = "unknown-skill", "not-described"


@dataclass(frozen=True)
class Fault:
    """A fault of a skill.

    :param severity: `ERROR`, `WARNING` or `NOTE`.
    :param code: the kind of fault.
    :param skill: `type-label`.
    :param file, line: the source location; "" and 0 when it is not known.
    :param done: the consequence when the skill is loaded and run.
    """

    severity: str
    code: str
    skill: str
    text: str
    file: str = ""
    line: int = 0
    done: str = ""

    def __str__(self) -> str:
        done = f" ({self.done})" if self.done else ""
        return f"{self.file}:{self.line}: {self.severity}: [{self.code}] {self.skill}: {self.text}{done}"

    def to_dict(self) -> dict[str, Any]:
        return asdict(self)


def fault_of(
    described: Described, severity: str, code: str, text: str, place: SourceLocation | None = None, done: str = ""
) -> Fault:
    """Creates a fault of a skill.

    :param place: its source location; None: that of the class.
    """
    file, line = place or class_location(described.cls)
    return Fault(severity, code, described.name, text, file, line, done)
