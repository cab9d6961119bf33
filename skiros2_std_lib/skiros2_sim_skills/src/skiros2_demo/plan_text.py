"""Formats plans for a terminal."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

from skiros2_common.core.errors import WrongValue

#: A step of a plan, as in the feedback of `~achieve`.
Step = dict[str, Any]


def steps_of(text: str) -> list[Step]:
    """Parses the steps of a plan.

    :param text: JSON of the task manager; "" for no steps.
    :raises WrongValue: it is not a plan.
    """
    try:
        steps = json.loads(text or "[]")
        if all(isinstance(step["number"], int) for step in steps):
            return list(steps)
    except (ValueError, KeyError, TypeError) as error:
        raise WrongValue(f"the plan cannot be read: {error!r} in {text!r}") from error
    raise WrongValue(f"the plan cannot be read: a step has no number in {text!r}")


def plan_lines(steps: list[Step], name: Callable[[str], str]) -> list[str]:
    """Formats a plan, one line per step.

    :param name: returns the name of an element.
    """
    return [f"{number}. {_step(step, name)}".rstrip() for number, step in enumerate(steps, 1)]


def _step(step: Step, name: Callable[[str], str]) -> str:
    facts = [f"{key}: {name(value)}" for key, value in step.get("arguments", {}).items() if key != "Robot"]
    return f"{name_of(step):<8} {'; '.join(facts)}"


def name_of(step: Step) -> str:
    """Returns the name of a step's skill."""
    return str(step.get("label") or step.get("skill", ""))
