"""The commands that plan, and tell what they have found: plan, preview and explain."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

from skiros2_common.command_line.command import OK, REFUSED, CommandResult
from skiros2_common.command_line.layout import Screen, table
from skiros2_common.core.errors import UnknownName, WrongValue
from skiros2_common.core.names import same_node
from skiros2_common.core.world_element import Element
from skiros2_task.command_line.source import manager_of, planning_world
from skiros2_task.core.archive import Archive
from skiros2_task.core.durations import Durations
from skiros2_task.core.engine_processes import EngineProcesses
from skiros2_task.core.plan import SkillCall
from skiros2_task.core.plan_table import plan_head, plan_rows
from skiros2_task.core.planner import Limits
from skiros2_task.core.portfolio import Wish, planner_named
from skiros2_task.core.preview import preview as try_out
from skiros2_task.core.schedule import Schedule
from skiros2_task.core.skill_model import MANAGER_PROPERTY
from skiros2_task.core.task_planner import PlanningResult, TaskPlanner, Verdict
from skiros2_task.core.why_step import why_plan
from skiros2_world_model.core.preview_copy import PreviewCopy

#: Where what was made for each request is kept, and how long skills took.
_FOLDER = Path("~/.skiros/planner")
_DURATIONS = "durations.json"

#: How long to look for a plan (s), and for the best one.
_SECONDS, _SECONDS_FOR_BEST = 60.0, 10.0

_HEADS = ("step", "start", "end", "robot", "skill", "after step", "parameters")


def plan(arguments: argparse.Namespace, screen: Screen) -> CommandResult:
    """The plan for a goal: when each step is done, and by which robot. Nothing moves."""
    with _planned(arguments) as (_, result):
        if result.schedule is None:
            return _without_plan(result)
        return CommandResult(_shown(result.schedule, result.calls, screen), _as_json(result))


def preview(arguments: argparse.Namespace, screen: Screen) -> CommandResult:
    """The plan for a goal, tried out on a copy of the scene: what each step would change. Nothing moves."""
    with _planned(arguments) as (wm, result):
        if result.verdict is not Verdict.PLANNED or result.task is None:
            return _without_plan(result)
        tried = try_out(PreviewCopy(wm), result.task, result.steps, result.calls, arguments.states)
        return CommandResult(list(tried.lines()), tried.to_dict(), OK if tried.works else REFUSED)


def explain(arguments: argparse.Namespace, screen: Screen) -> CommandResult:
    """What each step of the plan for a goal is for; or why there is none, and what would have to be so."""
    with _planned(arguments) as (_, result):
        if result.schedule is None or result.task is None:
            return _without_plan(result, notes=True)
        why = why_plan(result.task, result.schedule.order, result.calls)
        return CommandResult(list(why.lines()), why.to_dict())


def goal_text(words: Sequence[str]) -> str:
    """The goal that arguments give: the text of goals; `@FILE`, or a path that ends in .goal, .pddl or .txt, for a file
    that has it; `-` for the standard input.

    :raises WrongValue: a file cannot be read.
    """
    texts = []
    for word in words:
        if word == "-":
            texts.append(sys.stdin.read())
        elif word.startswith("@") or word.endswith((".goal", ".pddl", ".txt")):
            file = word.removeprefix("@")
            try:
                texts.append(Path(file).read_text(encoding="utf-8"))
            except (OSError, UnicodeDecodeError) as error:
                raise WrongValue(f"goal file {file}: {getattr(error, 'strerror', None) or error}") from None
        else:
            texts.append(word)
    return texts[0] if len(texts) == 1 else ",\n".join(texts)


@contextmanager
def _planned(arguments: argparse.Namespace) -> Iterator[tuple[Any, PlanningResult]]:
    """The world model, and what came of the goal of a command."""
    goal = goal_text(arguments.goal)
    folder = _FOLDER.expanduser()
    durations = Durations(folder / _DURATIONS)
    seconds = arguments.seconds or (_SECONDS_FOR_BEST if arguments.planner == Wish.BEST.value else _SECONDS)
    with planning_world(arguments) as wm, closing(EngineProcesses()) as processes:
        manager = manager_of(arguments.robot)
        if manager:
            _check_manager(wm, manager)
        planner = planner_named(processes, arguments.planner, durations)
        tasks = TaskPlanner(wm, planner, Limits(seconds), Archive(folder), durations)
        yield wm, tasks.plan(goal, asked_by=manager)


def _check_manager(wm: Any, manager: str) -> None:
    """
    :raises UnknownName: no robot is of that manager.
    """
    known = {str(e.value_of(MANAGER_PROPERTY)) for e in wm.resolve_elements(Element("cora:Robot"))} - {"None", ""}
    if not any(same_node(name, manager) for name in known):
        raise UnknownName(f"no robot {manager} offers skills; there are: {', '.join(sorted(known)) or 'none'}")


def _without_plan(result: PlanningResult, notes: bool = False) -> CommandResult:
    """What is said where there is nothing to be done, or no plan.

    :param notes: also what was left out.
    """
    lines = result.message.splitlines()
    if notes and result.notes:
        lines += ["what planning could not use:", *(f"  {note}" for note in result.notes)]
    return CommandResult(lines, _as_json(result), OK if result.verdict is Verdict.NOTHING_TO_DO else REFUSED)


def _shown(schedule: Schedule, calls: Sequence[SkillCall], screen: Screen) -> list[str]:
    """A plan in time, the steps in the order of their starts."""
    rows = [
        (
            str(row.number),
            f"{row.start:.1f}",
            f"{row.end:.1f}",
            row.robot,
            row.skill,
            ", ".join(map(str, row.after)),
            row.parameters,
        )
        for row in plan_rows(schedule, calls)
    ]
    return [plan_head(schedule, calls), "", *table(screen, rows, _HEADS)]


def _as_json(result: PlanningResult) -> dict[str, Any]:
    data: dict[str, Any] = {
        "verdict": result.verdict.value,
        "message": result.message,
        "notes": list(result.notes),
        "why": result.why.to_dict() if result.why is not None else None,
        "makespan": None,
        "steps": [],
    }
    if result.schedule is not None:
        before = result.schedule.order.predecessors()
        data["makespan"] = result.schedule.makespan
        data["steps"] = [
            {
                "number": step.step + 1,
                "start": step.start,
                "end": step.end,
                "robot": call.manager,
                "type": call.type,
                "label": call.label,
                "parameters": {key: {"id": e.id, "label": e.label, "type": e.type} for key, e in call.arguments},
                "after": [i + 1 for i in before[step.step]],
            }
            for step, call in zip(result.schedule.steps, result.calls, strict=True)
        ]
    return data
