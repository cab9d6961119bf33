"""Hints of parameters, and the values of earlier starts."""

from __future__ import annotations

from typing import Any

import pytest

from skiros2_common.core.limits import NO_LIMITS, Limits
from skiros2_gui.skills.form import Field
from skiros2_gui.skills.recent import RecentValues
from skiros2_skill.client.description import Parameter


@pytest.mark.parametrize(
    ("wire_type", "values", "limits", "hint"),
    [
        ("float", [0.5], Limits("m/s", 0.1, 2), "How fast · 0.1 to 2 m/s · default 0.5"),
        ("int", [], NO_LIMITS, "How fast"),
        ("float", [1.5], Limits("m"), "How fast · default 1.5"),
        ("bool", [False], NO_LIMITS, "How fast · default no"),
        ("str", ["soft"], Limits(choices=("soft", "hard")), "How fast · default soft"),
        ("str", [""], NO_LIMITS, 'How fast · default ""'),
        ("list", [[1, 2]], NO_LIMITS, "How fast · default [1, 2]"),
    ],
)
def test_hint_has_description_limits_and_default(wire_type: str, values: list[Any], limits: Limits, hint: str) -> None:
    assert Field(Parameter("Speed", "optional", wire_type, values, "How fast", limits)).hint == hint


def test_newest_value_comes_first_and_is_listed_once() -> None:
    recent = RecentValues()
    for value in ("1", "2", "3", "4", "5", "6", "3"):
        recent.note("skiros:Wait", {"Duration": value})
    assert recent.of("skiros:Wait", "Duration") == ["3", "6", "5", "4", "2"]
    assert recent.of("skiros:Drive", "Duration") == []


def test_values_are_restored_and_invalid_ones_skipped() -> None:
    recent, other = RecentValues(), RecentValues()
    recent.note("skiros:Wait", {"Duration": "1", "Text": "a"})
    recent.note("skiros:Wait", {"Duration": "2"})
    for settings in (recent.settings(), 3, {"skiros:Wait": [1]}, {"skiros:Wait": {"Text": 5, "Duration": [7, None]}}):
        other.restore(settings)
    assert other.settings() == recent.settings()
