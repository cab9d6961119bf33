"""The commands list, describe and why."""

from __future__ import annotations

import argparse
import json
from typing import Any

from skiros2_common.command_line.command import CommandResult
from skiros2_common.command_line.layout import Screen, table
from skiros2_common.core.errors import SkirosError
from skiros2_common.core.names import local_name
from skiros2_skill.client.description import REQUIRED, Parameter, Skill, find_skill
from skiros2_skill.client.manager import ManagerClient
from skiros2_skill.command_line.world import CONDITIONS, Registered, World


def list_skills(manager: ManagerClient, arguments: argparse.Namespace, screen: Screen) -> CommandResult:
    """Lists the skills of a robot with their parameters; optional ones are in brackets."""
    skills = sorted(manager.read_skills(), key=lambda skill: (skill.type, skill.label))
    rows = [(s.label, s.type, " ".join(_short(p) for p in _in_order(s) if p.key != "Robot")) for s in skills]
    lines = table(screen, rows, ("skill", "type", "parameters")) if rows else [f"{manager.name} has no skills"]
    return CommandResult(lines, [_skill_json(skill) for skill in skills])


def describe(manager: ManagerClient, arguments: argparse.Namespace, screen: Screen) -> CommandResult:
    """Shows the parameters, conditions and implementations of a skill."""
    skills = manager.read_skills()
    named = find_skill(arguments.skill, skills)
    world = World(manager.name, manager.author)
    lines: list[str] = []
    data = []
    for skill in named.skills:
        others = [s.label for s in skills if s.type == skill.type and s is not skill]
        registered, error = _registered(world, skill)
        lines += ["", *_described(skill, others, registered, error, screen)]
        conditions = {kind: [vars(c) for c in some] for kind, some in registered.conditions.items()}
        known = {"purpose": registered.purpose, "module": registered.module, "classes": registered.classes}
        data.append({**_skill_json(skill), **known, "conditions": conditions})
    return CommandResult(lines[1:], data)


def why(manager: ManagerClient, arguments: argparse.Namespace, screen: Screen) -> CommandResult:
    """Shows why a task or its nodes failed, by default the last task that failed or was refused."""
    found = manager.why(-1 if arguments.task is None else arguments.task)
    return CommandResult(found.text.splitlines(), [explanation.to_dict() for explanation in found.explanations])


def _registered(world: World, skill: Skill) -> tuple[Registered, str]:
    """What the world model has registered of a skill, and the error text when it does not answer."""
    try:
        return world.registered(skill.type, skill.label), ""
    except SkirosError as error:
        return Registered(), str(error)


def _described(skill: Skill, others: list[str], registered: Registered, error: str, screen: Screen) -> list[str]:
    facts = [
        ("type", skill.type),
        ("under", " > ".join(map(local_name, registered.classes[:-1]))),
        ("module", registered.module),
        ("also", f"{', '.join(others)} (other implementations of {skill.type})" if others else ""),
    ]
    head = f"{skill.label}: {registered.purpose}" if registered.purpose else skill.label
    lines = [screen.fitted(head), *_indented([fact for fact in facts if fact[1]], screen)]
    rows = [(p.key, p.kind, p.type, _default(p), _explained(p)) for p in _in_order(skill)]
    lines += ["", "parameters", *_indented(rows, screen)]
    for kind in CONDITIONS:
        conditions = registered.conditions.get(kind, [])
        if conditions:
            lines += ["", f"{kind}-conditions", *_indented([(c.label, c.text) for c in conditions], screen)]
    return [*lines, "", screen.fitted(f"conditions are not known: {error}")] if error else lines


def _indented(rows: Any, screen: Screen) -> list[str]:
    width = screen.width
    inner = Screen(None if width is None else max(1, width - 2), screen.fancy)
    return [f"  {line}" for line in table(inner, rows)]


def _in_order(skill: Skill) -> list[Parameter]:
    """The parameters that must be given first, then other required ones; the robot last."""
    return sorted(
        skill.parameters.values(), key=lambda p: (p.key == "Robot", not p.must_be_given, p.kind != REQUIRED)
    )


def _short(parameter: Parameter) -> str:
    if parameter.default:
        return f"[{parameter.key}={_values(parameter)}]"
    return parameter.key if parameter.kind == REQUIRED else f"[{parameter.key}]"


def _default(parameter: Parameter) -> str:
    return f"= {_values(parameter)}" if parameter.default else ""


def _explained(parameter: Parameter) -> str:
    """The description, and the unit and limits."""
    return ", ".join(text for text in (parameter.description, parameter.limits.text) if text)


def _values(parameter: Parameter) -> str:
    values: list[Any] = parameter.as_json()["default"]
    if len(values) == 1:
        return values[0] if isinstance(values[0], str) else json.dumps(values[0], ensure_ascii=False)
    return json.dumps(values, ensure_ascii=False)


def _skill_json(skill: Skill) -> dict[str, Any]:
    parameters = [parameter.as_json() for parameter in skill.parameters.values()]
    return {"type": skill.type, "label": skill.label, "parameters": parameters}
