"""Counts the tasks of jobs that have ended while the gateway did not run, by the steps of their goals."""

from __future__ import annotations

from collections.abc import Iterable

from skiros2_gateway.core.job import Job
from skiros2_live.core.cell import CellDocument, GoalChanged

#: Whether a step has succeeded, by its state, of those that have ended by themselves.
_ENDED = {"succeeded": True, "failed": False}


class MissedTasks:
    """Follows a document. To be used in its thread.

    A task that the document has seen is counted with its progress.

    :param jobs: those of the store when the gateway starts; their steps are those that it has known before.
    """

    def __init__(self, document: CellDocument, jobs: Iterable[Job]) -> None:
        self._document = document
        self._known = {
            job.id: {step["number"] for step in job.response.steps if step["state"] in _ENDED}
            for job in jobs
            if job.is_in_cell
        }
        document.subscribe(GoalChanged, self._on_goal)

    def _on_goal(self, change: GoalChanged) -> None:
        known = self._known.get(change.goal_id)
        if known is None or change.data is None:
            return
        seen = {(run.robot, run.task_id) for run in self._document.runs}
        for planned in change.data["plan"]:
            number, robot = planned["number"], planned["robot"]
            step = change.data["steps"].get(str(number), {})
            if step.get("state") in _ENDED and number not in known:
                known.add(number)
                if (robot, step.get("task")) not in seen:
                    self._document.count_task(robot, is_success=_ENDED[step["state"]])
