"""The unit and the allowed values of a parameter."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from skiros2_common.core.errors import WrongType, WrongValue
from skiros2_common.core.property import as_type, format_value

#: The types whose values can have a minimum and a maximum.
NUMBER_TYPES = (int, float)


@dataclass(frozen=True)
class Limits:
    """The unit and the allowed values of a parameter. By default, there is no unit and any value is allowed.

    A mistake in the limits is not rejected here, because libraries must load; `faults` reports it.

    :param unit: of the values, such as `m/s`; for people.
    :param minimum, maximum: the allowed range; None: no limit.
    :param choices: the allowed values; (): any.
    :raises WrongType: `minimum` or `maximum` is not a number.
    """

    unit: str = ""
    minimum: float | None = None
    maximum: float | None = None
    choices: tuple[Any, ...] = ()

    def __post_init__(self) -> None:
        for bound in (self.minimum, self.maximum):
            if bound is not None:
                as_type(bound, float)

    @property
    def lowest(self) -> float:
        """The minimum; -inf without one."""
        return -math.inf if self.minimum is None else self.minimum

    @property
    def highest(self) -> float:
        """The maximum; inf without one."""
        return math.inf if self.maximum is None else self.maximum

    @property
    def text(self) -> str:
        """The limits for people: `0.1 to 2 m/s`, `at least 1`, `one of slow, fast`; "" without limits and unit."""
        low, high = self.minimum, self.maximum
        if self.choices:
            words = f"one of {', '.join(map(str, self.choices))}"
        elif low is not None and high is not None:
            words = f"{low:g} to {high:g}"
        elif low is not None:
            words = f"at least {low:g}"
        elif high is not None:
            words = f"at most {high:g}"
        else:
            return f"in {self.unit}" if self.unit else ""
        return f"{words} {self.unit}" if self.unit else words

    def allows(self, value: Any) -> bool:
        """Whether a value is allowed. NaN is not, if there is a minimum or a maximum."""
        if self.choices and value not in self.choices:
            return False
        if isinstance(value, NUMBER_TYPES):
            return (self.minimum, self.maximum) == (None, None) or self.lowest <= value <= self.highest
        return True

    def choices_of(self, datatype: type) -> list[Any]:
        """The choices as values of a type, without those that are of another type."""
        return [as_type(choice, datatype) for choice in self.choices if _is_of_type(choice, datatype)]

    def problem(self, values: Iterable[Any]) -> str:
        """Describes the values that are not allowed; "" if all are allowed."""
        wrong = [value for value in values if not self.allows(value)]
        return f"expected {self.text}, got {', '.join(map(format_value, wrong))}" if wrong else ""

    def faults(self, datatype: type, defaults: Sequence[Any]) -> list[str]:
        """Describes the mistakes in the limits of a parameter.

        :param datatype: the type of its values.
        :param defaults: its default values.
        """
        found = []
        if (self.minimum is not None or self.maximum is not None) and datatype not in NUMBER_TYPES:
            found.append(f"has a minimum or a maximum, but its values are of type {datatype.__name__}")
        elif self.lowest > self.highest:
            found.append(f"has the minimum {self.minimum:g}, greater than the maximum {self.maximum:g}")
        wrong = [choice for choice in self.choices if not _is_of_type(choice, datatype)]
        if wrong:
            found.append(f"has the choices {', '.join(map(format_value, wrong))}, not of type {datatype.__name__}")
        if not found:
            found += [f"has a default that it does not allow: {text}" for text in [self.problem(defaults)] if text]
        return found

    def to_json(self) -> dict[str, Any]:
        """The members of the JSON form of a parameter; those without a value are omitted."""
        members = {"unit": self.unit, "minimum": self.minimum, "maximum": self.maximum, "choices": list(self.choices)}
        return {name: value for name, value in members.items() if value not in ("", None, [])}

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> Limits:
        """Reads the members from the JSON form of a parameter.

        :raises WrongValue: a member has the wrong type.
        """
        unit, choices = data.get("unit", ""), data.get("choices", [])
        bounds = [data.get("minimum"), data.get("maximum")]
        if not isinstance(unit, str) or not isinstance(choices, list):
            raise WrongValue(f"expected a text 'unit' and a list 'choices', got {format_value([unit, choices])}")
        try:
            low, high = (None if bound is None else as_type(bound, float) for bound in bounds)
        except WrongType as error:
            raise WrongValue(f"'minimum' and 'maximum': {error}") from None
        return cls(unit, low, high, tuple(choices)) if unit or choices or bounds != [None, None] else NO_LIMITS


#: The limits of a parameter that declares none.
NO_LIMITS = Limits()


def _is_of_type(value: Any, datatype: type) -> bool:
    try:
        as_type(value, datatype)
    except WrongType:
        return False
    return True
