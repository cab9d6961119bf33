"""What went wrong, as the error bar has it."""

from __future__ import annotations

import pytest

from skiros2_common.core.errors import UnknownName
from skiros2_gui.app.problems import MAX_KEPT, Problems, error_text


def test_the_newest_is_shown_until_it_is_put_away_and_kept_then() -> None:
    problems = Problems(clock=lambda: 5.0)
    told: list[str | None] = []
    problems.on_change(lambda: told.append(problems.newest and problems.newest.line))
    problems.report("loading the scene", UnknownName("there is no file pick.ttl"))
    problems.report("", "nobody answers")
    problems.dismiss()
    problems.dismiss()
    assert told == ["loading the scene: there is no file pick.ttl", "nobody answers", None]
    assert [p.text for p in problems.history] == ["nobody answers", "there is no file pick.ttl"]
    assert problems.history[0].stamp == 5.0


def test_the_same_one_again_is_counted() -> None:
    problems = Problems()
    for _ in range(3):
        problems.report("asking", "nobody answers")
    assert [p.line for p in problems.history] == ["asking: nobody answers (3 times)"]


def test_no_more_are_kept_than_can_be_read() -> None:
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
def test_errors_in_words(error: Exception | str, words: str) -> None:
    assert error_text(error) == words
