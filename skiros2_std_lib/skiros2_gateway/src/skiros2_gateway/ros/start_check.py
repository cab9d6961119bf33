"""Checks whether a skill would start, with values as an agent gives them."""

from __future__ import annotations

import json
from typing import Any

from skiros2_skill.client.manager import ManagerClient
from skiros2_skill.command_line.assignments import read_steps
from skiros2_skill.command_line.queries import World


def check_start(client: ManagerClient, skill: str, parameters: dict[str, Any]) -> dict[str, Any]:
    """Returns what a start would do now: {ok, implementation, elements, why}; blocks.

    :param skill: type, or label of an implementation.
    :param parameters: values by key; elements by id or label.
    :raises SkirosError: skill or parameters are wrong, or the manager does not answer.
    """
    words = [skill, *(f"{key}={_text(value)}" for key, value in parameters.items())]
    world = World(client.name, client.author)
    steps = read_steps(words, client.read_skills(), world.find_element, world.has_learned_values)
    preview = client.preview(steps)
    return {
        "ok": preview.refusal is None,
        "implementation": preview.label,
        "elements": {key: element.id for key, element in preview.elements.items()},
        "why": preview.refusal.to_dict() if preview.refusal is not None else None,
    }


def _text(value: Any) -> str:
    return value if isinstance(value, str) else json.dumps(value)
