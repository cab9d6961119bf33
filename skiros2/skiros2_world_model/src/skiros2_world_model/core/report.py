"""The result of a validation. Plain data, also for clients on Debian's Python."""

from __future__ import annotations

import time
from collections.abc import Iterable
from dataclasses import dataclass

from skiros2_common.core.errors import WrongValue

VIOLATION = "violation"
WARNING = "warning"
INFO = "info"

_SEVERITIES = (VIOLATION, WARNING, INFO)


@dataclass(frozen=True, slots=True)
class Finding:
    """A deviation from the ontologies or the shapes.

    :param severity: `VIOLATION` (a strict world model refuses it), `WARNING` or `INFO`.
    :param file: the validated file or context.
    :param element: the element; "": the file as a whole.
    :param property: the property or relation; "": the element as a whole.
    :param code: the kind of deviation, where `rosrun skiros2_skill lint` explains it.
    """

    severity: str
    file: str
    element: str
    property: str
    text: str
    code: str = ""

    def __str__(self) -> str:
        what = " ".join(part for part in (self.element, self.property) if part)
        return f"{self.severity}: {what}: {self.text}" if what else f"{self.severity}: {self.text}"


class Report:
    """The findings of a validation, sorted by severity, without duplicates."""

    def __init__(self, origin: str, findings: Iterable[Finding] = (), stamp: float | None = None) -> None:
        self.origin = origin  #: the validated file or context
        self.stamp = time.time() if stamp is None else stamp  #: the time of the validation (s since the epoch)
        self.findings = sorted(set(findings), key=_order)

    def count(self, severity: str) -> int:
        """The number of findings with a severity."""
        return sum(finding.severity == severity for finding in self.findings)

    @property
    def summary(self) -> str:
        """The number of findings by severity, such as "2 violations, 1 warning"."""
        counts = [(self.count(severity), severity) for severity in _SEVERITIES]
        parts = [f"{count} {severity}{'s' if count > 1 else ''}" for count, severity in counts if count]
        return ", ".join(parts) or "nothing found"

    def lines(self, most: int) -> list[str]:
        """The first findings as texts, and the number of further findings."""
        lines = [str(finding) for finding in self.findings[:most]]
        more = len(self.findings) - most
        return [*lines, f"and {more} more"] if more > 0 else lines

    def refuse_violations(self) -> None:
        """:raises WrongValue: there are violations; the text quotes the first three."""
        count = self.count(VIOLATION)
        if count:
            text = "; ".join(Report(self.origin, self.findings[:count]).lines(3))
            raise WrongValue(f"{self.origin}: {text}")


def _order(finding: Finding) -> tuple[int, str, str, str]:
    return _SEVERITIES.index(finding.severity), finding.element, finding.property, finding.text
