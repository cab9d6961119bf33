"""The tools of agents: the arguments of each, and its use of the gateway's model."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from typing import Any

from pydantic import ValidationError

from skiros2_common.core.errors import UnknownName
from skiros2_common.core.names import nearest
from skiros2_gateway.agents.arguments import (
    ActionArguments,
    Arguments,
    CheckStart,
    Execute,
    GoalArguments,
    History,
    ListSkills,
    Propose,
    QueryWorld,
    RunArguments,
    Stop,
    schema_of,
)
from skiros2_gateway.agents.proposals import Proposals, job_summary
from skiros2_gateway.agents.start_checks import approved_by, start_approved, valid_plan, valid_start
from skiros2_gateway.core.access import Caller
from skiros2_gateway.core.job import Method
from skiros2_gateway.core.keys import Keep, uninterrupted
from skiros2_gateway.core.problems import Rejected, problems_of
from skiros2_gateway.core.service import Service


@dataclass(frozen=True)
class Tool:
    """A tool.

    :param moves: whether it changes what robots do.
    """

    name: str
    description: str
    arguments: type[Arguments]
    call: Callable[[Caller, Any], Awaitable[Any]]
    moves: bool = False


class Tools:
    """The tools by name. To be used in the thread of the gateway's loop."""

    def __init__(self, service: Service) -> None:
        self._service = service
        self._proposals = Proposals(service)
        made = (
            Tool("list_skills", "The skills of the robots, and schemas of parameters.", ListSkills, self._skills),
            Tool("query_world", "Elements of the world model, or a SPARQL query. Read only.", QueryWorld, self._world),
            Tool("check_start", "Whether a skill would start, or why not. Nothing moves.", CheckStart, self._check),
            Tool("plan", "The plan for a goal, or why there is none. Nothing moves.", GoalArguments, self._plan),
            Tool(
                "preview", "What a plan or the start of a skill would change. Nothing moves.", ActionArguments,
                self._preview,
            ),
            Tool(
                "execute", "Starts a job whose goal has a plan, or a skill, if a person approves it.", Execute,
                self._execute, True,
            ),
            Tool("stop", "Stops a job, a task or robots. Needs no approval.", Stop, self._stop, True),
            Tool("explain", "How a job or task ended, and why it failed.", RunArguments, self._explain),
            Tool(
                "propose", "Facts or values that a failed job or task lacks; applied if a person approves it.", Propose,
                self._propose, True,
            ),
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
        if problems := read.problems():
            raise Rejected(problems)
        if not tool.moves:
            self._service.view(caller)
        key = getattr(read, "key", "")
        command = [name, read.model_dump(mode="json")]
        return await self._service.once(caller, key, command, lambda: tool.call(caller, read))

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

    async def _world(self, caller: Caller, arguments: QueryWorld) -> Any:
        cell = self._service.control.cell
        if arguments.sparql:
            return await cell.query(arguments.sparql, caller.user)
        elements = (await cell.world())["elements"]
        if arguments.id and arguments.id not in (known := [element["id"] for element in elements]):
            raise UnknownName(f"there is no element {arguments.id!r}; near: {', '.join(nearest(arguments.id, known))}")
        found = [e for e in elements if arguments.id in ("", e["id"]) and arguments.type in ("", e["type"])]
        return {"elements": found}

    async def _check(self, _: Caller, arguments: CheckStart | ActionArguments) -> Any:
        return await self._service.control.cell.check_start(arguments.robot, arguments.skill, arguments.parameters)

    async def _plan(self, caller: Caller, arguments: GoalArguments) -> Any:
        return {key: value for key, value in (await self._planned(caller, arguments)).items() if key != "preview"}

    async def _preview(self, caller: Caller, arguments: ActionArguments) -> Any:
        if arguments.skill:
            return await self._check(caller, arguments)
        plan = await self._planned(caller, arguments)
        return {key: plan[key] for key in ("state", "message", "preview")}

    async def _planned(self, caller: Caller, arguments: GoalArguments) -> dict[str, Any]:
        with self._service.planning(caller):
            goal = await self._service.control.check(arguments.order("plan"))
            return await self._service.control.cell.plan(goal, arguments.quality)

    async def _explain(self, _: Caller, arguments: RunArguments) -> Any:
        if not arguments.job:
            return await self._service.control.cell.skill_run(arguments.robot, arguments.task)
        job = self._service.control.get(arguments.job)
        response = job.response
        more = {"notes": response.notes, "steps": response.steps, "explanations": response.explanations}
        return {**job_summary(job), **more}

    async def _history(self, _: Caller, arguments: History) -> Any:
        if not arguments.job:
            return {"jobs": [job_summary(job) for job in self._service.store.jobs(limit=arguments.limit)]}
        job = self._service.control.get(arguments.job)
        entries = self._service.store.history(job.id)[-arguments.limit :]
        return {**job_summary(job), "history": entries, "changes": job.response.changes}

    # -- moving ------------------------------------------------------------------------------------------------

    async def _execute(self, caller: Caller, arguments: Execute) -> Any:
        if arguments.skill:
            return await self._run_skill(caller, arguments)
        control = self._service.control
        order = arguments.order(arguments.id, priority=arguments.priority, robots=arguments.robots)

        async def execute() -> Any:
            known = control.find(order)
            if known is None:
                asked = await valid_plan(control, order, arguments.reason)
                by = await self._service.approval(caller, asked)
                put = control.put(order, caller.user, f"approved by {by}", start=True, approved=approved_by(by, asked))
                known, _ = await uninterrupted(put)
            return job_summary(known)

        async def command() -> Any:
            return await self._service.command(caller, "execute", order.id, execute)

        # a client that repeats a lost call shares the approval that waits, by the job's id
        return await self._service.once(caller, f"job {order.id}", order.digest, command, Keep.NOT)

    async def _run_skill(self, caller: Caller, arguments: Execute) -> Any:
        robot, skill, parameters = arguments.robot, arguments.skill, arguments.parameters

        async def execute() -> Any:
            control = self._service.control
            asked = await valid_start(control, robot, skill, parameters, arguments.reason)
            await self._service.approval(caller, asked)
            return {"robot": robot, "task": await uninterrupted(start_approved(control, asked))}

        return await self._service.command(caller, "execute", f"{robot} {skill}", execute)

    async def _stop(self, caller: Caller, arguments: Stop) -> Any:
        if arguments.job:
            return job_summary(await self._service.apply(caller, Method.ABORT, arguments.job))
        if arguments.task < 0:
            return {"tasks": await self._service.command_robots(caller, "stop", arguments.robots)}
        robot, task = arguments.robots[0], arguments.task

        async def stop() -> Any:
            await self._service.control.cell.stop_task(robot, task)
            return {"tasks": {robot: 1}}

        return await self._service.command(caller, "stop", f"{robot} task {task}", stop)

    async def _propose(self, caller: Caller, arguments: Propose) -> Any:
        thing = arguments.job or f"{arguments.robot} task {arguments.task}"
        return await self._service.command(caller, "propose", thing, lambda: self._proposals.propose(caller, arguments))
