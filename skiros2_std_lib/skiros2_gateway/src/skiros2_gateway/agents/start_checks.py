"""What must hold before an agent's job or skill starts: a plan, or a start check without a refusal."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from skiros2_common.core.errors import Refused
from skiros2_common.core.explanation import Explanation
from skiros2_gateway.core.job import Order
from skiros2_gateway.core.job_control import JobControl

#: The states of a plan that may be executed.
_VALID = ("planned", "nothing_to_do")


async def valid_plan(control: JobControl, order: Order) -> dict[str, Any]:
    """Returns order, goal, plan and simulated changes as JSON data.

    :raises Rejected: with all problems of the order.
    :raises Refused: there is no plan.
    """
    goal = await control.check(order)
    plan = await control.cell.plan(goal, order.quality)
    if plan["state"] not in _VALID:
        raise Refused(f"there is no valid plan: {plan['state']}: {plan['message']}")
    return {"order": order.model_dump(mode="json"), "goal": goal, "plan": plan["plan"], "preview": plan["preview"]}


async def valid_start(control: JobControl, robot: str, skill: str, parameters: Mapping[str, Any]) -> dict[str, Any]:
    """Returns the skill and what its start would do, as JSON data.

    :raises Refused: it would not start.
    """
    check = await control.cell.check_start(robot, skill, parameters)
    if not check["ok"]:
        raise Refused(f"{skill} would not start on {robot}: {Explanation.from_dict(check['why'])}")
    return {"robot": robot, "skill": skill, "parameters": dict(parameters), "preview": check}
