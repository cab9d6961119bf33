"""Whether a bag has all of its run from the start, so that what is read from it can be relied on."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from skiros2_bags.core.contract_types import MONITOR, PROGRESS
from skiros2_bags.core.errors import BagError
from skiros2_bags.core.run import Run


@dataclass(frozen=True)
class Finding:
    """Something that was looked at.

    :param holds: whether it is as it should be.
    :param text: what was found, in words.
    """

    holds: bool
    text: str


def check(run: Run) -> list[Finding]:
    """What is looked at: the file, the chain of the world model's changes, the tasks, the goals of actions."""
    findings = [Finding(False, run.damage) if run.damage else Finding(True, "the file is whole")]
    for look in (_check_world, _check_tasks, _check_actions):
        try:
            findings += look(run)
        except BagError as error:
            findings.append(Finding(False, str(error)))
    return findings


def _check_world(run: Run) -> Iterator[Finding]:
    if MONITOR not in run.topics.values():
        yield Finding(False, "no change of a world model was recorded")
        return
    changes = run.changes()
    gaps = [timed for timed in changes if timed.gap]
    yield from (Finding(False, f"at {_at(run, timed.time)} {timed.gap}") for timed in gaps)
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
    late = [task for task in tasks if not task.is_whole]
    for task in late:
        yield Finding(False, f"{task.robot}, task {task.id}: it was running before {_at(run, task.start)}")
    if not late:
        running = [f"task {task.id} of {task.robot}" for task in tasks if not task.has_ended]
        ended = f"; not ended: {', '.join(running)}" if running else ""
        yield Finding(True, f"{len(tasks)} tasks are there from their start{ended}")


def _check_actions(run: Run) -> Iterator[Finding]:
    calls = run.actions()
    bad = 0
    for call in calls:
        if call.goal is None:
            bad += 1
            yield Finding(False, f"{call.name}: the goal {call.goal_id!r} was sent before it was listened to")
        elif call.status is None:
            bad += 1
            yield Finding(False, f"{call.name}: nothing was heard of the goal sent at {_at(run, call.goal.time)}")
    if not bad:
        yield Finding(True, f"{len(calls)} goals of actions are there, each with an answer")


def _at(run: Run, time: float) -> str:
    return f"{time - run.start:.3f} s"
