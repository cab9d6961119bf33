"""Goals of task managers as JSON data for the live view: {goal, phase, message, start, plan, steps}.

`goal` is its text, `plan` that of the feedback, `steps` by number: {state, message, began, ended} (s since the epoch).
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from skiros2_bags.core.run import Run


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
        phase, plan, steps = part.phase, json.loads(part.plan or "[]"), json.loads(part.steps or "[]")
    else:
        part = message.result
        phase, plan, steps = part.state, [], json.loads(part.done or "[]")
    planned = {step["number"]: step for step in (*goal["plan"], *plan)}
    states = {number: dict(step) for number, step in goal["steps"].items()}
    for step in steps:
        state, entry = str(step["state"]), states.setdefault(str(step["number"]), {})
        if state not in ("waiting", "dropped"):
            entry.setdefault("began", time)
            if state != "running":
                entry.setdefault("ended", time)
        entry.update(state=state, message=str(step.get("message", "")))
    return {**goal, "phase": phase, "message": part.message, "plan": list(planned.values()), "steps": states}


def recorded_goals(run: Run) -> dict[str, dict[str, Any]]:
    """Returns the goals in a bag by their ids.

    :raises BagError: a message cannot be read.
    """
    found = {}
    for each in run.goals():
        goal = new_goal(each.goals, each.time)
        for message in (*each.call.feedback, *filter(None, [each.call.result])):
            goal = goal_after(goal, message.content, message.time)
        found[each.call.goal_id] = goal
    return found
