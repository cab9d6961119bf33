"""Checking from a bag that a goal was reached."""

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from skiros2_bags.core.bag_file import BagError
from skiros2_bags.core.run import Finding
from skiros2_demo.run_check import check, read_run
from support.recorded_run import (
    FAILURE,
    GOAL,
    PLAN,
    PRODUCT,
    RUNNING,
    SUCCESS,
    TRAY_A,
    done,
    good_run,
    tree,
    write_bag,
)


def findings(folder: Path, messages: list[tuple[str, Any]]) -> list[Finding]:
    return check(read_run(write_bag(folder / "run.bag", messages)))


def failed(folder: Path, messages: list[tuple[str, Any]]) -> str:
    return "\n".join(finding.text for finding in findings(folder, messages) if not finding.holds)


def without(kind: str) -> list[tuple[str, Any]]:
    return [message for message in good_run() if message[0] != kind]


def with_tree(nodes: list[Any]) -> list[tuple[str, Any]]:
    """The run, with other nodes of the last task at its end."""
    messages = good_run()
    messages[-2] = ("progress", nodes)
    return messages


def test_successful_run_passes(tmp_path: Path) -> None:
    found = findings(tmp_path, good_run())
    assert all(finding.holds for finding in found)
    assert [finding.text for finding in found] == [
        "the bag has all of the run from its start",
        "a plan was made: pick, place",
        "/robot did: pick, place",
        "at the end: Product A is in Tray B",
    ]


def test_misplaced_product_fails(tmp_path: Path) -> None:
    messages = [message for message in good_run() if message[0] != "change" or message[1].action == "reset"]
    assert failed(tmp_path, messages) == "at the end: Product A is in Tray B"


def test_failed_skill_is_named(tmp_path: Path) -> None:
    found = failed(tmp_path, with_tree(tree("place", FAILURE)))
    assert found == "/robot did: pick, place (failed); reported: pick, place"


@pytest.mark.parametrize("state", [SUCCESS, RUNNING])
def test_task_without_recorded_end_fails(tmp_path: Path, state: int) -> None:
    assert "place (did not end)" in failed(tmp_path, with_tree(tree("place", state, ended=False)))


def test_failed_step_of_an_earlier_plan_is_reported(tmp_path: Path) -> None:
    again = [{**step, "number": step["number"] + 1} for step in json.loads(PLAN)]
    steps = [*json.loads(done("failed", "succeeded")), *({**step, "state": "succeeded"} for step in again)]
    steps = [step for step in steps if (step["number"], step["label"]) != (2, "place")]
    first, goal, plan, *rest = good_run()
    messages = [first, goal, plan, ("progress", tree("pick", FAILURE, task=3))]
    messages += [("feedback", ("goal-1", json.dumps(again[1:]))), *rest[:-1]]
    messages.append(("result", ("goal-1", "succeeded", json.dumps(steps))))
    assert [finding.text for finding in findings(tmp_path, messages) if finding.holds] == [
        "the bag has all of the run from its start",
        "a plan was made: pick, place",
        "another plan was made: place",
        "/robot did: pick (failed), pick, place",
        "at the end: Product A is in Tray B",
    ]


def test_parallel_steps_may_start_in_another_order(tmp_path: Path) -> None:
    """The task manager sends the steps of a robot with two arms at the same time: a busy machine swaps them."""
    reported = [
        {**step, "task": task} for step, task in zip(json.loads(done("failed", "succeeded")), (7, 8), strict=True)
    ]
    messages = [message for message in good_run() if message[0] not in ("progress", "result")]
    messages += [("progress", tree("place")), ("progress", tree("pick", FAILURE))]
    messages.append(("result", ("goal-1", "succeeded", json.dumps(reported))))
    assert failed(tmp_path, messages) == ""
    swapped = [{**step, "task": 15 - step["task"]} for step in reported]
    messages[-1] = ("result", ("goal-1", "succeeded", json.dumps(swapped)))
    (tmp_path / "run.bag").unlink()
    assert "reported: pick (failed), place" in failed(tmp_path, messages)


@pytest.mark.parametrize("state", [SUCCESS, FAILURE])
def test_stopped_step_has_not_succeeded(tmp_path: Path, state: int) -> None:
    messages = with_tree(tree("place", state))
    messages[-1] = ("result", ("goal-1", "succeeded", done("succeeded", "stopped")))
    found = failed(tmp_path, messages)
    assert found == ("" if state == FAILURE else "/robot did: pick, place; reported: pick, place (stopped)")


def test_unreported_skills_fail(tmp_path: Path) -> None:
    messages = good_run()
    messages[-1] = ("result", ("goal-1", "succeeded", json.dumps(json.loads(done("succeeded", "succeeded"))[:1])))
    assert failed(tmp_path, messages) == "/robot did: pick, place; reported: pick"


@pytest.mark.parametrize("absent", [(), ("progress",)])
def test_unexecuted_plan_fails(tmp_path: Path, absent: tuple[str, ...]) -> None:
    found = check(read_run(write_bag(tmp_path / "run.bag", without("progress"), absent)))
    assert Finding(False, "/robot did: nothing; reported: pick, place") in found


def test_tasks_before_the_goal_are_ignored(tmp_path: Path) -> None:
    first, *rest = without("progress")
    found = failed(tmp_path, [first, ("progress", tree("pick")), ("progress", tree("place")), *rest])
    assert found == "/robot did: nothing; reported: pick, place"


def test_only_the_last_goal_is_checked(tmp_path: Path) -> None:
    messages = good_run()
    messages.insert(2, ("goal", ("goal-2", GOAL)))
    assert "did not answer" in failed(tmp_path, messages)


def test_unreached_goal_has_a_reason(tmp_path: Path) -> None:
    messages = [*good_run()[:2], ("result", ("goal-1", "impossible", "[]"))]
    assert "the goal ended as impossible: says so" in failed(tmp_path, messages)


def test_already_reached_goal_passes_without_task(tmp_path: Path) -> None:
    reached = f"(skiros:contain {TRAY_A} {PRODUCT})"
    messages = [good_run()[0], ("goal", ("goal-1", reached)), ("result", ("goal-1", "nothing_to_do", "[]"))]
    assert failed(tmp_path, messages) == ""


@pytest.mark.parametrize(
    ("goal", "reached"),
    [
        (GOAL, True),
        (f"(contain demo:Tray-12 {PRODUCT})", True),
        (f"(not (skiros:contain {TRAY_A} {PRODUCT}))", True),
        (f"(not {GOAL})", False),
        (f"(and {GOAL} (skiros:contain {TRAY_A} {PRODUCT}))", False),
        (f"(or {GOAL} (skiros:contain {TRAY_A} {PRODUCT}))", True),
        (f"{GOAL}, (skiros:contain {TRAY_A} {PRODUCT})", False),
    ],
)
def test_goals_about_relations_are_checked(tmp_path: Path, goal: str, reached: bool) -> None:
    messages = good_run()
    messages[1] = ("goal", ("goal-1", goal))
    assert all(finding.holds for finding in findings(tmp_path, messages)) == reached


@pytest.mark.parametrize("goal", ["(forall (?x - skiros:Product) (skiros:contain demo:Tray-12 ?x))", "(Painted x)"])
def test_goals_of_other_kinds_are_rejected(tmp_path: Path, goal: str) -> None:
    messages = good_run()
    messages[1] = ("goal", ("goal-1", goal))
    with pytest.raises(BagError, match="only goals about relations"):
        findings(tmp_path, messages)


def test_goal_with_an_unknown_element_is_rejected(tmp_path: Path) -> None:
    messages = good_run()
    messages[1] = ("goal", ("goal-1", "(skiros:contain demo:Tray-99 skiros:Product-14)"))
    with pytest.raises(BagError, match="demo:Tray-99"):
        findings(tmp_path, messages)


def test_bag_without_a_goal_is_rejected(tmp_path: Path) -> None:
    messages = without("goal")
    with pytest.raises(BagError, match=r"run\.bag: no goal was given to a task manager to be achieved"):
        read_run(write_bag(tmp_path / "run.bag", messages))


def test_bag_without_the_start_of_a_task_fails(tmp_path: Path) -> None:
    messages = good_run()
    for node in messages[3][1]:
        node.progress_time = 5.0
    assert "it was running before" in failed(tmp_path, messages)


def test_truncated_bag_is_rejected(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "run.bag", good_run())
    bag.write_bytes(bag.read_bytes()[:-1])
    with pytest.raises(BagError, match=r"run\.bag"):
        read_run(bag)


@pytest.mark.parametrize("at", [2, -1], ids=["plan", "result"])
def test_invalid_plan_is_rejected(tmp_path: Path, at: int) -> None:
    messages = good_run()
    messages[at] = (messages[at][0], (*messages[at][1][:-1], PLAN[:-5]))
    with pytest.raises(BagError, match="the plan cannot be read"):
        findings(tmp_path, messages)


def test_check_needs_no_ros() -> None:
    code = "import sys, skiros2_demo.run_check; print([m for m in sys.modules if m in ('rospy', 'rosbag', 'genpy')])"
    shown = subprocess.run(
        [sys.executable, "-c", code],
        env={"PYTHONPATH": os.pathsep.join(sys.path)},
        capture_output=True,
        text=True,
        check=True,
    ).stdout
    assert shown.strip() == "[]"
