"""The commands of `rosrun skiros2_task`: arguments and exit status."""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Iterable, Sequence
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any, Protocol

from skiros2_common.command_line.command import UNAVAILABLE, CommandResult, Parser, program, run_command, screen
from skiros2_common.command_line.completion import Typed, complete_by
from skiros2_common.core.world_model_port import WorldModelPort
from skiros2_task.command_line import achieve, completers, planning
from skiros2_task.core.planners import DEFAULT_ENGINE
from skiros2_world_model.command_line.program import connect

Command = Callable[..., CommandResult]

_GOALS = (
    "A GOAL is (relation subject object), (property subject), (not ...), (and ...), (or ...), (exists (?x - class) "
    "...) or (forall (?x - class) ...), with ids of elements or names of templates; @FILE reads it from a file, - from "
    "the standard input. Several goals must hold together."
)
_OFFLINE = "With --scene, no master and no world model are needed."


def status(name: str, given: Sequence[str], cell: Cell | None = None) -> int:
    """Runs a command. Returns its exit status.

    :param given: its arguments.
    :param cell: opens the cell of a command without ROS; None: the arguments name a scene, or the system runs over ROS.
    """
    command, parser = _parser(name)
    if cell is not None:
        cell.add_arguments(parser)
    elif name != "achieve":
        _scene(parser)
    arguments = parser.parse_intermixed_args(given)  # options may stand anywhere

    def work() -> CommandResult:
        if cell is None:
            return command(arguments, screen())
        with cell.goal_client(arguments) if name == "achieve" else cell.world_model(arguments) as opened:
            return command(arguments, screen(), opened)

    return run_command(parser.prog, work, arguments.json)


run = program(status)


class Cell(Protocol):
    """A cell in this process."""

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Adds the arguments that name the cell."""

    def world_model(self, arguments: argparse.Namespace) -> AbstractContextManager[WorldModelPort]:
        """Opens the cell with its robots, to read. Yields its world model."""

    def goal_client(self, arguments: argparse.Namespace) -> AbstractContextManager[achieve.GoalClient]:
        """Opens the cell with its robots. Yields a client for one goal."""


def _parser(name: str) -> tuple[Command, argparse.ArgumentParser]:
    command, add_arguments, *epilog = _COMMANDS[name]
    server = "task manager" if name == "achieve" else "world model"
    statuses = f"Exit status: {_RESULTS[name]}, 2 wrong usage, {UNAVAILABLE} no master or no {server}."
    parser = Parser(prog=name, description=command.__doc__, epilog=" ".join([*epilog, statuses]))
    goal = parser.add_argument("goal", metavar="GOAL", nargs="+", help="the goal to reach")
    complete_by(goal, _goals)
    add_arguments(parser)
    parser.add_argument("--json", action="store_true", help="print JSON")
    return command, parser


def _goals(typed: Typed, begun: str) -> Iterable[str]:
    return () if "scene" in typed.options else completers.goals(connect("wm", "completion"), begun)


def _planning(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--planner",
        default=DEFAULT_ENGINE,
        metavar="NAME",
        help="plan quality (first, best or optimal), or an engine of unified-planning (default: %(default)s)",
    )
    parser.add_argument("--seconds", type=_seconds, metavar="S", help="time limit (default: 60; for quality best 10)")
    parser.add_argument("--robot", default="", metavar="NAME", help="plan for this robot only (default: all robots)")


def _scene(parser: argparse.ArgumentParser) -> None:
    offline = parser.add_argument_group("without a running system")
    offline.add_argument("--scene", type=Path, metavar="FILE", help="scene file, instead of the world model's scene")
    offline.add_argument(
        "--libraries", nargs="+", default=[], metavar="PACKAGE", help="skill libraries for the robots of the scene"
    )
    offline.add_argument("--skills", nargs="+", default=[], metavar="CLASS", help="skills to use (default: all)")
    offline.add_argument(
        "--workspace", type=Path, metavar="DIR", help="folder with ontologies (default: the scene's folder)"
    )


def _achieve(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--quality",
        default="",
        choices=("first", "best", "optimal"),
        help="plan quality (default: the task manager's)",
    )
    parser.add_argument(
        "--seconds", type=_seconds, metavar="S", help="time limit of each planning (default: the task manager's)"
    )
    parser.add_argument(
        "--priority",
        type=int,
        default=0,
        metavar="N",
        help="of goals that need the same robot, the one with the highest priority gets it first (default: 0)",
    )
    parser.add_argument(
        "--max-replans",
        type=int,
        default=-1,
        metavar="N",
        help="the largest number of replans (default: the task manager's)",
    )


def _seconds(text: str) -> float:
    try:
        seconds = float(text)
    except ValueError:
        seconds = math.nan
    if not 0 < seconds < math.inf:
        raise argparse.ArgumentTypeError(f"{text!r} is not a positive number of seconds")
    return seconds


_PLANNED = "0 there is a plan, or nothing to do, 1 no plan, or refused"

#: The meaning of the first exit statuses.
_RESULTS = {
    "plan": _PLANNED,
    "preview": f"{_PLANNED}, or the simulation fails",
    "explain": _PLANNED,
    "achieve": "0 the goal is reached, or holds already, 1 it is not reached, or refused, 130 cancelled",
}

#: The function, arguments and help epilogue of each command.
_COMMANDS: dict[str, tuple[Any, ...]] = {
    "plan": (planning.plan, _planning, _GOALS, _OFFLINE),
    "preview": (planning.preview, _planning, _GOALS, _OFFLINE),
    "explain": (planning.explain, _planning, _GOALS, _OFFLINE),
    "achieve": (achieve.achieve, _achieve, _GOALS),
}
