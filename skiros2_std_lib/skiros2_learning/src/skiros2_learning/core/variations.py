"""The features of a task that differ between its variations."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from skiros2_learning.core.sections import Name, Range, Section, Text, near


@dataclass(frozen=True)
class Feature(Section):
    """A number that differs between the variations of a task, and that the robot knows.

    :param element, property: label of the element, and its property in the scene with the number.
    :param range: lowest and highest value that is learned.
    """

    name: Name
    range: Range
    element: Text = ""
    property: Text = ""
    unit: Text = ""

    def range_text(self) -> str:
        """The range for people: `0.5 to 0.66 m`."""
        return f"{self.range[0]:g} to {self.range[1]:g}{f' {self.unit}' if self.unit else ''}"

    def value_of(self, unit: float) -> float:
        """Returns the value at a part of the range, 0 to 1."""
        return self.range[0] + unit * (self.range[1] - self.range[0])

    def unit_of(self, value: float) -> float:
        """Scales a value to 0 to 1."""
        return (value - self.range[0]) / (self.range[1] - self.range[0])


def variation_problems(features: Sequence[Feature], variation: Any) -> list[str]:
    """Describes all mistakes in the values of features."""
    if not isinstance(variation, Mapping):
        return [f"expected features and values, got {variation!r}"]
    names = [each.name for each in features]
    found = [f"no feature is called {name!r}; {near(str(name), names)}" for name in variation if name not in names]
    for each in features:
        value: Any = variation.get(each.name)
        is_number = isinstance(value, int | float) and not isinstance(value, bool)
        if not is_number or not each.range[0] <= value <= each.range[1]:
            found.append(f"{each.name}: expected {each.range_text()}, got {value!r}")
    return found
