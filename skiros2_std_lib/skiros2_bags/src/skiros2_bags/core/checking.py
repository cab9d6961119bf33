"""Checks that a bag contains its run completely, from the start."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from skiros2_bags.core.errors import BagError
from skiros2_bags.core.message import MONITOR, PROGRESS
from skiros2_bags.core.run import Run


@dataclass(frozen=True)
class Finding:
    """The result of one check.

    :param holds: whether the check passed.
    :param text: for people.
    """

    holds: bool
    text: str


def check(run: Run) -> list[Finding]:
    """Checks the file, the continuity of the world model's changes, the tasks and the goals of actions."""
    findings = [Finding(False, run.damage) if run.damage else Finding(True, "the file is whole")]
    for check_part in (_check_world, _check_tasks, _check_actions):
        try:
            findings += check_part(run)
        except BagError as error:
            findings.append(Finding(False, str(error)))
    return findings


def _check_world(run: Run) -> Iterator[Finding]:
    if MONITOR not in run.topics.values():
        yield Finding(False, "no change of a world model was recorded")
        return
    changes = run.changes()
    gaps = [timed for timed in changes if timed.gap]
    yield from (Finding(False, f"at {_time(run, timed.time)} {timed.gap}") for timed in gaps)
    if not gaps:
        elements = len(changes[0].change.elements) if changes else 0
        yield Finding(
            True, f"{len(changes)} changes follow one another without a gap, from a scene of {elements} elements"
        )


def _check_tasks(run: Run) -> Iterator[Finding]:
    if PROGRESS not in run.topics.values():
        yield Finding(True, "no task was run")
        return
    tasks = run.tasks()
    late = [task for task in tasks if not task.is_complete]
    for task in late:
        yield Finding(False, f"{task.robot}, task {task.task_id}: it was running before {_time(run, task.start)}")
    if not late:
        running = [f"task {task.task_id} of {task.robot}" for task in tasks if not task.latest.has_ended]
        ended = f"; not ended: {', '.join(running)}" if running else ""
        yield Finding(True, f"{len(tasks)} tasks are complete from their start{ended}")


def _check_actions(run: Run) -> Iterator[Finding]:
    calls = run.actions()
    bad = 0
    for call in calls:
        if call.goal is None:
            bad += 1
            yield Finding(False, f"{call.name}: the goal {call.goal_id!r} was sent before the recorder subscribed")
        elif call.status is None:
            bad += 1
            yield Finding(False, f"{call.name}: no answer to the goal sent at {_time(run, call.goal.time)}")
    if not bad:
        yield Finding(True, f"{len(calls)} goals of actions are complete, each with an answer")


def _time(run: Run, time: float) -> str:
    return f"{time - run.start:.3f} s"
