"""Plans as text for a terminal."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

from skiros2_common.core.errors import WrongValue


def plan_lines(plan: str, name: Callable[[str], str]) -> list[str]:
    """A line for each step of a plan.

    :param plan: the task manager's JSON.
    :param name: what a person calls the element with an id.
    :raises WrongValue: the text is no plan.
    """
    try:
        steps = json.loads(plan)["children"]
        return [f"{number}. {_step(step, name)}" for number, step in enumerate(steps, 1)]
    except (ValueError, KeyError, TypeError) as error:
        raise WrongValue(f"the plan cannot be read: {error!r} in {plan!r}") from error


def _step(step: dict[str, Any], name: Callable[[str], str]) -> str:
    facts = []
    for param in step["ph"]:
        shown = [name(v["id"]) if isinstance(v, dict) and "id" in v else str(v) for v in param["values"]]
        if shown and param["key"] != "Robot":
            facts.append(f"{param['key']}: {', '.join(shown)}")
    return f"{step['name']:<8} {'; '.join(facts)}"
