"""Goals in bags: as JSON data, see `goal_progress`, and as tasks whose trees have those of their steps."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator
from typing import Any

from skiros2_bags.core.action_call import ACHIEVE, Goal
from skiros2_bags.core.bag_file import MONITOR, PROGRESS
from skiros2_bags.core.run import Run, add_progress, new_runs
from skiros2_common.core.names import local_name
from skiros2_common.core.wording import label_text
from skiros2_runs.core.goal_progress import goal_after, new_goal
from skiros2_runs.core.goal_runs import GoalRuns
from skiros2_runs.core.task_run import TaskRun
from skiros2_task.core.goal_sentence import goal_sentence


def recorded_goals(run: Run) -> dict[str, dict[str, Any]]:
    """Returns the goals in a bag that were to be achieved, by their ids, each with its `title` for people.

    :raises BagError: a message cannot be read.
    """
    return {goal_id: goal for _, goal_id, goal in _goal_states(run)}


def recorded_tasks(run: Run) -> tuple[list[TaskRun], dict[int, int]]:
    """Returns the tasks in a bag and its goals as tasks, ordered by start; and the index of the goal of each task that
    runs a step, by the index of that task.

    :raises BagError: the bag has no progress of tasks, or a message cannot be read.
    """
    if PROGRESS not in run.topics.values():
        return run.tasks(), {}
    runs = new_runs()
    goals, waiting = GoalRuns(runs), deque(_goal_states(run))

    def follow_goals(until: float) -> None:
        while waiting and waiting[0][0] <= until:
            time, goal_id, goal = waiting.popleft()
            goals.update(goal_id, goal["title"], goal, time)

    for message in run.messages(PROGRESS):
        follow_goals(message.time)
        recorded = add_progress(runs, message)
        if recorded is not None:
            goals.step_recorded(recorded.run, message.time)
    follow_goals(float("inf"))
    tasks = list(runs)
    indices = {task: index for index, task in enumerate(tasks)}
    of_steps = ((index, goals.goal_of(task)) for task, index in indices.items())
    return tasks, {index: indices[goal] for index, goal in of_steps if goal in indices}


def _goal_states(run: Run) -> list[tuple[float, str, dict[str, Any]]]:
    """Returns time, id and data of the goals after each of their messages, oldest first."""
    name = _names(run)
    return sorted(
        ((time, goal.call.goal_id, data) for goal in run.goals() for time, data in _states(goal, name)),
        key=lambda state: state[0],
    )


def _states(goal: Goal, name: Callable[[str], str]) -> Iterator[tuple[float, dict[str, Any]]]:
    if goal.call.type != ACHIEVE:
        return
    data = {**new_goal(goal.goals, goal.time), "title": goal_sentence(" ".join(goal.goals.split()), name) or "goal"}
    yield goal.time, data
    for message in (*goal.call.feedback, *filter(None, [goal.call.result])):
        data = goal_after(data, message.content, message.time)
        yield message.time, data


def _names(run: Run) -> Callable[[str], str]:
    """Returns the function that names an element for people, by its last label in the bag."""
    labels: dict[str, str] = {}
    for timed in run.changes() if MONITOR in run.topics.values() else ():
        labels.update((element.id, element.label) for element in timed.change.elements)
    return lambda eid: label_text(labels.get(eid) or local_name(eid))
