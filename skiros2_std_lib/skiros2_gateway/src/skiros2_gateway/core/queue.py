"""Moves jobs in the queue."""

from __future__ import annotations

from skiros2_common.core.errors import Refused
from skiros2_gateway.core.job import Rank
from skiros2_gateway.core.job_control import JobControl


def move(control: JobControl, job_id: str, before: str, author: str) -> None:
    """Moves a job of the queue before another one; "": to its end. Its priority stays; an update ends the move.

    :raises Refused: one of them is not in the queue, or the other one may interrupt others and the job may not.
    :raises UnknownName: there is no such job.
    :raises StoreFailed: nothing has changed.
    """
    job, names = control.get(job_id), [each.id for each in control.jobs.queue]
    for name in (job_id, before) if before else (job_id,):
        if control.get(name).id not in names:
            raise Refused(f"job {job_id} cannot be moved: {name} is not in the queue")
    queue = [each for each in control.jobs.queue if each.id != job_id]
    names.remove(job_id)
    place = names.index(before) if before and before != job_id else len(queue)
    following = queue[place] if place < len(queue) else None
    if following is not None and following.order.priority >= control.cell.interrupt_priority > job.order.priority:
        raise Refused(f"job {job_id} cannot be moved: {before} has a priority that interrupts others")
    job.place = _between(queue[place - 1].rank if place else None, following.rank if following is not None else None)
    control.jobs.save(job, author, "Move", f"before {before}" if before else "to the end")


def _between(before: Rank | None, after: Rank | None) -> Rank:
    """Returns a rank between two, of which one may be missing.

    A tuple that begins with another one is greater than that, and less than all that were: there is always room.
    """
    if before is None:
        return (after[0] - 0.5,) if after is not None else (0,)
    if after is not None and after[: len(before)] == before:
        return (*before, after[len(before)] - 1)
    return (*before, 0)
