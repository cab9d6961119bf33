"""The progress of a goal of a task manager, as JSON data: {goal, phase, message, start, plan, steps}.

`goal` is its text, `plan` that of the feedback of `Achieve`, with the steps of earlier plans; `steps` by number:
{state, message, began, ended, task}: times in s since the epoch, `task` is the number of the step's task.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from typing import Any

#: The phases of a goal that is being executed; others are the state of the result.
ACTIVE_PHASES = ("", "planning", "running", "stopping", "asking")
#: The states of a step that is not started.
_NOT_STARTED = ("waiting", "dropped")


def new_goal(text: str, time: float) -> dict[str, Any]:
    """Returns a goal that was sent at a time (s since the epoch)."""
    return {"goal": text, "phase": "", "message": "", "start": time, "plan": [], "steps": {}}


def goal_after(known: Mapping[str, Any], message: Any, time: float) -> dict[str, Any]:
    """Returns a goal after the next message of its action; its phase after the end is the state of the result.

    :param known: the goal before; empty if it is not known.
    :param message: an `AchieveActionFeedback` or an `AchieveActionResult`.
    :param time: when it was received (s since the epoch): when the steps that it reports first have begun or ended.
    """
    goal = dict(known) or new_goal("", time)
    if hasattr(message, "feedback"):
        part = message.feedback
        return after_feedback(goal, part.phase, part.message, part.plan, part.steps, time)
    part = message.result
    return after_result(goal, part.state, part.message, part.done, time)


def after_feedback(
    goal: Mapping[str, Any], phase: str, message: str, plan: str, steps: str, time: float
) -> dict[str, Any]:
    """Returns a goal after an `AchieveFeedback` with these fields; one that comes after the result changes nothing.

    :raises ValueError: it cannot be read.
    """
    if goal["phase"] not in ACTIVE_PHASES:
        return dict(goal)  # each topic has its own connection
    new = _read(plan)
    after = _after(goal, new, _read(steps), time)
    current = {str(step["number"]) for step in new}
    if current:  # a new plan drops what the last one had not started
        _drop(after, lambda number: number not in current)
    return {**after, "phase": phase, "message": message}


def after_result(goal: Mapping[str, Any], state: str, message: str, done: str, time: float) -> dict[str, Any]:
    """Returns a goal after an `AchieveResult` with these fields.

    :raises ValueError: it cannot be read.
    """
    steps = _read(done)
    known = {step["number"] for step in goal["plan"]}
    after = _after(goal, [step for step in steps if "skill" in step and step["number"] not in known], steps, time)
    _drop(after, lambda number: True)
    return {**after, "phase": state, "message": message}


def _after(
    goal: Mapping[str, Any], plan: list[dict[str, Any]], steps: list[dict[str, Any]], time: float
) -> dict[str, Any]:
    known = {step["number"]: step for step in goal["plan"]}
    known.update((step["number"], step) for step in plan)
    states = {number: dict(step) for number, step in goal["steps"].items()}
    for step in steps:
        state, entry = str(step["state"]), states.setdefault(str(step["number"]), {})
        if state not in _NOT_STARTED:
            entry.setdefault("began", time)
            if state != "running":
                entry.setdefault("ended", time)
        entry.update(state=state, message=str(step.get("message", "")))
        if "task" in step:
            entry["task"] = int(step["task"])
    return {**goal, "plan": list(known.values()), "steps": states}


def _drop(goal: dict[str, Any], is_dropped: Callable[[str], bool]) -> None:
    for number, step in goal["steps"].items():
        if step["state"] == "waiting" and is_dropped(number):
            step["state"] = "dropped"


def _read(text: str) -> list[dict[str, Any]]:
    data = json.loads(text or "[]")
    if not isinstance(data, list) or not all(isinstance(item, dict) and "number" in item for item in data):
        raise ValueError(f"expected a list of steps, got {text[:80]!r}")
    return data
