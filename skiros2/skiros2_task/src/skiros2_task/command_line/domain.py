"""The command that tells what planning knows: of the skills, and of a goal the whole domain and problem as PDDL."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from skiros2_common.command_line.command import REFUSED, CommandResult
from skiros2_common.command_line.layout import Screen
from skiros2_common.core.errors import WrongValue
from skiros2_common.core.names import same_node
from skiros2_task.command_line.planning import goal_text
from skiros2_task.command_line.source import manager_of, planning_world
from skiros2_task.core.actions import Action, Effect, condition_predicates, make_actions
from skiros2_task.core.formula import Atom, Kind, Not, conjuncts
from skiros2_task.core.goal import GoalReader
from skiros2_task.core.goal_syntax import GoalError
from skiros2_task.core.problem import make_task
from skiros2_task.core.task import PlanningTask
from skiros2_task.core.why import said
from skiros2_task.core.world_view import WorldView

_DOMAIN, _PROBLEM = "domain.pddl", "p01.pddl"


def domain(arguments: argparse.Namespace, screen: Screen) -> CommandResult:
    """What planning knows of the robots' skills; with a goal, the domain and the problem for it as PDDL."""
    with planning_world(arguments) as wm:
        world = WorldView(wm)
        manager = manager_of(arguments.robot)
        if manager:
            world.robots = tuple(robot for robot in world.robots if same_node(robot.manager, manager))
        if not arguments.goal:
            return _skills(world)
        reader = GoalReader(world, condition_predicates(world.robots))
        try:
            task = make_task(world, reader.read(goal_text(arguments.goal)))
        except GoalError as error:  # which shows the place in lines of its own
            return CommandResult(str(error).splitlines(), status=REFUSED)
        return _pddl(task, arguments.folder)


def _skills(world: WorldView) -> CommandResult:
    """The skills as planning understands them."""
    actions, notes = make_actions(world.robots)
    lines: list[str] = []
    data = []
    for action in actions:
        told = _told(action)
        data.append(told)
        lines += [f"{told['skill']} of {', '.join(told['managers'])}"]
        for kind, values in (("takes", told["parameters"]), ("needs", told["needs"]), ("makes", told["makes"])):
            lines += [f"  {kind} {value}" for value in values]
        lines.append("")
    if not world.robots:
        lines.append("no robot in the world model offers skills")
    return CommandResult([*lines, *notes] or ["nothing"], {"skills": data, "notes": notes})


def _told(action: Action) -> dict[str, Any]:
    needs = [part for part in conjuncts(action.precondition) if not _is_can(part)]
    return {
        "skill": action.skill.name,
        "managers": [manager for _, manager in action.managers],
        "parameters": [f"{v.name[1:]} ({' and '.join(v.classes)})" for v in action.variables],
        "needs": [said(part) for part in needs],
        "makes": [_effect(effect) for effect in action.effects],
    }


def _is_can(part: Any) -> bool:
    return isinstance(part, Atom) and part.predicate.kind is Kind.CAN


def _effect(effect: Effect) -> str:
    return said(effect.atom if effect.state else Not(effect.atom))


def _pddl(task: PlanningTask, folder: Path | None) -> CommandResult:
    from unified_planning.io import PDDLWriter  # takes a second, which is lost where the goal cannot be read

    from skiros2_task.core.up_problem import UpProblem

    writer = PDDLWriter(UpProblem(task).problem)
    texts = {_DOMAIN: writer.get_domain(), _PROBLEM: writer.get_problem()}
    data = {"domain": texts[_DOMAIN], "problem": texts[_PROBLEM], "notes": list(task.notes)}
    notes = [f"; {note}" for note in task.notes]
    if folder is None:
        return CommandResult([*notes, *(line for text in texts.values() for line in ["", *text.splitlines()])], data)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name, text in texts.items():
            (folder / name).write_text(text, encoding="utf-8")
    except OSError as error:
        raise WrongValue(f"{folder}: {error.strerror}") from None
    return CommandResult([*notes, *(str(folder / name) for name in texts)], data)
