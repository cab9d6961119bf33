"""What is up and what is missing, in words."""

from __future__ import annotations

import time

import pytest

from skiros2_gui.app.health import clock, missing, sentence, short, sign
from skiros2_gui.app.system import MANAGER, MASTER, TASK_MANAGER, WORLD_MODEL, Part

NOW = 1795291003.5  # s since the epoch
AT = clock(NOW)


def test_a_part_in_short_and_in_a_sentence() -> None:
    robot = Part(MANAGER, "/arm", False, NOW, "It was killed.")
    assert short(robot) == "robot arm"
    assert sentence(robot) == f"The robot /arm has not been there since {AT}. It was killed."
    assert short(Part(WORLD_MODEL, "/wm", True, NOW)) == "world model"
    assert sentence(Part(WORLD_MODEL, "/wm", True, NOW)) == f"The world model has been there since {AT}."


@pytest.mark.parametrize(
    ("is_up", "since", "mark"),
    [(True, NOW, ("●", "success")), (False, NOW, ("✕", "failure")), (False, 0.0, ("○", "idle"))],
)
def test_a_part_that_has_gone_and_one_that_never_came_have_signs_of_their_own(
    is_up: bool, since: float, mark: tuple[str, str]
) -> None:
    assert sign(Part(TASK_MANAGER, "/tm", is_up, since)) == mark


def test_what_was_never_there_has_no_time() -> None:
    assert sentence(Part(TASK_MANAGER, "/tm", False, 0.0)) == "The task manager is not there yet."
    assert missing([Part(WORLD_MODEL, "/wm", False, 0.0)], (WORLD_MODEL,)) == "The world model is not there yet."


def test_a_time_of_another_day_has_its_day() -> None:
    assert clock(0.0).startswith(time.strftime("%Y-%m-%d", time.localtime(0.0)))


@pytest.mark.parametrize(
    ("parts", "needs", "told"),
    [
        ([], (WORLD_MODEL,), "The world model is not there yet."),
        (
            [],
            (MANAGER, TASK_MANAGER),
            "No robot is there yet: no skill manager runs. The task manager is not there yet.",
        ),
        ([Part(WORLD_MODEL, "/wm", True, NOW)], (WORLD_MODEL,), ""),
        ([Part(WORLD_MODEL, "/wm", False, NOW)], (), ""),
        ([Part(MANAGER, "/a", False, NOW), Part(MANAGER, "/b", True, NOW)], (MANAGER,), ""),
        ([Part(MANAGER, "/a", False, NOW)], (MANAGER,), f"The robot /a has not been there since {AT}."),
    ],
)
def test_what_is_missing_of_what_is_needed(parts: list[Part], needs: tuple[str, ...], told: str) -> None:
    assert missing(parts, needs) == told


def test_without_a_master_nothing_else_is_told() -> None:
    parts = [Part(MASTER, "http://localhost:11311", False, NOW), Part(WORLD_MODEL, "/wm", False, NOW)]
    assert missing(parts, (WORLD_MODEL,)).startswith(
        f"The ROS master http://localhost:11311 has not been there since {AT}."
    )
