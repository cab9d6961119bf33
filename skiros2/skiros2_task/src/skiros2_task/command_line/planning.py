"""The commands plan, preview and explain, on the running world model or on a scene file with skill libraries."""

from __future__ import annotations

import argparse
import logging
import sys
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager, nullcontext
from pathlib import Path

from skiros2_common.command_line.command import OK, REFUSED, CommandResult, UsageError, quiet
from skiros2_common.command_line.layout import Screen, table
from skiros2_common.core.abstract_skill import SkillCore
from skiros2_common.core.errors import ConfigurationError, UnknownName, WrongValue
from skiros2_common.core.manager_names import same_node
from skiros2_common.core.names import local_name
from skiros2_common.core.primitive import PrimitiveBase
from skiros2_common.core.world_element import Element
from skiros2_common.core.world_model_port import WorldModelPort
from skiros2_common.tools.libraries import find_libraries
from skiros2_common.tools.plugin_loader import PluginLoader
from skiros2_skill.command_line.local_world_model import world_model_of
from skiros2_skill.core.library.description import Described
from skiros2_skill.core.tree.compound import SkillBase
from skiros2_skill.ros.registration import Registration
from skiros2_task.core.actions import ROBOT_KEY
from skiros2_task.core.engines import EngineProcesses, Limits
from skiros2_task.core.explain_plan import explain_plan
from skiros2_task.core.plan import Plan, Step
from skiros2_task.core.planners import Quality, planner_named
from skiros2_task.core.planning import PlanningResult, TaskPlanner, Verdict
from skiros2_task.core.preview import preview as simulate
from skiros2_task.core.skills import MANAGER_PROPERTY
from skiros2_task.core.store import DURATIONS_FILE, FOLDER, Archive, Durations
from skiros2_world_model.command_line.program import connect
from skiros2_world_model.core.preview_copy import PreviewCopy

#: The default time limits of planning (s), and of planning for quality `best`.
_SECONDS, _SECONDS_FOR_BEST = 60.0, 10.0

#: The name of the client at the world model.
_AUTHOR = "plan"

_HEADS = ("step", "start", "end", "robot", "skill", "after step", "parameters")


def plan(arguments: argparse.Namespace, screen: Screen, world: WorldModelPort | None = None) -> CommandResult:
    """Show the plan for a goal: the robot, start and end of each step. No robot moves."""
    with _planned(arguments, world) as (_, result):
        if result.plan is None:
            return _without_plan(result)
        return CommandResult(_format_plan(result.plan, screen), _as_json(result))


def preview(arguments: argparse.Namespace, screen: Screen, world: WorldModelPort | None = None) -> CommandResult:
    """Simulate the plan for a goal on a copy of the scene: show the changes of each step. No robot moves."""
    with _planned(arguments, world) as (wm, result):
        if result.plan is None:
            return _without_plan(result)
        simulated = simulate(PreviewCopy(wm), result.plan)
        return CommandResult(list(simulated.lines()), simulated.to_dict(), OK if simulated.works else REFUSED)


def explain(arguments: argparse.Namespace, screen: Screen, world: WorldModelPort | None = None) -> CommandResult:
    """Explain the purpose of each step of the plan for a goal; or why there is no plan, and which facts are missing."""
    with _planned(arguments, world) as (_, result):
        if result.plan is None:
            return _without_plan(result, notes=True)
        why = explain_plan(result.plan)
        return CommandResult(list(why.lines()), why.to_dict())


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
def _planned(
    arguments: argparse.Namespace, world: WorldModelPort | None
) -> Iterator[tuple[WorldModelPort, PlanningResult]]:
    """Yields the world model, and the result of planning for a command's goal.

    :param world: None: the one that the arguments name.
    """
    goal = goal_text(arguments.goal)
    folder = FOLDER.expanduser()
    durations = Durations(folder / DURATIONS_FILE)
    seconds = arguments.seconds or (_SECONDS_FOR_BEST if arguments.planner == Quality.BEST.value else _SECONDS)
    opened = _world_model(arguments) if world is None else nullcontext(world)
    with opened as wm, closing(EngineProcesses()) as processes:
        manager = _manager_of(arguments.robot)
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


# -- the world model ---------------------------------------------------------------------------------------------------


@contextmanager
def _world_model(arguments: argparse.Namespace) -> Iterator[WorldModelPort]:
    """Yields the world model that a command plans with.

    :raises Unavailable: there is no world model.
    :raises SkirosError: the scene or a library cannot be loaded.
    """
    if arguments.scene is None:
        if arguments.libraries or arguments.skills or arguments.workspace:
            raise UsageError("--libraries, --skills and --workspace are for scene files; name one with --scene")
        yield connect("wm", _AUTHOR, computing=True)
        return
    if not arguments.scene.is_file():
        raise ConfigurationError(f"scene {arguments.scene}: there is no such file")
    workspace = arguments.workspace or arguments.scene.resolve().parent
    find_libraries(arguments.libraries, arguments.scene.parent)
    # Other commands check scenes and libraries.
    without_warnings = quiet(logging.ERROR, "skiros2_common", "skiros2_world_model", "skiros2_skill")
    with without_warnings, world_model_of(arguments.libraries, workspace, _AUTHOR, arguments.scene) as wm:
        if arguments.libraries:
            _give_skills(wm, arguments)
        yield wm


def _manager_of(robot: str) -> str:
    """Returns the node name of a robot's manager; "" for any robot."""
    return f"/{local_name(robot).lstrip('/')}" if robot else ""


def _give_skills(wm: WorldModelPort, arguments: argparse.Namespace) -> None:
    """Adds the skills of libraries to the robots of a scene, as their managers would."""
    skills = _skills_of(wm, arguments.libraries, arguments.skills)
    for robot in _robots(wm, arguments.robot):
        for skill in skills:
            element = skill.toElement()
            element.addRelation(robot, "skiros:hasSkill", "-1")
            wm.add_element(element)


def _robots(wm: WorldModelPort, wanted: str) -> list[str]:
    """Registers robots as their managers would, and returns their ids.

    :param wanted: the label, or template, of one robot; "": all robots of the scene with a label.
    :raises ConfigurationError: there is no robot.
    """
    labels = [wanted] if wanted else [e.label for e in wm.resolve_elements(Element("cora:Robot")) if e.label]
    if not labels:
        raise ConfigurationError("the scene has no robot; name one with --robot prefix:name, as its template is called")
    found = []
    for label in dict.fromkeys(labels):
        prefix, _, name = label.rpartition(":")
        registration = Registration(wm, prefix, name.lstrip("/"), _manager_of(label))
        registration.register_robot()
        found.append(registration.robot_id)
    return found


def _skills_of(wm: WorldModelPort, packages: Sequence[str], names: Sequence[str]) -> list[SkillCore]:
    """Returns the skills of libraries.

    :param names: of the skill classes; empty: all.
    """
    loader = PluginLoader()
    classes = [cls for package in packages for cls in loader.find(package, (PrimitiveBase, SkillBase))]
    if names:
        known = {cls.__name__: cls for cls in classes}
        unknown = [name for name in names if name not in known]
        if unknown:
            there = ", ".join(sorted(known))
            raise ConfigurationError(f"{', '.join(packages)}: no skill {', '.join(unknown)}; there are: {there}")
        classes = [known[name] for name in names]
    found = []
    for cls in dict.fromkeys(classes):
        try:
            found.append(Described(cls, wm).skill)
        except Exception as error:  # a library may raise anything
            raise ConfigurationError(f"skill {cls.__name__} cannot be read: {type(error).__name__}: {error}") from error
    return found
