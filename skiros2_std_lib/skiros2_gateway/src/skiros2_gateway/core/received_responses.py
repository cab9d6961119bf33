"""Responses to jobs that other systems send, such as a measuring station: they are kept with the job."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import AwareDatetime, BaseModel, ConfigDict, Field, StringConstraints, ValidationError

from skiros2_common.core.errors import Refused
from skiros2_gateway.core.job import Job
from skiros2_gateway.core.job_control import JobControl
from skiros2_gateway.core.problems import Problem, Rejected, problems_of
from skiros2_gateway.core.resources import Name, Resource
from skiros2_gateway.core.values import Value

#: The responses that are kept with a job, and their size (bytes of JSON) at most.
_MAX_RESPONSES, _MAX_SIZE = 20, 65536

METHOD = "ReceiveJobResponse"


class Received(BaseModel):
    """A response as it is sent."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    id: Annotated[Name, StringConstraints(min_length=1)] = Field(description="a later one with this id replaces it")
    job: Name
    description: str = Field("", max_length=1000)
    started: AwareDatetime | None = None
    ended: AwareDatetime | None = None
    states: tuple[Name, ...] = Field((), max_length=10, description="the state in the sender's view, and sub-states")
    values: dict[str, Value] = Field({}, max_length=1000)
    equipment: tuple[Name, ...] = Field((), max_length=100)
    resources: tuple[Resource, ...] = Field((), max_length=100)


class Kept(Received):
    """A response as it is kept: with the user who has sent it, and when (s since the epoch)."""

    author: str
    time: float


def receive(control: JobControl, data: Any, author: str) -> Job:
    """Keeps the response in JSON data. The state of the job stays. Returns the job.

    :raises Rejected: with all problems of its fields.
    :raises UnknownName: there is no such job.
    :raises Refused: the job has too many responses.
    :raises StoreFailed: it is not kept.
    """
    try:
        found = Received.model_validate(data)
    except ValidationError as error:
        raise Rejected(problems_of(error)) from None
    if (size := len(found.model_dump_json())) > _MAX_SIZE:
        raise Rejected([Problem("wrong_value", "", f"{size} bytes", f"at most {_MAX_SIZE}")])
    job = control.get(found.job)
    others = [each for each in job.received if each["id"] != found.id]
    if len(others) >= _MAX_RESPONSES:
        raise Refused(f"job {job.id} has {_MAX_RESPONSES} responses of others already")
    job.changed = control.clock()
    kept = Kept(**dict(found), author=author, time=job.changed)
    job.received = [*others, kept.model_dump(mode="json")]
    control.jobs.save(job, author, METHOD, found.id)
    return job
