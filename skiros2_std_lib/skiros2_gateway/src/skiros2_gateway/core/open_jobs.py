"""The jobs that have not ended, in memory as in the store."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from dataclasses import dataclass

from skiros2_gateway.core.events import EventStream
from skiros2_gateway.core.job import FINAL, Job
from skiros2_gateway.core.problems import StoreFailed
from skiros2_gateway.core.store import JobStore

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class _Unwritten:
    """A change that the store has not taken."""

    job: Job
    author: str
    method: str
    comment: str
    is_event: bool


class OpenJobs:
    """Reads jobs, and writes changed ones. To be used in the thread of the gateway's loop.

    A job is changed as a copy: it replaces the job in memory once it is written. So a change that the store refuses (a
    full disk) leaves nothing half-done. What has happened in the cell cannot be refused: it is kept, and written later.
    """

    def __init__(self, store: JobStore, events: EventStream) -> None:
        self._store = store
        self._events = events
        self._jobs = {job.id: job for job in store.open_jobs()}
        self._unwritten: list[_Unwritten] = []

    def __iter__(self) -> Iterator[Job]:
        """The jobs as they are, to be read only."""
        return iter(list(self._jobs.values()))

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
        self._store.save(job, author, method, comment)
        self._set(job)

    def note(self, job: Job, author: str, method: str, comment: str = "", *, is_event: bool = True) -> bool:
        """Notes a job that the cell has changed. Returns whether it is written."""
        self._set(job)
        self._unwritten.append(_Unwritten(job.copy(), author, method, comment, is_event))
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
            self._store.save(first.job, first.author, first.method, first.comment, is_event=first.is_event)
            del self._unwritten[0]

    def _set(self, job: Job) -> None:
        if job.state in FINAL and job.response.collected:
            self._jobs.pop(job.id, None)
        else:
            self._jobs[job.id] = job
        self._events.publish("job", job.to_dict())
