"""The command domain."""

from __future__ import annotations

import argparse
from pathlib import Path

from skiros2_common.command_line.command import REFUSED, CommandResult
from skiros2_common.command_line.layout import Screen
from skiros2_common.core.errors import WrongValue
from skiros2_common.core.manager_names import same_node
from skiros2_task.command_line.planning import goal_text
from skiros2_task.command_line.world import manager_of, planning_world
from skiros2_task.core.actions import Action, Effect, condition_predicates, make_actions
from skiros2_task.core.compiler import make_task
from skiros2_task.core.explain_no_plan import format_formula
from skiros2_task.core.formula import Atom, Formula, Kind, Not, conjuncts
from skiros2_task.core.goal_reader import GoalReader
from skiros2_task.core.goal_text import GoalError
from skiros2_task.core.task import PlanningTask
from skiros2_task.core.world import WorldView

_DOMAIN, _PROBLEM = "domain.pddl", "p01.pddl"


def domain(arguments: argparse.Namespace, screen: Screen) -> CommandResult:
    """Show the planning actions of the robots' skills; with a goal, its domain and problem as PDDL."""
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
        except GoalError as error:  # has several lines
            return CommandResult(str(error).splitlines(), status=REFUSED)
        return _pddl(task, arguments.folder)


def _skills(world: WorldView) -> CommandResult:
    """Returns the planning actions of the skills."""
    actions, notes = make_actions(world.robots)
    lines: list[str] = []
    data = []
    for action in actions:
        described = _describe(action)
        data.append({"skill": action.skill.name, **described})
        lines += [f"{action.skill.name} of {', '.join(described['managers'])}"]
        for verb, key in (("takes", "parameters"), ("needs", "needs"), ("makes", "makes")):
            lines += [f"  {verb} {value}" for value in described[key]]
        lines.append("")
    if not world.robots:
        lines.append("no robot in the world model offers skills")
    return CommandResult([*lines, *notes] or ["nothing"], {"skills": data, "notes": notes})


def _describe(action: Action) -> dict[str, list[str]]:
    needs = [part for part in conjuncts(action.precondition) if not _is_can(part)]
    return {
        "managers": [manager for _, manager in action.managers],
        "parameters": [f"{v.name[1:]} ({' and '.join(v.classes)})" for v in action.variables],
        "needs": [format_formula(part) for part in needs],
        "makes": [_effect(effect) for effect in action.effects],
    }


def _is_can(part: Formula) -> bool:
    return isinstance(part, Atom) and part.predicate.kind is Kind.CAN


def _effect(effect: Effect) -> str:
    return format_formula(effect.atom if effect.state else Not(effect.atom))


def _pddl(task: PlanningTask, folder: Path | None) -> CommandResult:
    from unified_planning.io import PDDLWriter  # takes a second, so imported after the goal was read

    from skiros2_task.core.up_model import UpProblem

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
