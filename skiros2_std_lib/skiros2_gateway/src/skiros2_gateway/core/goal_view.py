"""Goals in bags as JSON data for the live view, see `goal_progress`."""

from __future__ import annotations

from typing import Any

from skiros2_bags.core.run import Run
from skiros2_runs.core.goal_progress import goal_after, new_goal


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
