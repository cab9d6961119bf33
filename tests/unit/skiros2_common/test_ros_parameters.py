"""ROS parameters of nodes, checked."""

from __future__ import annotations

import math
from typing import Any

import pytest

from skiros2_common.core.errors import ConfigurationError
from skiros2_common.ros.parameters import integer_param, number_param


def number(value: Any, **limits: Any) -> float:
    return number_param("~rate", 1.0, get=lambda name, default: value, **limits)


def test_numbers_within_the_limits_are_read() -> None:
    assert number(2) == 2.0
    assert number(0.0, minimum=0.0) == 0.0
    assert number(math.inf, maximum=math.inf) == math.inf
    assert integer_param("~count", 3, get=lambda name, default: default) == 3


@pytest.mark.parametrize(
    ("value", "limits", "expected"),
    [
        ("fast", {}, "'fast', expected a number"),
        (True, {}, "True, expected a number"),
        (math.nan, {"minimum": 0.0}, "nan, expected a number from 0"),
        (math.inf, {"above": 0.0}, "inf, expected a number above 0"),
        (0, {"above": 0.0, "maximum": 9.0}, "0, expected a number above 0 and up to 9"),
        (10, {"minimum": 1.0, "maximum": 9.0}, "10, expected a number from 1 and up to 9"),
    ],
)
def test_other_values_are_refused_with_the_limits(value: Any, limits: dict[str, float], expected: str) -> None:
    with pytest.raises(ConfigurationError) as found:
        number(value, **limits)
    assert str(found.value) == f"parameter ~rate is {expected}"


@pytest.mark.parametrize("value", [1.5, "1", False, None])
def test_an_integer_has_no_fraction(value: Any) -> None:
    with pytest.raises(ConfigurationError, match=r"parameter ~count is .*, expected an integer from 0"):
        integer_param("~count", 0, minimum=0, get=lambda name, default: value)
