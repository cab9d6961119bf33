"""Requests to start skills with names and values that no client means."""

from __future__ import annotations

import json

import pytest

from skiros2_common.core.errors import UnknownName, WrongValue
from skiros2_common.core.wording import short_name
from skiros2_skill.core.runtime.request_json import MAX_NAME, MAX_PARAMS, read_request


@pytest.mark.parametrize(("skill_type", "label"), [("x" * (MAX_NAME + 1), ""), ("skiros:Wait", "x" * 1_000_000)])
def test_long_name_of_a_skill_is_refused_with_a_short_text(skill_type: str, label: str) -> None:
    with pytest.raises(WrongValue, match="over 1000 characters") as refused:
        read_request(skill_type, label, [])
    assert len(str(refused.value)) < 600


def test_many_parameters_are_refused() -> None:
    texts = [json.dumps({"key": f"K{i}", "values": [1]}) for i in range(MAX_PARAMS + 1)]
    assert len(read_request("skiros:Wait", "", texts[:-1]).params) == MAX_PARAMS
    with pytest.raises(WrongValue, match="over 1000 parameters"):
        read_request("skiros:Wait", "", texts)


def test_error_text_is_bounded() -> None:
    text = str(UnknownName("x" * 10_000_000))
    assert len(text) < 100_100 and text.endswith("... (10000000 characters)")


def test_name_of_a_request_is_on_one_short_line() -> None:
    assert short_name("window\n[INFO] all is well\u202e") == "window\\n[INFO] all is well\\u202e"
    assert len(short_name("x" * 1000)) == 203
