"""The output of `rosrun skiros2_task achieve`."""

from __future__ import annotations

import io
import json
import re
from typing import Any

import pytest

from skiros2_common.command_line.layout import Screen
from skiros2_common.core.explanation import EXECUTE, Explanation
from skiros2_msgs.msg import AchieveFeedback, AchieveResult
from skiros2_task.command_line.achieve import ProgressPrinter, format_result


def planned(number: int, label: str, robot: str, end: float, **arguments: str) -> dict[str, Any]:
    return {
        "number": number,
        "skill": f"skiros:{label.capitalize()}",
        "label": label,
        "robot": robot,
        "arguments": {"Robot": "cora:Robot-1", **arguments},
        "start": 0.0,
        "end": end,
        "after": [],
    }


def progress(number: int, robot: str, state: str, message: str = "") -> dict[str, Any]:
    return {"number": number, "robot": robot, "state": state, "message": message}


PLAN = [planned(1, "drive", "/alpha", 5.0, To="skiros:Location-2"), planned(2, "pick", "/beta", 7.0)]


def feedback(phase: str, message: str = "", plan: Any = (), steps: Any = ()) -> Any:
    return AchieveFeedback(phase, message, json.dumps(list(plan)), json.dumps(list(steps)), "{}")


def lines(*feedbacks: Any, fancy: bool = True) -> list[str]:
    """Returns the printed lines without the times."""
    out = io.StringIO()
    printer = ProgressPrinter(Screen(fancy=fancy), out)
    for one in feedbacks:
        printer.on_feedback(one)
    found = out.getvalue().splitlines()
    assert all(re.match(r" *\d+\.\d s  ", line) for line in found)
    return [line.partition(" s  ")[2] for line in found]


def test_plan_and_step_states_are_printed_once() -> None:
    running = [progress(1, "/alpha", "running"), progress(2, "/beta", "waiting")]
    later = [progress(1, "/alpha", "succeeded"), progress(2, "/beta", "running")]
    assert lines(
        feedback("planning", "reading the world model"),
        feedback("running", "", PLAN, running),
        feedback("running", "", PLAN, running),
        feedback("running", "", PLAN, later),
    ) == [
        "planning: reading the world model",
        "a plan of 2 steps of 2 robots, 7.0 s",
        "  ▶ 1 drive by /alpha To=skiros:Location-2",
        "  ✓ 1 drive by /alpha",
        "  ▶ 2 pick by /beta",
    ]


def test_failure_and_new_plan_are_printed() -> None:
    failed = [progress(1, "/alpha", "failed", "the way is blocked"), progress(2, "/beta", "dropped")]
    again = [*PLAN[1:], planned(3, "drive", "/beta", 4.0)]
    found = lines(
        feedback("running", "", PLAN, [progress(1, "/alpha", "running")]),
        feedback("planning", "step 1 has failed", PLAN, failed),
        feedback("running", "", again, [progress(3, "/beta", "running")]),
        fancy=False,
    )
    assert found[2:] == [
        "planning: step 1 has failed",
        "  x 1 drive by /alpha: the way is blocked",
        "  . 2 pick by /beta",
        "another plan of 1 step of 1 robot, 4.0 s",
        "  > 3 drive by /beta",
    ]


def test_arguments_have_labels_and_successful_skills_their_message() -> None:
    step = {**PLAN[0], "labels": {"To": "Shelf A", "Robot": "alpha"}}
    assert lines(
        feedback("running", "", [step], [progress(1, "/alpha", "running")]),
        feedback("running", "", [step], [progress(1, "/alpha", "succeeded", "arrived in 3 s")]),
    )[1:] == ['  ▶ 1 drive by /alpha To="Shelf A"', "  ✓ 1 drive by /alpha: arrived in 3 s"]


@pytest.mark.parametrize("width", [80, 140])
def test_long_reason_is_wrapped_not_cut(width: int) -> None:
    reason = " ".join(f"reason-{number}" for number in range(40))
    out = io.StringIO()
    printer = ProgressPrinter(Screen(width, fancy=False), out)
    printer.on_feedback(feedback("running", "", PLAN, [progress(1, "/alpha", "failed", reason)]))
    found = out.getvalue().splitlines()
    assert all(len(line) <= width for line in found)
    assert " ".join(" ".join(found).split()).endswith(f"x 1 drive by /alpha: {reason}")


def test_json_output_has_no_progress() -> None:
    printer = ProgressPrinter(Screen(), None)
    printer.on_feedback(feedback("running", "", PLAN))
    assert printer.seconds >= 0.0


def result(state: str, message: str = "", done: Any = (), explanations: Any = ()) -> Any:
    return AchieveResult(state, message, json.dumps(list(done)), json.dumps(list(explanations)))


def test_final_states_are_printed_before_result() -> None:
    out = io.StringIO()
    printer = ProgressPrinter(Screen(fancy=True), out)
    steps = [progress(1, "/alpha", "running"), progress(2, "/beta", "waiting")]
    printer.on_feedback(feedback("running", "", PLAN, steps))
    done = [{**PLAN[0], **progress(1, "/alpha", "succeeded")}]
    printer.end(result("succeeded", "done", done))
    assert out.getvalue().splitlines()[-1].endswith("  ✓ 1 drive by /alpha")
    steps = [progress(1, "/alpha", "succeeded"), progress(2, "/beta", "running")]
    printer.on_feedback(feedback("running", "", PLAN, steps))
    assert out.getvalue().splitlines()[-1].endswith("  ✓ 1 drive by /alpha")


def test_reached_goal_prints_step_count() -> None:
    done = [progress(1, "/alpha", "failed"), progress(2, "/beta", "succeeded"), progress(3, "/alpha", "succeeded")]
    text, data = format_result(result("succeeded", "done", done), 12.34)
    assert text == ["the goal is reached after 12.3 s: 2 steps done, 1 more did not succeed"]
    assert data == {"state": "succeeded", "message": "done", "done": done, "explanations": []}


def test_satisfied_goal_prints_message() -> None:
    assert format_result(result("nothing_to_do", "the goal holds already"), 0.5)[0] == ["the goal holds already"]


def test_failed_goal_prints_explanation() -> None:
    why = Explanation(EXECUTE, "skiros:Drive", "drive", 3, -1, "the way is blocked", stamp=1.0)
    done = [progress(1, "/alpha", "failed", "the way is blocked")]
    message = "drive failed: the way is blocked. The goal is given up after 5 other plans."
    text, data = format_result(result("failed", message, done, [why.to_dict()]), 60.0)
    assert text == [
        "drive failed: the way is blocked. The goal is given up after 5 other plans.",
        "the goal is not reached after 60.0 s, 0 steps done",
        *(f"  {line}" for line in why.details()),
    ]
    assert data["explanations"] == [why.to_dict()]


def test_cancelled_goal_prints_message() -> None:
    assert format_result(result("cancelled", "by the client"), 1.0)[0] == [
        "by the client",
        "the goal was cancelled after 1.0 s, 0 steps done",
    ]
