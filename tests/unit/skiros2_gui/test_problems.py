"""What went wrong, as the error bar has it."""

from __future__ import annotations

import pytest

from skiros2_common.core.errors import UnknownName
from skiros2_gui.core.problems import MOST_KEPT, Problems, in_words


def test_the_newest_is_shown_until_it_is_put_away_and_kept_then() -> None:
    problems = Problems(clock=lambda: 5.0)
    told: list[str | None] = []
    problems.on_change(lambda: told.append(problems.newest and problems.newest.line))
    problems.tell("loading the scene", UnknownName("there is no file pick.ttl"))
    problems.tell("", "nobody answers")
    problems.put_away()
    problems.put_away()
    assert told == ["loading the scene: there is no file pick.ttl", "nobody answers", None]
    assert [p.text for p in problems.history] == ["nobody answers", "there is no file pick.ttl"]
    assert problems.history[0].stamp == 5.0


def test_the_same_one_again_is_counted() -> None:
    problems = Problems()
    for _ in range(3):
        problems.tell("asking", "nobody answers")
    assert [p.line for p in problems.history] == ["asking: nobody answers (3 times)"]


def test_no_more_are_kept_than_can_be_read() -> None:
    problems = Problems()
    for number in range(MOST_KEPT + 5):
        problems.tell("", str(number))
    assert len(problems.history) == MOST_KEPT
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
    assert in_words(error) == words
