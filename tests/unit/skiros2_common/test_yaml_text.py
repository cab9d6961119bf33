"""YAML of files and messages: usual texts are read, those that grow without end are refused."""

from __future__ import annotations

import tracemalloc
from typing import Any

import pytest

from skiros2_common.core.errors import WrongValue
from skiros2_common.core.yaml_text import YamlText, read_yaml


def _growing(depth: int, factor: int, is_merged: bool = False) -> str:
    key, first = ("{<<: [%s]}", "{k: x}") if is_merged else ("[%s]", "[x]")
    lines = [f"a0: &a0 {first}"]
    lines += [f"a{i}: &a{i} {key % ', '.join([f'*a{i - 1}'] * factor)}" for i in range(1, depth)]
    return "\n".join(lines)


@pytest.mark.parametrize(
    ("text", "data"),
    [
        ("", None),
        ("a: [1, 2.5, true, x]", {"a": [1, 2.5, True, "x"]}),
        ("a: &x {k: 1}\nb: *x\nc: {<<: *x, l: 2}", {"a": {"k": 1}, "b": {"k": 1}, "c": {"k": 1, "l": 2}}),
        ("[" * 90 + "]" * 90, None),
        ("a: &x [1]\n" + "".join(f"k{i}: *x\n" for i in range(5000)), None),
    ],
)
def test_usual_text_is_read(text: str, data: Any) -> None:
    found = read_yaml(text)
    assert data is None or found == data


@pytest.mark.parametrize(
    ("text", "error"),
    [
        (_growing(10, 10), r"stands for more than \d+ characters.*line 7"),
        (_growing(100, 2), "stands for more than"),
        (_growing(30, 2, is_merged=True), "stands for more than"),
        (f"a: &a {'x' * 100_000}\nb: [{', '.join(['*a'] * 1000)}]", "stands for more than"),
        ("a: &a [*a]", "an alias refers to what contains it"),
        ("a: &a {b: [*a]}", "an alias refers to what contains it"),
        ("[" * 100_000, "nested more than 100 deep"),
        ("a: " * 3 + "b", "mapping values are not allowed here"),
        ("- " * 50_000, "nested more than 100 deep"),
        ("x" * 2_000_000, "at most 1048576 characters"),
        ("!!python/object/apply:os.system [ls]", "could not determine a constructor"),
        ("2001-99-99", "month must be in 1..12"),
        ("9" * 5000, "limit"),
        ("!!float x", "could not convert"),
        ("!!bool x", "does not fit its tag"),
        ("!!timestamp x", "does not fit its tag"),
        ("!!int ''", "does not fit its tag"),
        ("? [a]\n: b", "unhashable key"),
        ("a: 'b", "end of stream"),
        ("*x", "undefined alias"),
        ("a\x00b", "special characters"),
    ],
)
def test_hostile_text_is_refused(text: str, error: str) -> None:
    tracemalloc.start()
    try:
        with pytest.raises(WrongValue, match=error):
            read_yaml(text)
        assert tracemalloc.get_traced_memory()[1] < 50_000_000
    finally:
        tracemalloc.stop()


def test_lines_are_those_of_keys_and_items() -> None:
    text = YamlText("base: &b\n  k: 1\nlist:\n- a\n- x: {y: 2}\n  <<: *b\nlist: [\n 1, {z: 1, z: 2},\n 3]\n")
    for path, line in (((), 0), (("none",), 0), (("base", "k"), 2), (("base", "none"), 1), (("list", 1), 8),
                       (("list", 2), 9), (("list", 1, "z"), 8), (("list", "k"), 7)):  # fmt: skip
        assert text.line(path) == line, path
    assert sorted(text.repeated, key=len) == [("list",), ("list", 1, "z")]
    assert YamlText("a: &b {k: 1}\nc: {<<: *b, k: 2}\n").repeated == []
    assert YamlText("").line(("a",)) == 0
