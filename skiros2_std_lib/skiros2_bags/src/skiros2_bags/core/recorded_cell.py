"""The document of a recorded cell: the tasks in a bag, and its goals, whose trees have those of their steps."""

from __future__ import annotations

import heapq
from collections.abc import Callable, Iterator
from operator import attrgetter

from skiros2_bags.core.action_call import ACHIEVE
from skiros2_bags.core.bag_file import MONITOR, PROGRESS
from skiros2_bags.core.run import Run, new_runs, progress_of
from skiros2_common.core.names import local_name
from skiros2_common.core.wording import label_text
from skiros2_live.core.cell import CellDocument
from skiros2_live.core.patch import GoalProgress, TaskProgress

#: The most goals of a bag.
_MAX_GOALS = 1_000_000


def recorded_cell(run: Run) -> CellDocument:
    """Returns the tasks and goals in a bag as they were at its end. Goals have the last labels of their elements.

    :raises BagError: see `recorded_patches`.
    :raises WrongValue: a message of the task manager cannot be read.
    """
    cell = CellDocument(_names(run), new_runs(), max_goals=_MAX_GOALS)
    for patch in recorded_patches(run):
        cell.apply(patch)
    return cell


def recorded_patches(run: Run) -> Iterator[GoalProgress | TaskProgress]:
    """Returns the progress of goals and tasks in a bag, oldest first.

    :raises BagError: the bag has no progress of tasks, or a message cannot be read.
    """
    run.need(PROGRESS, "progress of tasks")
    progress: Iterator[GoalProgress | TaskProgress] = map(progress_of, run.messages(PROGRESS))
    return heapq.merge(_goal_messages(run), progress, key=attrgetter("stamp"))


def goal_indices(cell: CellDocument) -> dict[int, int]:
    """Returns the index of the goal of each task that runs a step, by the index of that task."""
    indices = {task: index for index, task in enumerate(cell.runs)}
    of_steps = ((index, cell.goal_runs.goal_of(task)) for task, index in indices.items())
    return {index: indices[goal] for index, goal in of_steps if goal in indices}


def _goal_messages(run: Run) -> list[GoalProgress]:
    """Returns the messages of the goals that were to be achieved, oldest first."""
    calls = (goal.call for goal in run.goals() if goal.call.type == ACHIEVE)
    messages = (
        GoalProgress(call.goal_id, message.content, message.time)
        for call in calls
        for message in filter(None, (call.goal, *call.feedback, call.result))
    )
    return sorted(messages, key=attrgetter("stamp"))


def _names(run: Run) -> Callable[[str], str]:
    """Returns the function that names an element for people, by its last label in the bag."""
    labels: dict[str, str] = {}
    for timed in run.changes() if MONITOR in run.topics.values() else ():
        labels.update((element.id, element.label) for element in timed.change.elements)
    return lambda eid: label_text(labels.get(eid) or local_name(eid))
