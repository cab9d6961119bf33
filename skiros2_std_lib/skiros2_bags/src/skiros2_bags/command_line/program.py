"""The commands of `rosrun skiros2_bags` that read bags: what they take from the command line, and how they end."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from skiros2_bags.command_line import comparing, looking, plotting, restoring, worlds
from skiros2_bags.core.run import Run
from skiros2_common.command_line.command import USAGE, CommandResult, Parser, program, run_command, screen
from skiros2_common.command_line.layout import Screen

Command = Callable[[Run, argparse.Namespace, Screen], CommandResult]

_TIMES = (
    "A TIME is 12.5 (s after the start of the bag), -3 (before its end; write --at=-3), 14:05:30, "
    "'2026-11-21 14:05:30', or s since the epoch."
)


def _run(name: str, arguments: Sequence[str]) -> int:
    command, parser = _parser(name)
    given = parser.parse_args(arguments)
    return run_command(name, lambda: command(Run.open(given.bag), given, screen()), given.json, USAGE)


run = program(_run)


def _parser(name: str) -> tuple[Command, argparse.ArgumentParser]:
    command, add_arguments, *epilog = _COMMANDS[name]
    status = "Exit status: 0 done, 2 the bag cannot be read, or wrong usage."
    parser = Parser(
        prog=name, description=(command.__doc__ or "").partition("\n\n")[0], epilog=" ".join([*epilog, status])
    )
    parser.add_argument("bag", type=Path, metavar="BAG", help="the file")
    add_arguments(parser)
    parser.add_argument("--json", action="store_true", help="print JSON")
    return command, parser


def _no_more(parser: argparse.ArgumentParser) -> None:
    pass


def _show(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--topics", action="store_true", help="the topics too")


def _skills(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--robot", default="", metavar="NAME", help="only this robot's")
    parser.add_argument(
        "--depth", type=int, default=0, metavar="N", help="only so deep in the tree (1: the task's own)"
    )
    parser.add_argument("--total", action="store_true", help="a row for each skill: how often, how long")


def _world(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("id", nargs="?", default="", help="only this element")
    parser.add_argument("--at", default="", metavar="TIME", help="when (default: at the end)")
    parser.add_argument("--partial", action="store_true", help="what is known, although changes are missing")
    parser.add_argument("--all", action="store_true", help="all properties, relations and elements")


def _changes(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("id", nargs="?", default="", help="only changes of this element")
    parser.add_argument("--since", default="", metavar="TIME", help="only those after that")
    parser.add_argument("--until", default="", metavar="TIME", help="only those up to that")
    parser.add_argument("--author", default="", metavar="NAME", help="only those that this author made")
    parser.add_argument("--all", action="store_true", help="all lines of large changes")


def _tasks(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--robot", default="", metavar="NAME", help="only this robot's")
    parser.add_argument("--task", type=int, default=None, metavar="N", help="only the tasks of this number")


def _diff(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("other", type=Path, metavar="OTHER", help="the bag that is compared with it")
    parser.add_argument(
        "--tolerance", type=float, default=0.001, metavar="X",
        help="how far measured numbers may be apart, as they are and relative (default: %(default)s)",
    )  # fmt: skip
    parser.add_argument("--all", action="store_true", help="all differences")


def _plot(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("-o", "--output", type=Path, metavar="PNG", help="the picture (default: BAG with .png)")
    parser.add_argument("--depth", type=int, default=0, metavar="N", help="only skills so deep in the tree")


def _restore(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--at", default="", metavar="TIME", help="when (default: at the end)")
    parser.add_argument("--partial", action="store_true", help="what is known, although changes are missing")
    parser.add_argument("--wm", default="wm", metavar="NAME", help="the world model's node (default: %(default)s)")


#: What each does, what it takes, and what is told at the end of its help.
_COMMANDS: dict[str, tuple[Any, ...]] = {
    "show": (looking.show, _show),
    "check": (looking.check_bag, _no_more, "Status 1: something is missing."),
    "tasks": (looking.tasks, _tasks),
    "skills": (looking.skills, _skills),
    "world": (worlds.world, _world, _TIMES),
    "changes": (worlds.changes, _changes, _TIMES),
    "diff": (comparing.diff, _diff, "Status 1: there are differences."),
    "plot": (plotting.plot, _plot),
    "restore": (restoring.restore, _restore, _TIMES, "Status 2 too: the world model refuses; 3: there is none."),
}
