"""Checks that a bag is complete."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from skiros2_bags.core.run import Run, check
from support.recorded_run import GOAL, Monitor, good_run, moved, scene, tree, write_bag


def findings(tmp_path: Path, messages: list[tuple[str, Any]], **how: Any) -> list[tuple[bool, str]]:
    file = write_bag(tmp_path / f"{len(list(tmp_path.iterdir()))}.bag", messages, **how)
    return [(f.holds, f.text) for f in check(Run.open(file))]


def test_complete_run_passes_all_checks(tmp_path: Path) -> None:
    assert findings(tmp_path, good_run()) == [
        (True, "the file is whole"),
        (True, "2 changes follow one another without a gap, from a scene of 3 elements"),
        (True, "2 tasks are complete from their start"),
        (True, "1 goals of actions are complete, each with an answer"),
    ]


def test_gap_in_the_changes_is_reported(tmp_path: Path) -> None:
    monitor = Monitor()
    first = monitor("reset", *scene())
    monitor("update")
    found = findings(tmp_path, [("change", first), ("change", monitor("update", *moved()))])
    assert [text for holds, text in found if not holds] == [
        "at 0.000 s changes of the world model are missing between 's1' and 's2', before the update 's3' of 'test'"
    ]


def test_task_started_before_the_recording_is_reported(tmp_path: Path) -> None:
    nodes = tree("pick", 3, ended=False)
    nodes[1].progress_time = 4.0
    found = findings(tmp_path, [("change", Monitor()("reset")), ("progress", nodes)])
    assert (False, "/robot, task 7: it was running before 0.000 s") in found


def test_lost_and_unanswered_goals_are_reported(tmp_path: Path) -> None:
    lost = [entry for entry in good_run() if entry[0] != "goal"]
    assert (False, "/tm/achieve: the goal 'goal-1' was sent before the recorder subscribed") in findings(tmp_path, lost)
    unanswered = findings(tmp_path, [("goal", ("g", GOAL))])
    assert (False, "/tm/achieve: no answer to the goal sent at 0.000 s") in unanswered


def test_bag_without_changes_is_reported(tmp_path: Path) -> None:
    found = findings(tmp_path, [], without=("change", "progress", "goal", "feedback", "result"))
    assert (False, "no change of a world model was recorded") in found
