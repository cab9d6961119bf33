"""The conditions for the start of an agent's job or skill: a plan, or a start check without a refusal."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from skiros2_common.core.errors import Refused
from skiros2_common.core.explanation import Explanation
from skiros2_common.core.wording import visible
from skiros2_gateway.core.approvals import Request
from skiros2_gateway.core.job import Order
from skiros2_gateway.core.job_control import JobControl
from skiros2_task.core.actions import ROBOT_KEY
from skiros2_task.core.preview import Preview, change_sentences

#: The states of a plan that may be executed.
_VALID = ("planned", "nothing_to_do")


async def valid_plan(control: JobControl, order: Order, reason: str = "") -> Request:
    """Returns the request for an order: its goal and the plan, which is what will be executed.

    :raises Rejected: with all problems of the order.
    :raises Refused: there is no plan with the allowed robots.
    """
    goal = await control.check(order)
    plan = await control.cell.plan(goal, order.quality)
    if plan["state"] not in _VALID:
        raise Refused(f"there is no valid plan: {plan['state']}: {plan['message']}")
    robots = tuple(sorted({step["robot"] for step in plan["plan"]}))
    allowed = control.masters.robots_of(order)
    if others := [robot for robot in robots if allowed and robot not in allowed]:
        raise Refused(f"the plan uses {', '.join(others)}, allowed are {', '.join(allowed)}")
    runs = {"order": order.model_dump(mode="json"), "goal": goal, "plan": plan["plan"]}
    preview = Preview.from_dict(plan["preview"]) if plan["preview"] else Preview([], True)
    # with ids: a label may be misleading
    changes = [visible(text) for step in preview.steps for text in change_sentences(step.changes, str)]
    return Request(runs, {"changes": changes, "preview": plan["preview"]}, robots, reason)


def approved_by(user: str, request: Request) -> dict[str, Any]:
    """Returns what is approved of the request for an order; see `Job`."""
    return {"goal": request.runs["goal"], "plan": request.runs["plan"], "digest": request.digest, "by": user}


async def valid_start(
    control: JobControl, robot: str, skill: str, parameters: Mapping[str, Any], reason: str = ""
) -> Request:
    """Returns the request for a skill: implementation and values with which it will start, and the expected changes.

    :raises Refused: it would not start.
    """
    check = await control.cell.check_start(robot, skill, parameters)
    if not check["ok"]:
        raise Refused(f"{skill} would not start on {robot}: {Explanation.from_dict(check['why'])}")
    runs = {
        "robot": robot, "skill": skill, "parameters": dict(parameters), "implementation": check["implementation"],
        "elements": check["elements"], "values": check["values"],
        "changes": check["changes"],
    }  # fmt: skip
    return Request(runs, {"preview": check}, (robot,), reason)


async def start_approved(control: JobControl, request: Request) -> int:
    """Starts the skill of an approved request. Returns the number of its task.

    :raises Refused: it would start differently now, or not at all.
    """
    runs = request.runs
    now = await valid_start(control, runs["robot"], runs["skill"], runs["parameters"])
    if changes := list(_differences(runs, now.runs)):
        raise Refused(f"it would not run as approved: {'; '.join(changes)}")
    values = {key: value for key, value in runs["values"].items() if key != ROBOT_KEY}
    return await control.cell.run_skill(runs["robot"], runs["implementation"], runs["parameters"], values)


def _differences(approved: Mapping[str, Any], now: Mapping[str, Any]) -> Iterator[str]:
    if approved["implementation"] != now["implementation"]:
        yield f"the implementation is {now['implementation']}, approved is {approved['implementation']}"
    for key in sorted({*approved["values"], *now["values"]}):
        before, after = approved["values"].get(key, "none"), now["values"].get(key, "none")
        if before != after:
            yield f"{key} is {after}, approved is {before}"
    for line in now["changes"]:
        if line not in approved["changes"]:
            yield f"{line}: not approved"
    for line in approved["changes"]:
        if line not in now["changes"]:
            yield f"{line}: approved, not expected any more"
