"""Parsing of times of a bag."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from skiros2_bags.command_line.commands import local_time, parse_time
from skiros2_common.core.errors import WrongValue

START = 1795233085.25
RUN: Any = SimpleNamespace(start=START, end=START + 60)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("12.5", START + 12.5),
        (" 0 ", START),
        ("-3", START + 57),
        ("1795233090.5", 1795233090.5),
        (local_time(START + 5), int(START) + 5),
    ],
)
def test_time_is_parsed(text: str, expected: float) -> None:
    assert parse_time(text, RUN) == expected


@pytest.mark.parametrize("text", ["", "nan", "inf", "noon", "25:00"])
def test_invalid_time_is_rejected(text: str) -> None:
    with pytest.raises(WrongValue, match="is not a time"):
        parse_time(text, RUN)
