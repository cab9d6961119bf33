"""The failure hook: a program proposes what a failed job or task lacks, and a person approves it.

A program learns of failed jobs by the events `response`, which have the explanations.
"""

from __future__ import annotations

from itertools import count
from typing import Any

from skiros2_common.core.errors import Refused, SkirosError, UnknownName
from skiros2_gateway.agents.arguments import Propose
from skiros2_gateway.agents.start_checks import approved_by, start_approved, valid_plan, valid_start
from skiros2_gateway.core.access import Caller
from skiros2_gateway.core.approvals import Request
from skiros2_gateway.core.cell import REACHED
from skiros2_gateway.core.edits import EditPreview, Edits
from skiros2_gateway.core.job import FINAL, Job, Order, read_order
from skiros2_gateway.core.keys import uninterrupted
from skiros2_gateway.core.problems import Problem, Rejected
from skiros2_gateway.core.service import Service


class Proposals:
    """Checks proposals, has them approved, and applies them. To be used in the thread of the gateway's loop."""

    def __init__(self, service: Service) -> None:
        self._control = service.control
        self._service = service

    async def propose(self, caller: Caller, wanted: Propose) -> dict[str, Any]:
        """Applies a proposal once it is approved, as a whole, and retries the job or skill if that is wanted.

        A retry after edits depends on them, so the retry is a request of its own, with its plan or start check.

        :returns: `changes` of the world model, a line each; `retried`: the new job or task, or None; `why`: the reason
            why it was not started.
        :raises Rejected: with all problems of the proposal; nothing has changed.
        :raises Refused: the run has not failed, or the proposal is not approved; nothing has changed.
        """
        failure = await self.failed_run(wanted)
        edits = Edits(wanted.properties, wanted.relations)
        problems: list[Problem] = []
        preview, retry = EditPreview(), None
        asked: Request | None = None
        try:
            if edits:
                preview = await self._control.cell.preview_edits(edits)
        except Rejected as error:
            problems += error.problems
        try:
            if wanted.retry:
                retry = await self._checked_retry(wanted, failure)
                if not edits:
                    asked = await self._start_request(retry, wanted.reason)
        except Rejected as error:
            problems += error.problems
        except SkirosError as error:
            problems.append(Problem(error.code, "parameters", str(error)))
        if problems:
            raise Rejected(problems)
        retried = retry.model_dump(mode="json") if isinstance(retry, Order) else retry
        runs = {
            "properties": [edit.model_dump(mode="json") for edit in wanted.properties],
            "relations": [edit.model_dump(mode="json") for edit in wanted.relations],
            "changes": list(preview.lines), "retry": retried, **(asked.runs if asked is not None else {}),
        }  # fmt: skip
        shown = {"failure": failure, **(asked.shown if asked is not None else {})}
        robots = asked.robots if asked is not None else ()
        by = await self._service.approval(caller, Request(runs, shown, robots, wanted.reason), by_person=True)
        if edits:
            await uninterrupted(self._control.cell.apply_edits(edits, preview))
        result: dict[str, Any] = {"changes": list(preview.lines), "retried": None, "why": ""}
        try:
            if retry is not None and asked is None:
                asked = await self._start_request(retry, f"again, after the approved changes: {wanted.reason}")
                by = await self._service.approval(caller, asked)
            if asked is not None:
                result["retried"] = await uninterrupted(self._start(caller, retry, asked, by))
        except SkirosError as error:  # the world model has changed; the caller has to know that
            result["why"] = str(error)
        return result

    async def _start_request(self, retry: Order | dict[str, Any], reason: str) -> Request:
        """
        :raises SkirosError: there is no plan, or the skill would not start.
        """
        if isinstance(retry, Order):
            return await valid_plan(self._control, retry, reason)
        return await valid_start(self._control, **retry, reason=reason)

    async def failed_run(self, wanted: Propose) -> dict[str, Any]:
        """Returns the failed job or task as JSON data.

        :raises UnknownName: there is none.
        :raises Refused: it has not failed.
        """
        if wanted.job:
            job = self._control.get(wanted.job)
            if job.state not in FINAL or job.response.outcome in REACHED:
                raise Refused(f"job {job.id} has not failed: it is {job.state} {job.response.outcome}".strip())
            return {**job_summary(job), "explanations": job.response.explanations}
        run = await self._control.cell.skill_run(wanted.robot, wanted.task)
        if run["state"] != "failed":
            raise Refused(f"task {wanted.task} of {wanted.robot} has not failed: it is {run['state']}")
        return {"robot": wanted.robot, "task": wanted.task, **run}

    async def _checked_retry(self, wanted: Propose, failure: dict[str, Any]) -> Order | dict[str, Any]:
        """Returns the order of the new job, or the skill with its values.

        A skill may still lack what the proposal adds, so only its names and values are checked.

        :raises SkirosError: with the problems of the values.
        """
        if not wanted.job:
            values = {**failure["parameters"], **wanted.parameters}
            await self._control.cell.check_start(wanted.robot, failure["skill"], values)
            return {"robot": wanted.robot, "skill": failure["skill"], "parameters": values}
        job = self._control.get(wanted.job)
        data = job.order.model_dump(mode="json")
        values = {**job.order.parameters, **wanted.parameters}
        order = read_order({**data, "id": self._free_id(job.id), "parameters": values})
        await self._control.check(order)
        return order

    def _free_id(self, job_id: str) -> str:
        """Returns the first unknown id of ID.2, ID.3, ..."""
        for number in count(2):
            try:
                self._control.get(f"{job_id}.{number}")
            except UnknownName:
                break
        return f"{job_id}.{number}"

    async def _start(self, caller: Caller, retry: Any, asked: Request, by: str) -> dict[str, Any]:
        """
        :raises SkirosError: it cannot start as it was approved.
        """
        if isinstance(retry, Order):
            comment = f"proposed by {caller.user}, approved by {by}"
            approved = approved_by(by, asked)
            job, _ = await self._control.put(retry, caller.user, comment, start=True, approved=approved)
            return job_summary(job)
        return {"robot": retry["robot"], "task": await start_approved(self._control, asked)}


def job_summary(job: Job) -> dict[str, Any]:
    """Returns what an agent needs to know of a job, as JSON data."""
    response = job.response
    return {
        "job": job.id,
        "goal": job.goal,
        "state": job.state.value,
        "substate": job.substate.value,
        "outcome": response.outcome,
        "message": response.message,
        "author": job.author,
    }
