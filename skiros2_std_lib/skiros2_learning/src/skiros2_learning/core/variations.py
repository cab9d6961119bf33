"""The features of a task that differ between its variations."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from skiros2_learning.core.sections import Section, near


@dataclass(frozen=True)
class Feature:
    """A number that differs between the variations of a task, and that the robot knows.

    :param element, property: label of the element, and its property in the scene with the number.
    :param low, high: range that is learned.
    """

    name: str
    element: str
    property: str
    low: float
    high: float
    unit: str = ""

    def unit_of(self, value: float) -> float:
        """Scales a value to 0 to 1."""
        return (value - self.low) / (self.high - self.low)


def read_feature(name: str, section: Section) -> Feature:
    """Reads a feature of a scenario."""
    low, high = section.numbers("range", 2)
    if low >= high and len(section.items("range")) == 2:
        section.problem("range", f"expected the lower bound first, got [{low:g}, {high:g}]")
    feature = Feature(
        name, section.text("element", ""), section.text("property", ""), low, high, section.text("unit", "")
    )
    section.end()
    return feature


def variation_problems(features: Sequence[Feature], variation: Any) -> list[str]:
    """Describes all mistakes in the values of features."""
    if not isinstance(variation, Mapping):
        return [f"expected features and values, got {variation!r}"]
    names = [each.name for each in features]
    found = [f"no feature is called {name!r}; {near(str(name), names)}" for name in variation if name not in names]
    for each in features:
        value: Any = variation.get(each.name)
        is_number = isinstance(value, int | float) and not isinstance(value, bool)
        if not is_number or not each.low <= value <= each.high:
            unit = f" {each.unit}" if each.unit else ""
            found.append(f"{each.name}: expected {each.low:g} to {each.high:g}{unit}, got {value!r}")
    return found
