"""The results of agents' tools. They only describe: the JSON schemas by which clients check and read them."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import BaseModel, Field, TypeAdapter

from skiros2_gateway.http.models import ElementData, JobEvent, Plan, Table


class Skill(BaseModel):
    """A skill of a robot; `parameters` is a JSON schema."""

    robot: str
    type: str
    label: str
    parameters: dict[str, Any]


class Master(BaseModel):
    """A named goal; `parameters` is a JSON schema."""

    id: str
    description: str
    parameters: dict[str, Any]


class Skills(BaseModel):
    """Skills of the robots, and named goals."""

    skills: list[Skill]
    work_masters: list[Master]


class Elements(BaseModel):
    """Elements of the world model."""

    elements: list[ElementData]


class Start(BaseModel):
    """What the start of a skill would do now."""

    ok: bool
    implementation: str
    elements: dict[str, str] = Field(description="elements that were found for parameters")
    values: dict[str, Any] = Field(description="of all parameters; elements by their ids")
    changes: list[str] = Field(description="what is expected to change, a line each")
    why: dict[str, Any] | None = Field(description="why it would not start")


class Preview(BaseModel):
    """What a plan would change."""

    state: str
    message: str
    preview: Any


class Job(BaseModel):
    """A job."""

    job: str
    goal: str
    state: str
    substate: str
    outcome: str
    message: str
    author: str


class ExplainedJob(Job):
    """How a job has ended."""

    notes: list[str]
    steps: list[dict[str, Any]]
    explanations: list[dict[str, Any]]


class Task(BaseModel):
    """A task of a robot that was started."""

    robot: str
    task: int


class ExplainedTask(BaseModel):
    """How a task has ended."""

    skill: str
    parameters: dict[str, Any]
    state: Literal["running", "succeeded", "failed"]
    message: str
    explanations: list[dict[str, Any]]


class Stopped(BaseModel):
    """The number of stopped tasks by robot."""

    tasks: dict[str, int]


class Proposed(BaseModel):
    """The changes that were applied, a line each; what was started again, or why nothing was."""

    changes: list[str]
    retried: Job | Task | None
    why: str


class Jobs(BaseModel):
    """The newest jobs."""

    jobs: list[Job]


class JobHistory(Job):
    """The changes of a job's state, and of the world model by it."""

    history: list[JobEvent]
    changes: list[dict[str, Any]]


_RESULTS: dict[str, Any] = {
    "list_skills": Skills, "query_world": Elements | Table, "check_start": Start, "plan": Plan,
    "preview": Preview | Start, "execute": Job | Task, "stop": Stopped | Job, "explain": ExplainedJob | ExplainedTask,
    "propose": Proposed, "history": Jobs | JobHistory,
}  # fmt: skip


def output_schema(tool: str) -> dict[str, Any]:
    """Returns the JSON schema of a tool's result, which the protocol wants to be an object."""
    return {"type": "object", **TypeAdapter(_RESULTS[tool]).json_schema(mode="serialization")}
