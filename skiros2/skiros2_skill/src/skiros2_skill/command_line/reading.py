"""The commands that tell of skills: list, describe and why."""

from __future__ import annotations

import argparse
import json
from typing import Any

from skiros2_common.command_line.command import CommandResult
from skiros2_common.command_line.layout import Screen, table
from skiros2_common.core.errors import SkirosError, UnknownName
from skiros2_common.core.names import local_name
from skiros2_skill.command_line.connection import Manager
from skiros2_skill.command_line.description import REQUIRED, Parameter, Skill, choose
from skiros2_skill.command_line.world import CONDITIONS, Registered, World


def list_skills(manager: Manager, arguments: argparse.Namespace, screen: Screen) -> CommandResult:
    """The skills that a robot has, with their parameters: in brackets those that are not required."""
    skills = sorted(manager.skills(), key=lambda skill: (skill.type, skill.label))
    rows = [(s.label, s.type, " ".join(_short(p) for p in _in_order(s) if p.key != "Robot")) for s in skills]
    lines = table(screen, rows, ("skill", "type", "parameters")) if rows else [f"{manager.name} has no skills"]
    return CommandResult(lines, [_skill_json(skill) for skill in skills])


def describe(manager: Manager, arguments: argparse.Namespace, screen: Screen) -> CommandResult:
    """A skill: its parameters, conditions and implementations."""
    skills = manager.skills()
    choice = choose(arguments.skill, skills)
    world = World(manager.name, manager.author)
    lines: list[str] = []
    data = []
    for skill in choice.skills:
        others = [s.label for s in skills if s.type == skill.type and s is not skill]
        registered, trouble = _registered(world, skill)
        lines += ["", *_described(skill, others, registered, trouble, screen)]
        conditions = {kind: [vars(c) for c in some] for kind, some in registered.conditions.items()}
        known = {"purpose": registered.purpose, "module": registered.module, "classes": registered.classes}
        data.append({**_skill_json(skill), **known, "conditions": conditions})
    return CommandResult(lines[1:], data)


def why(manager: Manager, arguments: argparse.Namespace, screen: Screen) -> CommandResult:
    """Why a task, or nodes in it, failed: by default the one that failed or was refused last."""
    answer = manager.why(-1 if arguments.task is None else arguments.task)
    if not answer.ok:
        raise UnknownName(answer.text)
    return CommandResult(answer.text.splitlines(), json.loads(answer.json or "[]"))


def _registered(world: World, skill: Skill) -> tuple[Registered, str]:
    """What the world model tells of a skill, and what keeps it from that."""
    try:
        return world.registered(skill.type, skill.label), ""
    except SkirosError as error:
        return Registered(), str(error)


def _described(skill: Skill, others: list[str], registered: Registered, trouble: str, screen: Screen) -> list[str]:
    facts = [
        ("type", skill.type),
        ("under", " > ".join(map(local_name, registered.classes[:-1]))),
        ("module", registered.module),
        ("also", f"{', '.join(others)} (other implementations of {skill.type})" if others else ""),
    ]
    head = f"{skill.label}: {registered.purpose}" if registered.purpose else skill.label
    lines = [screen.fitted(head), *_indented([fact for fact in facts if fact[1]], screen)]
    rows = [(p.key, p.kind, p.type, _default(p), p.description) for p in _in_order(skill)]
    lines += ["", "parameters", *_indented(rows, screen)]
    for kind in CONDITIONS:
        conditions = registered.conditions.get(kind, [])
        if conditions:
            lines += ["", f"{kind}-conditions", *_indented([(c.label, c.text) for c in conditions], screen)]
    return [*lines, "", screen.fitted(f"conditions are not known: {trouble}")] if trouble else lines


def _indented(rows: Any, screen: Screen) -> list[str]:
    width = screen.width
    inner = Screen(None if width is None else max(1, width - 2), screen.fancy)
    return [f"  {line}" for line in table(inner, rows)]


def _in_order(skill: Skill) -> list[Parameter]:
    """What has to be given first, then other required ones, and the robot last."""
    return sorted(
        skill.parameters.values(), key=lambda p: (p.key == "Robot", not p.has_to_be_given, p.kind != REQUIRED)
    )


def _short(parameter: Parameter) -> str:
    if parameter.default:
        return f"[{parameter.key}={_values(parameter)}]"
    return parameter.key if parameter.kind == REQUIRED else f"[{parameter.key}]"


def _default(parameter: Parameter) -> str:
    return f"= {_values(parameter)}" if parameter.default else ""


def _values(parameter: Parameter) -> str:
    shown: list[Any] = parameter.as_json()["default"]
    if len(shown) == 1:
        return shown[0] if isinstance(shown[0], str) else json.dumps(shown[0], ensure_ascii=False)
    return json.dumps(shown, ensure_ascii=False)


def _skill_json(skill: Skill) -> dict[str, Any]:
    parameters = [parameter.as_json() for parameter in skill.parameters.values()]
    return {"type": skill.type, "label": skill.label, "parameters": parameters}
