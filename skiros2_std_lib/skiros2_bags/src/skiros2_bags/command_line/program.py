"""The commands of `rosrun skiros2_bags` that read bags: arguments and exit status."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from skiros2_bags.command_line import commands
from skiros2_bags.core.run import Run
from skiros2_common.command_line.command import USAGE, CommandResult, Parser, program, run_command, screen
from skiros2_common.command_line.layout import Screen

Command = Callable[[Run, argparse.Namespace, Screen], CommandResult]

_TIMES = (
    "A TIME is 12.5 (s after the start of the bag), -3 (before its end; write --at=-3), '2026-11-21 14:05:30', or "
    "s since the epoch."
)


def _run(name: str, arguments: Sequence[str]) -> int:
    command, parser = _parser(name)
    options = parser.parse_args(arguments)
    return run_command(name, lambda: command(Run.open(options.bag), options, screen()), options.json, USAGE)


run = program(_run)


def _parser(name: str) -> tuple[Command, argparse.ArgumentParser]:
    command, add_arguments, *epilog = _COMMANDS[name]
    status = "Exit status: 0 success, 2 the bag cannot be read, or wrong usage."
    parser = Parser(
        prog=name, description=(command.__doc__ or "").partition("\n\n")[0], epilog=" ".join([*epilog, status])
    )
    parser.add_argument("bag", type=Path, metavar="BAG", help="the bag file")
    add_arguments(parser)
    parser.add_argument("--json", action="store_true", help="print JSON")
    return command, parser


def _show(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--topics", action="store_true", help="list the topics too")


def _skills(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--robot", default="", metavar="NAME", help="only skills of this robot")
    parser.add_argument(
        "--depth", type=int, default=0, metavar="N", help="only skills at this depth (1: those of the task request)"
    )
    parser.add_argument("--total", action="store_true", help="one row per skill: number of runs and times")


def _world(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("id", nargs="?", default="", help="only this element")
    parser.add_argument("--at", default="", metavar="TIME", help="time of the scene (default: end of the bag)")
    parser.add_argument("--partial", action="store_true", help="accept missing changes")
    parser.add_argument("--all", action="store_true", help="print all properties, relations and elements")


def _changes(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("id", nargs="?", default="", help="only changes of this element")
    parser.add_argument("--since", default="", metavar="TIME", help="only changes after this time")
    parser.add_argument("--until", default="", metavar="TIME", help="only changes up to this time")
    parser.add_argument("--author", default="", metavar="NAME", help="only changes by this author")
    parser.add_argument("--all", action="store_true", help="print all lines of large changes")


def _tasks(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--robot", default="", metavar="NAME", help="only tasks of this robot")
    parser.add_argument("--task", type=int, default=None, metavar="N", help="only tasks with this number")


def _diff(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("other", type=Path, metavar="OTHER", help="the bag to compare with")
    parser.add_argument(
        "--tolerance", type=float, default=0.001, metavar="X",
        help="absolute and relative tolerance of measured numbers (default: %(default)s)",
    )  # fmt: skip
    parser.add_argument("--all", action="store_true", help="print all differences")


def _plot(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("-o", "--output", type=Path, metavar="PNG", help="the image file (default: BAG with .png)")
    parser.add_argument("--depth", type=int, default=0, metavar="N", help="maximum depth of skills in the tree")


def _export(parser: argparse.ArgumentParser) -> None:
    formats = ("all", "mcap", "rerun")
    parser.add_argument("--format", choices=formats, default="all", help="what to write (default: %(default)s)")
    parser.add_argument("-o", "--output", type=Path, metavar="FOLDER", help="for the files (default: beside BAG)")


def _restore(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--at", default="", metavar="TIME", help="time of the scene (default: end of the bag)")
    parser.add_argument("--partial", action="store_true", help="accept missing changes")
    parser.add_argument("--wm", default="wm", metavar="NAME", help="node of the world model (default: %(default)s)")


#: Function, options and help epilogue of each command.
_COMMANDS: dict[str, tuple[Any, ...]] = {
    "show": (commands.show, _show),
    "check": (commands.check_bag, lambda parser: None, "Status 1: something is missing."),
    "tasks": (commands.tasks, _tasks),
    "skills": (commands.skills, _skills),
    "world": (commands.world, _world, _TIMES),
    "changes": (commands.changes, _changes, _TIMES),
    "diff": (commands.diff, _diff, "Status 1: there are differences."),
    "plot": (commands.plot, _plot),
    "export": (commands.export, _export),
    "restore": (
        commands.restore,
        _restore,
        _TIMES,
        "Status 2: also if the world model rejects the scene; 3: it is not running.",
    ),
}
