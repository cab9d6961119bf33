"""Which values a goal may compare a property with."""

from __future__ import annotations

import math

from skiros2_common.core.limits import NO_LIMITS, Limits

#: The values of a boolean property, as written in goals.
TRUTHS = ("true", "false")
_TRUTH_TEXTS = (*TRUTHS, "1", "0")


def value_problem(kind: type | None, operator: str, value: float | str, limits: Limits = NO_LIMITS) -> str:
    """Returns why a property is never comparable with a value; "" if it may be.

    :param kind: the type of the property's values: `bool`, `int`, `float` or `str`; None: unknown.
    :param operator: one of `COMPARATORS`.
    :param value: as in `ParsedComparison`.
    :param limits: of the property. Comparisons other than `=` may be with any number.
    """
    if kind is bool:
        is_truth = operator == "=" and isinstance(value, str) and value.lower() in _TRUTH_TEXTS
        return "" if is_truth else f"expected = with true or false, got {operator} {_shown(value)}"
    if kind not in (int, float):
        known = [*map(str, limits.choices)]
        return limits.problem([value]) if known and _shown(value) not in known else ""
    number = _number(value)
    if not math.isfinite(number) or (kind is int and operator == "=" and not number.is_integer()):
        unit = f" ({limits.unit})" if limits.unit else ""
        return f"expected a {'whole ' if kind is int else ''}number{unit}, got {_shown(value)}"
    return limits.problem([int(number) if number.is_integer() else number]) if operator == "=" else ""


def _number(value: float | str) -> float:
    """Returns the value as a number; NaN if it is none. Existing scenes have numbers as texts."""
    try:
        return float(value)
    except ValueError:
        return math.nan


def _shown(value: float | str) -> str:
    return value if isinstance(value, str) else f"{value:g}"
