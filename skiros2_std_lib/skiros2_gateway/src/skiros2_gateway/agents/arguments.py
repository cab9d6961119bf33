"""The arguments of the tools of agents, which are also their JSON Schemas."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field

from skiros2_gateway.core.edits import PropertyEdit, RelationEdit
from skiros2_gateway.core.job import Order, read_order
from skiros2_gateway.core.problems import Problem

#: The type in JSON Schema by the name of a parameter's type; elements are texts.
_JSON_TYPES = {
    "str": "string", "int": "integer", "float": "number", "bool": "boolean", "list": "array", "dict": "object",
}  # fmt: skip


#: A field of what moves robots.
KEY: Any = Field("", description="idempotency key, chosen by the client: a call that is repeated with it is done once")


def _readable(text: str) -> str:
    """
    :raises ValueError: characters may be invisible, or change the order of others.
    """
    if not all(character.isprintable() or character == "\n" for character in text):
        raise ValueError("expected printable characters: a person reads them")
    return text


Reason = Annotated[str, AfterValidator(_readable)]


class Arguments(BaseModel):
    """Arguments of a tool."""

    model_config = ConfigDict(extra="forbid")

    def problems(self) -> list[Problem]:
        """Returns what is wrong with the arguments together."""
        return []


class ListSkills(Arguments):
    """Which skills are listed."""

    robot: str = Field("", description="node name of a robot; empty: all robots")


class QueryWorld(Arguments):
    """A query of the world model: one of the three."""

    sparql: str = Field("", max_length=20_000, description="a SPARQL SELECT query; nothing else is read then")
    id: str = Field("", description="the id of an element")
    type: str = Field("", description="the class of the elements, for example skiros:Product")


class CheckStart(Arguments):
    """A skill with values, as it would be started."""

    robot: str = Field(description="node name of a robot")
    skill: str = Field(description="type of a skill, or label of an implementation")
    parameters: dict[str, Any] = Field({}, description="values by key; elements by id or label")


class GoalArguments(Arguments):
    """A goal, or a work master with values."""

    goal: str = Field("", max_length=20_000, description='goal text: (skiros:contain "Tray-1" "Product-2")')
    work_master: str = Field("", description="or the id of a work master: a named goal")
    parameters: dict[str, Any] = Field({}, description="values of the parameters; elements by id")
    quality: Literal["", "first", "best", "optimal"] = ""

    def order(self, job_id: str, **more: Any) -> Order:
        """Returns the order of a job.

        :raises Rejected: with all problems of its fields.
        """
        fields = self.model_dump(include={"goal", "work_master", "parameters", "quality"})
        return read_order({"id": job_id, **fields, **more})


class ActionArguments(GoalArguments):
    """A goal, a work master with values, or a skill with values."""

    robot: str = Field("", description="node name of the robot that runs the skill")
    skill: str = Field("", description="or the type of a skill, or the label of an implementation")

    def problems(self) -> list[Problem]:
        if not self.skill:
            text = "a robot belongs to a skill"
            return [Problem("wrong_value", "robot", text, "robots, for a job")] if self.robot else []
        of_jobs = ("goal", "work_master", "quality", "id", "priority", "robots")
        given = [name for name in of_jobs if getattr(self, name, None)]
        problems = [Problem("wrong_value", name, f"{name} belongs to a job, not to a skill") for name in given]
        if not self.robot:
            problems.append(Problem("missing", "robot", "the skill has no robot", "a node name"))
        return problems


class Execute(ActionArguments):
    """A goal or work master to be carried out as a job, or a skill to be run."""

    id: str = Field("", description="id of the job; the same id and content again is the same job")
    reason: Reason = Field("", max_length=2000, description="why, for the person who approves it")
    key: str = KEY
    priority: int = 0
    robots: tuple[str, ...] = Field((), description="node names of the robots that the job may use; empty: all")


class Stop(Arguments):
    """The target of a stop: a job, a task of a robot, or all tasks of robots."""

    job: str = Field("", description="id of a job")
    robots: list[str] = Field([], description="node names; empty, without a job: all robots")
    task: int = Field(-1, description="with one robot: only this task")
    key: str = KEY

    def problems(self) -> list[Problem]:
        if self.job and (self.robots or self.task >= 0):
            return [Problem("wrong_value", "job", "a job and robots", "one of them")]
        if self.task >= 0 and len(self.robots) != 1:
            return [Problem("wrong_value", "robots", f"{len(self.robots)} robots of task {self.task}", "one")]
        return []


class RunArguments(Arguments):
    """A job, or a task that `execute` has started."""

    job: str = Field("", description="id of a job")
    robot: str = Field("", description="or the node name of a robot")
    task: int = Field(-1, description="and the number of its task")

    def problems(self) -> list[Problem]:
        if bool(self.job) == bool(self.robot) or (bool(self.robot) != (self.task >= 0)):
            return [Problem("wrong_value", "job", "the job or task is not clear", "a job, or a robot and a task")]
        return []


class Propose(RunArguments):
    """The missing facts of the world model, or values of parameters, of a failed job or task."""

    reason: Reason = Field(min_length=1, max_length=2000, description="for the person who approves it")
    properties: tuple[PropertyEdit, ...] = Field((), max_length=100)
    relations: tuple[RelationEdit, ...] = Field((), max_length=100)
    parameters: dict[str, Any] = Field({}, description="values that replace those of the failed run; needs retry")
    key: str = KEY
    retry: bool = Field(False, description="whether the job, under a new id, or the skill is started again afterwards")

    def problems(self) -> list[Problem]:
        problems = super().problems()
        if self.parameters and not self.retry:
            problems.append(Problem("wrong_value", "parameters", "values change nothing without retry", "retry: true"))
        if not (self.properties or self.relations or self.parameters):
            expected = "properties, relations or parameters"
            problems.append(Problem("missing", "properties", "the proposal changes nothing", expected))
        return problems


class History(Arguments):
    """Which jobs are listed."""

    job: str = Field("", description="id of a job; empty: the newest jobs")
    limit: int = Field(20, ge=1, le=1000)


def schema_of(parameters: list[dict[str, Any]]) -> dict[str, Any]:
    """Returns the JSON Schema of a skill's parameters.

    :param parameters: each as of `skiros2_skill.client.description.Parameter.as_json`.
    """
    properties: dict[str, Any] = {}
    for p in parameters:
        kind = _JSON_TYPES.get(p["type"], "string")
        texts = [p.get("description", ""), f"in {p['unit']}" if p.get("unit") else ""]
        texts.append("" if p["type"] in _JSON_TYPES else f"id or label of an element of class {p['type']}")
        limits = {key: p[key] for key in ("minimum", "maximum") if key in p}
        choices = {"enum": p["choices"]} if p.get("choices") else {}
        properties[p["key"]] = {"type": kind, "description": "; ".join(filter(None, texts)), **limits, **choices}
    required = [p["key"] for p in parameters if p["kind"] == "required" and not p.get("default")]
    return {"type": "object", "properties": properties, "required": required, "additionalProperties": False}
