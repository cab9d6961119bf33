"""What agents can do: the arguments of each tool, and what it does with the gateway's model."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from skiros2_common.core.errors import Refused, UnknownName
from skiros2_common.core.names import nearest
from skiros2_gateway.core.access import Caller
from skiros2_gateway.core.approvals import Approvals
from skiros2_gateway.core.job import Job, Method, Order, Value, read_order
from skiros2_gateway.core.problems import Problem, Rejected, problems_of
from skiros2_gateway.core.service import Service

#: The states of a plan that may be executed.
_VALID = ("planned", "nothing_to_do")
#: The type in JSON Schema by the name of a parameter's type; elements are texts.
_JSON_TYPES = {
    "str": "string", "int": "integer", "float": "number", "bool": "boolean", "list": "array", "dict": "object",
}  # fmt: skip


class _Arguments(BaseModel):
    model_config = ConfigDict(extra="forbid")


class ListSkills(_Arguments):
    """Which skills are listed."""

    robot: str = Field("", description="node name of a robot; empty: all robots")


class QueryWorld(_Arguments):
    """What is read of the world model: one of the three."""

    sparql: str = Field("", max_length=20_000, description="a SPARQL SELECT query; nothing else is read then")
    id: str = Field("", description="the id of an element")
    type: str = Field("", description="the class of the elements, for example skiros:Product")


class CheckStart(_Arguments):
    """A skill with values, as it would be started."""

    robot: str = Field(description="node name of a robot")
    skill: str = Field(description="type of a skill, or label of an implementation")
    parameters: dict[str, Any] = Field({}, description="values by key; elements by id or label")


class GoalArguments(_Arguments):
    """A goal, or a work master with values."""

    goal: str = Field("", max_length=20_000, description='goal text: (skiros:contain "Tray-1" "Product-2")')
    work_master: str = Field("", description="or the id of a work master: a named goal")
    parameters: dict[str, Value] = Field({}, description="values of the work master's parameters")
    quality: Literal["", "first", "best", "optimal"] = ""


class Execute(GoalArguments):
    """A goal to be carried out as a job."""

    id: str = Field(description="id of the job; the same id and content again is the same job")
    priority: int = 0
    robots: tuple[str, ...] = ()


class Stop(_Arguments):
    """What is stopped."""

    job: str = Field("", description="id of a job; empty: all tasks of the robots are stopped")
    robots: list[str] = Field([], description="node names; empty: all robots")


class JobArguments(_Arguments):
    """A job."""

    job: str = Field(description="id of a job")


class History(_Arguments):
    """Which jobs are listed."""

    job: str = Field("", description="id of a job; empty: the newest jobs")
    limit: int = Field(20, ge=1, le=1000)


@dataclass(frozen=True)
class Tool:
    """A tool.

    :param moves: whether it changes what robots do.
    """

    name: str
    description: str
    arguments: type[_Arguments]
    call: Callable[[Caller, Any], Awaitable[Any]]
    moves: bool = False


class Tools:
    """The tools by name. To be used in the thread of the gateway's loop."""

    def __init__(self, service: Service, approvals: Approvals) -> None:
        self._service = service
        self._approvals = approvals
        made = (
            Tool("list_skills", "The skills of the robots, and schemas of parameters.", ListSkills, self._skills),
            Tool("query_world", "Elements of the world model, or a SPARQL query. Read only.", QueryWorld, self._world),
            Tool("check_start", "Whether a skill would start, or why not. Nothing moves.", CheckStart, self._check),
            Tool("plan", "The plan for a goal, or why there is none. Nothing moves.", GoalArguments, self._plan),
            Tool("preview", "What a plan for a goal would change. Nothing moves.", GoalArguments, self._preview),
            Tool(
                "execute", "Starts a job if its goal has a plan and a person approves it.", Execute, self._execute, True
            ),
            Tool("stop", "Stops a job or robots. Needs no approval.", Stop, self._stop, True),
            Tool("explain", "Why a job failed: its outcome and the explanations.", JobArguments, self._explain),
            Tool("history", "The newest jobs, or the changes of one job's state.", History, self._history),
        )  # fmt: skip
        self.all: dict[str, Tool] = {tool.name: tool for tool in made}

    async def call(self, caller: Caller, name: str, arguments: dict[str, Any]) -> Any:
        """Calls a tool. Returns JSON data.

        :raises SkirosError: the caller lacks the role, or the tool refuses; `Rejected` has all problems of arguments.
        """
        if name not in self.all:
            raise UnknownName(f"there is no tool {name!r}; near: {', '.join(nearest(name, self.all) or self.all)}")
        tool = self.all[name]
        try:
            read = tool.arguments.model_validate(arguments)
        except ValidationError as error:
            raise Rejected(problems_of(error)) from None
        if not tool.moves:
            self._service.view(caller)
        return await tool.call(caller, read)

    # -- reading -----------------------------------------------------------------------------------------------

    async def _skills(self, _: Caller, arguments: ListSkills) -> Any:
        skills = await self._service.control.cell.skills()
        if arguments.robot and arguments.robot not in skills:
            raise UnknownName(f"no robot {arguments.robot} is connected; there are: {', '.join(skills) or 'none'}")
        wanted = [arguments.robot] if arguments.robot else list(skills)
        return {
            "skills": [
                {"robot": robot, "type": s["type"], "label": s["label"], "parameters": schema_of(s["parameters"])}
                for robot in wanted
                for s in skills[robot]
            ],
            "work_masters": [
                {"id": m.id, "description": m.description, "parameters": m.parameters_schema()}
                for m in self._service.control.masters.all.values()
            ],
        }

    async def _world(self, _: Caller, arguments: QueryWorld) -> Any:
        cell = self._service.control.cell
        if arguments.sparql:
            return await cell.query(arguments.sparql)
        elements = (await cell.world())["elements"]
        if arguments.id and arguments.id not in (known := [element["id"] for element in elements]):
            raise UnknownName(f"there is no element {arguments.id!r}; near: {', '.join(nearest(arguments.id, known))}")
        found = [e for e in elements if arguments.id in ("", e["id"]) and arguments.type in ("", e["type"])]
        return {"elements": found}

    async def _check(self, _: Caller, arguments: CheckStart) -> Any:
        return await self._service.control.cell.check_start(arguments.robot, arguments.skill, arguments.parameters)

    async def _plan(self, _: Caller, arguments: GoalArguments) -> Any:
        return {key: value for key, value in (await self._planned(arguments)).items() if key != "preview"}

    async def _preview(self, _: Caller, arguments: GoalArguments) -> Any:
        plan = await self._planned(arguments)
        return {key: plan[key] for key in ("state", "message", "preview")}

    async def _planned(self, arguments: GoalArguments) -> dict[str, Any]:
        order = _order("plan", arguments)
        return await self._service.control.cell.plan(await self._service.control.check(order), arguments.quality)

    async def _explain(self, _: Caller, arguments: JobArguments) -> Any:
        job = self._service.control.get(arguments.job)
        response = job.response
        return {**_brief(job), "notes": response.notes, "steps": response.steps, "explanations": response.explanations}

    async def _history(self, _: Caller, arguments: History) -> Any:
        if not arguments.job:
            return {"jobs": [_brief(job) for job in self._service.store.jobs(limit=arguments.limit)]}
        job = self._service.control.get(arguments.job)
        entries = self._service.store.history(job.id)[-arguments.limit :]
        return {**_brief(job), "history": entries, "changes": job.response.changes}

    # -- moving ------------------------------------------------------------------------------------------------

    async def _execute(self, caller: Caller, arguments: Execute) -> Any:
        order = _order(arguments.id, arguments, priority=arguments.priority, robots=arguments.robots)

        async def execute() -> Job:
            goal = await self._service.control.check(order)
            plan = await self._service.control.cell.plan(goal, arguments.quality)
            if plan["state"] not in _VALID:
                raise Refused(f"there is no valid plan: {plan['state']}: {plan['message']}")
            what = {"order": order.model_dump(mode="json"), "goal": goal, "plan": plan["plan"]}
            by = await self._approvals.request(caller, {**what, "preview": plan["preview"]})
            return (await self._service.control.put(order, caller.user, f"approved by {by}", start=True))[0]

        return _brief(await self._service.command(caller, "execute", order.id, execute))

    async def _stop(self, caller: Caller, arguments: Stop) -> Any:
        if not arguments.job:
            return {"tasks": await self._service.command_robots(caller, "stop", arguments.robots)}
        if arguments.robots:
            raise Rejected([Problem("wrong_value", "robots", "expected either a job or robots")])
        return _brief(self._service.apply(caller, Method.ABORT, arguments.job))


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


def _order(job_id: str, arguments: GoalArguments, **more: Any) -> Order:
    fields = arguments.model_dump(include={"goal", "work_master", "parameters", "quality"})
    return read_order({"id": job_id, **fields, **more})


def _brief(job: Job) -> dict[str, Any]:
    response = job.response
    state = {"job": job.id, "goal": job.goal, "state": job.state.value, "substate": job.substate.value}
    return {**state, "outcome": response.outcome, "message": response.message, "author": job.author}
