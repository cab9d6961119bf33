"""How close the values and texts of two runs must be.

- Measured numbers, in texts and values: within a tolerance. A number in a text counts as measured if it has a decimal
  point or a per cent sign; other numbers, such as those in ids, are compared exactly.
- Tracebacks: only the last line is compared.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from skiros2_common.core.errors import WrongValue

_MEASURED = re.compile(r"(?<![\w.-])-?\d+\.\d+(?:e[-+]?\d+)?|(?<![\w.-])-?\d+(?=\s?%)", re.IGNORECASE)
_TRACEBACK = "Traceback (most recent call last):"


@dataclass(frozen=True)
class Tolerance:
    """Largest difference between measured numbers that count as equal.

    :param relative: as a fraction of the larger number.
    :param absolute: in the unit of the numbers: metres, radians, per cent.
    :raises WrongValue: one is negative or not finite.
    """

    relative: float = 0.02
    absolute: float = 0.02

    def __post_init__(self) -> None:
        if not (0.0 <= self.relative < math.inf and 0.0 <= self.absolute < math.inf):
            raise WrongValue(f"tolerance {self.absolute:g} (relative {self.relative:g}): expected finite numbers >= 0")

    @property
    def is_exact(self) -> bool:
        """Whether only rounding is tolerated: then texts must be equal."""
        return self.relative < 1e-6 and self.absolute < 1e-6

    def close(self, one: float, other: float) -> bool:
        """Whether two numbers count as equal."""
        return one == other or math.isclose(one, other, rel_tol=self.relative, abs_tol=self.absolute)


#: For runs without physics.
NARROW = Tolerance(0.001, 0.001)

#: For poses that skills calculate from measured ones.
MEASURED = Tolerance(0.02, 0.02)

#: For what is commanded: a re-run has the same inputs, and calculates the same numbers but for rounding.
COMMANDED = Tolerance(1e-9, 1e-12)


def same_text(one: str, other: str, tolerance: Tolerance) -> bool:
    """Whether two texts are equal within the tolerance."""
    if one == other or tolerance.is_exact:
        return one == other
    one, other = _without_trace(one), _without_trace(other)
    if _MEASURED.sub("#", one) != _MEASURED.sub("#", other):
        return False
    pairs = zip(_MEASURED.finditer(one), _MEASURED.finditer(other), strict=True)
    return all(_same_number(a.group(), b.group(), tolerance) for a, b in pairs)


def same_values(one: Sequence[object], other: Sequence[object], tolerance: Tolerance) -> bool:
    """Whether the values of two properties are equal within the tolerance."""
    return len(one) == len(other) and all(_same_value(a, b, tolerance) for a, b in zip(one, other, strict=True))


def same_data(one: Any, other: Any, tolerance: Tolerance) -> bool:
    """Whether JSON data are equal, numbers within the tolerance; texts exactly."""
    if isinstance(one, list) and isinstance(other, list):
        return len(one) == len(other) and all(same_data(a, b, tolerance) for a, b in zip(one, other, strict=True))
    if isinstance(one, dict) and isinstance(other, dict):
        return one.keys() == other.keys() and all(same_data(one[key], other[key], tolerance) for key in one)
    if isinstance(one, float) or isinstance(other, float):
        return _same_value(one, other, tolerance)
    return bool(one == other)


def _without_trace(text: str) -> str:
    if _TRACEBACK not in text:
        return text
    before, _, after = text.partition(_TRACEBACK)
    raised = after.rstrip().rpartition("\n")[2]
    return before.partition(raised)[0] + raised  # the part before repeats the message, with its source line


def _same_number(one: str, other: str, tolerance: Tolerance) -> bool:
    a, b = float(one), float(other)
    last_digit = max(10.0 ** -len(text.partition(".")[2]) for text in (one, other))
    return tolerance.close(a, b) or abs(a - b) <= last_digit * 1.001


def _same_value(one: object, other: object, tolerance: Tolerance) -> bool:
    if isinstance(one, float) or isinstance(other, float):
        try:
            a, b = float(one), float(other)  # type: ignore[arg-type]
        except (TypeError, ValueError):
            return False
        return tolerance.close(a, b) or (math.isnan(a) and math.isnan(b))
    if isinstance(one, str) and isinstance(other, str):
        return same_text(one, other, tolerance)
    return bool(one == other)
