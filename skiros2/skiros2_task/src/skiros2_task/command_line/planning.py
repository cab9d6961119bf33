"""The commands plan, preview, explain and engines."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager
from pathlib import Path

from skiros2_common.command_line.command import OK, REFUSED, CommandResult
from skiros2_common.command_line.layout import Screen, table
from skiros2_common.core.errors import UnknownName, WrongValue
from skiros2_common.core.manager_names import same_node
from skiros2_common.core.world_element import Element
from skiros2_task.command_line.world import manager_of, planning_world
from skiros2_task.core.actions import ROBOT_KEY
from skiros2_task.core.engines import EngineProcesses, Limits
from skiros2_task.core.explain_plan import explain_plan
from skiros2_task.core.plan import Plan, Step
from skiros2_task.core.planners import Quality, planner_named
from skiros2_task.core.planning import PlanningResult, TaskPlanner, Verdict
from skiros2_task.core.preview import preview as simulate
from skiros2_task.core.skills import MANAGER_PROPERTY
from skiros2_task.core.store import DURATIONS_FILE, FOLDER, Archive, Durations
from skiros2_world_model.core.preview_copy import PreviewCopy
from skiros2_world_model.core.world_model_abstract_interface import WorldModelPort

#: The default time limits of planning (s), and of planning for quality `best`.
_SECONDS, _SECONDS_FOR_BEST = 60.0, 10.0

_HEADS = ("step", "start", "end", "robot", "skill", "after step", "parameters")


_MEANINGS = {
    Quality.FIRST: "the first plan, or a better one that comes a little later",
    Quality.BEST: "the plan with the smallest makespan that is found in the time",
    Quality.OPTIMAL: "a plan with the fewest steps",
}
_NOTES = {"fast-downward": "the default: first plan"}


def plan(arguments: argparse.Namespace, screen: Screen) -> CommandResult:
    """Show the plan for a goal: the robot, start and end of each step. No robot moves."""
    with _planned(arguments) as (_, result):
        if result.plan is None:
            return _without_plan(result)
        return CommandResult(_format_plan(result.plan, screen), _as_json(result))


def preview(arguments: argparse.Namespace, screen: Screen) -> CommandResult:
    """Simulate the plan for a goal on a copy of the scene: show the changes of each step. No robot moves."""
    with _planned(arguments) as (wm, result):
        if result.plan is None:
            return _without_plan(result)
        simulated = simulate(PreviewCopy(wm), result.plan, arguments.states)
        return CommandResult(list(simulated.lines()), simulated.to_dict(), OK if simulated.works else REFUSED)


def explain(arguments: argparse.Namespace, screen: Screen) -> CommandResult:
    """Explain the purpose of each step of the plan for a goal; or why there is no plan, and which facts are missing."""
    with _planned(arguments) as (_, result):
        if result.plan is None:
            return _without_plan(result, notes=True)
        why = explain_plan(result.plan)
        return CommandResult(list(why.lines()), why.to_dict())


def engines(_: argparse.Namespace, __: Screen) -> CommandResult:
    """List the planners: plan qualities, and installed engines of unified-planning."""
    with closing(EngineProcesses()) as processes:
        names = processes.engines()
    lines = [f"{quality.value:<20} {_MEANINGS[quality]}" for quality in Quality]
    lines += [f"{name:<20} {_NOTES.get(name, 'engine of unified-planning')}" for name in names]
    return CommandResult(lines, {"qualities": [quality.value for quality in Quality], "engines": list(names)})


def goal_text(words: Sequence[str]) -> str:
    """Returns the goal text of command-line arguments.

    :param words: each a goal text, `@FILE` or a path ending in .goal, .pddl or .txt, or `-` for the standard input.
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
def _planned(arguments: argparse.Namespace) -> Iterator[tuple[WorldModelPort, PlanningResult]]:
    """Yields the world model, and the result of planning for a command's goal."""
    goal = goal_text(arguments.goal)
    folder = FOLDER.expanduser()
    durations = Durations(folder / DURATIONS_FILE)
    seconds = arguments.seconds or (_SECONDS_FOR_BEST if arguments.planner == Quality.BEST.value else _SECONDS)
    with planning_world(arguments) as wm, closing(EngineProcesses()) as processes:
        manager = manager_of(arguments.robot)
        if manager:
            _check_manager(wm, manager)
        planner = planner_named(processes, arguments.planner)
        tasks = TaskPlanner(wm, planner, Limits(seconds), Archive(folder), durations)
        yield wm, tasks.plan(goal, asked_by=manager)


def _check_manager(wm: WorldModelPort, manager: str) -> None:
    """
    :raises UnknownName: no robot has this manager.
    """
    known = {str(e.value_of(MANAGER_PROPERTY)) for e in wm.resolve_elements(Element("cora:Robot"))} - {"None", ""}
    if not any(same_node(name, manager) for name in known):
        raise UnknownName(f"no robot {manager} offers skills; there are: {', '.join(sorted(known)) or 'none'}")


def _without_plan(result: PlanningResult, notes: bool = False) -> CommandResult:
    """Returns the answer for a satisfied goal, or a goal without a plan.

    :param notes: whether to add the messages about skills and elements that were left out.
    """
    lines = result.message.splitlines()
    if notes and result.notes:
        lines += ["not used for planning:", *(f"  {note}" for note in result.notes)]
    return CommandResult(lines, _as_json(result), OK if result.verdict is Verdict.NOTHING_TO_DO else REFUSED)


def _format_plan(plan: Plan, screen: Screen) -> list[str]:
    """Returns a table of the steps in the order of their starts."""
    rows = [
        (
            str(step.number),
            f"{step.start:.1f}",
            f"{step.end:.1f}",
            step.call.manager,
            step.call.label or step.call.type,
            ", ".join(map(str, sorted(step.after))),
            _arguments(step),
        )
        for step in sorted(plan.steps, key=lambda step: (step.start, step.number))
    ]
    return [plan.summary, "", *table(screen, rows, _HEADS)]


def _arguments(step: Step) -> str:
    names = ((key, f'"{e.label}"' if e.label else e.id) for key, e in step.call.arguments if key != ROBOT_KEY)
    return ", ".join(f"{key}={name}" for key, name in names)


def _as_json(result: PlanningResult) -> dict[str, object]:
    return {
        "verdict": result.verdict.value,
        "message": result.message,
        "notes": list(result.notes),
        "why": result.why.to_dict() if result.why is not None else None,
        "makespan": result.plan.makespan if result.plan is not None else None,
        "steps": [
            {
                "number": step.number,
                "start": step.start,
                "end": step.end,
                "robot": step.call.manager,
                "type": step.call.type,
                "label": step.call.label,
                "parameters": {key: {"id": e.id, "label": e.label, "type": e.type} for key, e in step.call.arguments},
                "after": sorted(step.after),
            }
            for step in (result.plan.steps if result.plan is not None else ())
        ],
    }
