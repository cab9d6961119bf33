"""The status of parts as text."""

from __future__ import annotations

import time

import pytest

from skiros2_gui.app.system import (
    MANAGER,
    Part,
    clock,
    missing,
    sentence,
    short,
    sign,
)
from skiros2_live.core.patch import MASTER, TASK_MANAGER, WORLD_MODEL

NOW = 1795291003.5  # s since the epoch
AT = clock(NOW)


def test_part_has_short_name_and_sentence() -> None:
    robot = Part(MANAGER, "/arm", False, NOW, "It was killed.")
    assert short(robot) == "robot arm"
    assert sentence(robot) == f"The robot /arm has been missing since {AT}. It was killed."
    assert short(Part(WORLD_MODEL, "/wm", True, NOW)) == "world model"
    assert sentence(Part(WORLD_MODEL, "/wm", True, NOW)) == f"The world model has been running since {AT}."


@pytest.mark.parametrize(
    ("is_up", "since", "expected"),
    [(True, NOW, ("●", "success")), (False, NOW, ("✕", "failure")), (False, 0.0, ("○", "idle"))],
)
def test_parts_that_are_down_and_never_up_have_different_signs(
    is_up: bool, since: float, expected: tuple[str, str]
) -> None:
    assert sign(Part(TASK_MANAGER, "/tm", is_up, since)) == expected


def test_stopped_robot_names_its_stop() -> None:
    robot = Part(MANAGER, "/arm", True, NOW, "Stopped since then: collision.", "protective stop")
    assert (short(robot), sign(robot)) == ("robot arm: protective stop", ("■", "failure"))
    assert sentence(robot) == f"The robot /arm has been running since {AT}. Stopped since then: collision."


def test_part_that_was_never_up_has_no_time() -> None:
    assert sentence(Part(TASK_MANAGER, "/tm", False, 0.0)) == "The task manager is not running yet."
    assert missing([Part(WORLD_MODEL, "/wm", False, 0.0)], (WORLD_MODEL,)) == "The world model is not running yet."


def test_clock_includes_date_unless_today() -> None:
    assert clock(0.0).startswith(time.strftime("%Y-%m-%d", time.localtime(0.0)))


@pytest.mark.parametrize(
    ("parts", "needs", "text"),
    [
        ([], (WORLD_MODEL,), "The world model is not running yet."),
        (
            [],
            (MANAGER, TASK_MANAGER),
            "No robot is running yet: there is no skill manager. The task manager is not running yet.",
        ),
        ([Part(WORLD_MODEL, "/wm", True, NOW)], (WORLD_MODEL,), ""),
        ([Part(WORLD_MODEL, "/wm", False, NOW)], (), ""),
        ([Part(MANAGER, "/a", False, NOW), Part(MANAGER, "/b", True, NOW)], (MANAGER,), ""),
        ([Part(MANAGER, "/a", False, NOW)], (MANAGER,), f"The robot /a has been missing since {AT}."),
    ],
)
def test_missing_describes_required_parts_that_are_down(parts: list[Part], needs: tuple[str, ...], text: str) -> None:
    assert missing(parts, needs) == text


def test_missing_names_only_the_master_if_it_is_down() -> None:
    parts = [Part(MASTER, "http://localhost:11311", False, NOW), Part(WORLD_MODEL, "/wm", False, NOW)]
    assert missing(parts, (WORLD_MODEL,)).startswith(
        f"The ROS master http://localhost:11311 has been missing since {AT}."
    )
