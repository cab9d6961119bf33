"""The jobs that have not ended, in memory as in the store."""

from __future__ import annotations

import asyncio
import json
import logging
from bisect import bisect_left, insort
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import chain, islice
from typing import Any

from skiros2_gateway.core.events import EventStream
from skiros2_gateway.core.job import BEFORE, FINAL, Job, Rank, State
from skiros2_gateway.core.json_text import json_text
from skiros2_gateway.core.problems import StoreFailed
from skiros2_gateway.core.store import JobStore

log = logging.getLogger(__name__)

#: The longest delay of writing the progress of jobs (s).
_PROGRESS_PERIOD = 1.0


@dataclass(frozen=True)
class _Unwritten:
    """A change that the store has not taken."""

    job: Job
    author: str
    method: str
    comment: str


class OpenJobs:
    """Reads jobs, and writes changed ones. To be used in the thread of the gateway's loop.

    A job is changed as a copy: it replaces the job in memory once it is written. So a change that the store refuses (a
    full disk) leaves nothing half-done. What has happened in the cell cannot be refused: it is kept, and written later.
    """

    def __init__(self, store: JobStore, events: EventStream) -> None:
        self._store = store
        self._events = events
        self._jobs: dict[str, Job] = {}
        self._texts: dict[str, str] = {}  # JSON by id, of jobs that have not changed since it was made
        self._queue: list[tuple[Rank, str]] = []  # those that may start, in the order of starting
        self._stored: list[tuple[Rank, str]] = []  # those that are not allowed to start, in the same order
        self._timed: dict[str, float] = {}  # the earliest start of those of the queue that have one
        self._in_cell: set[str] = set()
        for text in store.open_jobs():
            self._add(job := Job.from_dict(json.loads(text)))
            self._texts[job.id] = text
        self._unwritten: list[_Unwritten] = []
        self._progressed: dict[str, Job] = {}  # by id, what is not written yet
        self._timer: asyncio.TimerHandle | None = None

    def __iter__(self) -> Iterator[Job]:
        """The jobs as they are, to be read only."""
        return iter(list(self._jobs.values()))

    def __len__(self) -> int:
        return len(self._jobs)

    @property
    def in_cell(self) -> int:
        """The number of jobs whose goal was sent to the cell and has not ended."""
        return len(self._in_cell)

    @property
    def queue(self) -> Iterator[Job]:
        """The jobs that may start, in the order of starting, whatever their earliest start."""
        return (self._jobs[job_id] for _, job_id in list(self._queue))

    @property
    def has_queue(self) -> bool:
        """Whether a job may start."""
        return bool(self._queue)

    def ordered(self, limit: int | None = None) -> list[Job]:
        """Returns the first jobs that have not ended, in the order of starting; those that run come first."""
        running = sorted((self._jobs[job_id] for job_id in self._in_cell), key=lambda job: job.rank)
        waiting = (self._jobs[job_id] for _, job_id in chain(self._queue, self._stored))
        return list(islice(chain(running, waiting), limit))

    def next_start(self, now: float) -> float | None:
        """Returns the next earliest start in the queue after a time; None: there is none."""
        return min((start for start in self._timed.values() if start > now), default=None)

    def texts(self, limit: int | None = None) -> list[str]:
        """Returns the jobs of `ordered` as JSON; see `Job.to_dict`."""
        return [self._text(job.id) for job in self.ordered(limit)]

    def text(self, job: Job) -> str:
        """Returns a job as JSON, one that has not ended as it is now."""
        return self._text(job.id) if job.id in self._jobs else json_text(job.to_dict())

    def _text(self, job_id: str) -> str:
        if job_id not in self._texts:
            self._texts[job_id] = json_text(self._jobs[job_id].to_dict())
        return self._texts[job_id]

    def ids(self) -> list[str]:
        return list(self._jobs)

    def open(self, job_id: str) -> Job | None:
        """Returns a job that has not ended, to be changed and saved."""
        job = self._jobs.get(job_id)
        return job.copy() if job is not None else None

    def find(self, job_id: str) -> Job | None:
        """Returns a job, also one that has ended or was cleared, to be changed and saved."""
        return self.open(job_id) or self._store.get(job_id)

    def save(self, job: Job, author: str, method: str, comment: str = "") -> None:
        """Writes a job that the gateway or a client wants to change.

        :raises StoreFailed: the job is unchanged, in memory and in the store.
        """
        self.write_unwritten()
        data = job.to_dict()
        text = self._store.save(job, author, method, comment, data)
        self._set(job, data)
        if job.id in self._jobs:
            self._texts[job.id] = text

    def update(self, job: Job) -> None:
        """Notes the progress of a job, which is written within `_PROGRESS_PERIOD`."""
        self._set(job)
        self._progressed[job.id] = job
        if self._timer is None:
            self._timer = asyncio.get_running_loop().call_later(_PROGRESS_PERIOD, self._write_progress)

    def close(self) -> None:
        """Writes the progress of jobs."""
        if self._timer is not None:
            self._timer.cancel()
            self._write_progress()

    def _write_progress(self) -> None:
        self._timer = None
        try:
            self._store.save_progress(list(self._progressed.values()))
            self._progressed.clear()
        except StoreFailed as error:
            log.error("the progress of jobs is written with the next one: %s", error)

    def note(self, job: Job, author: str, method: str, comment: str = "") -> bool:
        """Notes a job that the cell has changed. Returns whether it is written."""
        self._set(job)
        self._unwritten.append(_Unwritten(job.copy(), author, method, comment))
        try:
            self.write_unwritten()
        except StoreFailed as error:
            log.error("job %s: %s is not written yet: %s", job.id, method, error)
        return not self._unwritten

    def write_unwritten(self) -> None:
        """Writes what the store has not taken before.

        :raises StoreFailed: it still refuses.
        """
        while self._unwritten:
            first = self._unwritten[0]
            self._store.save(first.job, first.author, first.method, first.comment)
            del self._unwritten[0]

    def _set(self, job: Job, data: dict[str, Any] | None = None) -> None:
        self._progressed.pop(job.id, None)  # is written with the rest of the job
        self._remove(job.id)
        if job.state not in FINAL or not job.response.collected:
            self._add(job)
        self._events.publish("job", data or job.to_dict())

    def _add(self, job: Job) -> None:
        self._jobs[job.id] = job
        if job.is_in_cell:
            self._in_cell.add(job.id)
        elif job.state is State.ALLOWED_TO_START:
            insort(self._queue, (job.rank, job.id))
            if job.earliest:
                self._timed[job.id] = job.earliest
        elif job.state is State.NOT_ALLOWED_TO_START:
            insort(self._stored, (job.rank, job.id))

    def _remove(self, job_id: str) -> None:
        self._texts.pop(job_id, None)
        self._timed.pop(job_id, None)
        self._in_cell.discard(job_id)
        job = self._jobs.pop(job_id, None)
        if job is not None and job.state in BEFORE and not job.is_in_cell:
            waiting = self._queue if job.state is State.ALLOWED_TO_START else self._stored
            del waiting[bisect_left(waiting, (job.rank, job_id))]
