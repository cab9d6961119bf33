"""Differences between two runs."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from skiros2_bags.core.diff import Kind, diff_runs
from skiros2_bags.core.run import Run
from skiros2_runs.core.tolerance import Tolerance
from support.recorded_run import (
    FAILURE,
    GOAL,
    PRODUCT,
    RUNNING,
    TRAY_B,
    Monitor,
    element,
    good_run,
    scene,
    tree,
    write_bag,
)
from support.ros import ROOT

Messages = list[tuple[str, Any]]


@pytest.fixture
def compare(tmp_path: Path) -> Callable[..., list[tuple[str, str, str, str]]]:
    numbers = itertools.count()

    def compared(messages: Messages, **how: Any) -> list[tuple[str, str, str, str]]:
        files = (tmp_path / f"{next(numbers)}.bag" for _ in range(2))
        runs = [Run.open(write_bag(file, m)) for file, m in zip(files, (good_run(), messages), strict=True)]
        return [(d.kind, d.where, d.expected, d.got) for d in diff_runs(*runs, **how)]

    return compared


def test_times_and_task_numbers_are_not_compared(compare: Any) -> None:
    again = good_run()
    again.insert(4, ("progress", tree("pick", RUNNING, ended=False)))
    assert compare(again) == []


def test_failed_skill_is_the_first_divergence(compare: Any) -> None:
    messages = good_run()[:5]
    messages[4] = ("progress", tree("pick", FAILURE))
    found = compare(messages)
    assert found[0] == (Kind.NODE, "/robot, task 1: root / pick", "succeeded: pick says so", "failed: pick says so")
    assert (Kind.TASK, "/robot, task 2", "place", "nothing more") in found
    assert (Kind.GOAL, "goal 1", f"{GOAL}: succeeded", f"{GOAL}: no answer") in found
    assert (Kind.SCENE, f'{PRODUCT} "Product A"', "", f"lacks {TRAY_B} skiros:contain {PRODUCT}") in found


def test_different_change_names_its_author(compare: Any) -> None:
    messages = [entry for entry in good_run() if entry[0] != "change"]
    monitor = Monitor()
    elsewhere = element(PRODUCT, "Product A", [(TRAY_B, "skiros:contain", "-1")], PositionX=[0.7])
    messages[:0] = [("change", monitor("reset", *scene())), ("change", monitor("update", elsewhere))]
    assert compare(messages) == [
        (Kind.CHANGE, "change 2 by test", f"update {PRODUCT}", f"{PRODUCT} skiros:PositionX is 0.7, expected 0.5"),
        (Kind.SCENE, f'{PRODUCT} "Product A"', "", "skiros:PositionX is 0.7, expected 0.5"),
    ]
    assert compare(messages, tolerance=Tolerance(0.0, 0.3)) == []


def test_number_of_pose_updates_is_not_compared(compare: Any) -> None:
    messages = good_run()
    monitor = Monitor()
    for action in ("reset", "update"):
        monitor(action)
    inside = [(TRAY_B, "skiros:contain", "-1")]
    there = [element(PRODUCT, "Product A", inside, PositionX=[x]) for x in (0.7, 0.5)]
    messages += [("change", monitor("update", e)) for e in there]
    assert compare(messages) == []
    last = element(PRODUCT, "Product A", inside, PositionX=[0.7])
    assert compare([*messages, ("change", monitor("update", last))]) == [
        (Kind.SCENE, f'{PRODUCT} "Product A"', "", "skiros:PositionX is 0.7, expected 0.5")
    ]


def test_removed_element_differs_in_the_final_scene(compare: Any) -> None:
    messages = good_run()
    monitor = Monitor()
    for action in ("reset", "update"):
        monitor(action)
    messages.append(("change", monitor("remove", element(PRODUCT, "Product A"))))
    found = compare(messages)
    assert (Kind.CHANGE, "change 3 by test", "nothing more", f"remove {PRODUCT}") in found
    assert (Kind.SCENE, PRODUCT, 'there, "Product A"', "not there") in found


def test_different_goal_is_a_divergence(compare: Any) -> None:
    messages = good_run()
    messages[1] = ("goal", ("goal-1", "(skiros:at a b)"))
    assert compare(messages) == [(Kind.GOAL, "goal 1", GOAL, "(skiros:at a b)")]


def test_registered_skills_are_matched_by_label_without_their_comments() -> None:
    earlier, later = (Run.open(ROOT / "tests/bags" / name) for name in ("pick_place.bag", "timed_pick_place.bag"))
    found = diff_runs(earlier, later)  # the skills have other ids, and other parameters
    assert "skill wait hasParam Duration" in [difference.where for difference in found]
    assert not any("Parameter-" in difference.where or "rdfs:comment" in difference.got for difference in found)
    assert not any(difference.kind is Kind.NODE for difference in found)
    assert len(found) < 50
