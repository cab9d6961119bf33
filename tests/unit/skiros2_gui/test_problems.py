"""The problems of the error bar."""

from __future__ import annotations

import pytest

from skiros2_common.core.errors import UnknownName
from skiros2_gui.app.problems import MAX_KEPT, Problems, error_text


def test_dismissed_problem_stays_in_history() -> None:
    problems = Problems(clock=lambda: 5.0)
    lines: list[str | None] = []
    problems.on_change(lambda: lines.append(problems.newest and problems.newest.line))
    problems.report("loading the scene", UnknownName("there is no file pick.ttl"))
    problems.report("", "nobody answers")
    problems.dismiss()
    problems.dismiss()
    assert lines == ["loading the scene: there is no file pick.ttl", "nobody answers", None]
    assert [p.text for p in problems.history] == ["nobody answers", "there is no file pick.ttl"]
    assert problems.history[0].stamp == 5.0


def test_repeated_problem_is_counted() -> None:
    problems = Problems()
    for _ in range(3):
        problems.report("asking", "nobody answers")
    assert [p.line for p in problems.history] == ["asking: nobody answers (3 times)"]


def test_history_is_bounded() -> None:
    problems = Problems()
    for number in range(MAX_KEPT + 5):
        problems.report("", str(number))
    assert len(problems.history) == MAX_KEPT
    problems.clear()
    assert problems.newest is None
    assert problems.history == []


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (UnknownName("no task 3"), "no task 3"),
        (FileNotFoundError(2, "No such file or directory", "/x.ttl"), "/x.ttl: No such file or directory"),
        (ZeroDivisionError("division by zero"), "ZeroDivisionError: division by zero"),
        (KeyError(), "KeyError"),
        ("plain", "plain"),
    ],
)
def test_error_text_formats_errors(error: Exception | str, words: str) -> None:
    assert error_text(error) == words
