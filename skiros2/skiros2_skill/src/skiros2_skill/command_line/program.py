"""The commands of `rosrun skiros2_skill`: their arguments and exit statuses."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from typing import Any

from skiros2_common.command_line.command import UNAVAILABLE, CommandResult, Parser, program, run_command, screen, user
from skiros2_common.command_line.layout import Screen
from skiros2_skill.client.manager import ManagerClient
from skiros2_skill.command_line import control, queries, run_skills, watch
from skiros2_skill.command_line.connection import connect

Command = Callable[[ManagerClient, argparse.Namespace, Screen], CommandResult]

_VALUES = (
    "A VALUE is of the type that the skill declares: an element by its id or label, a list or dict in JSON, several "
    "values as a JSON list. More skills with their values may follow; they run in sequence."
)
_BREAKPOINTS = (
    "A PATTERN is the label or type of a node, the label of a condition, or the id or label of an element or a "
    "relation of the world model, with wildcards * and ?. Resume or step continues a paused task."
)


def _run(name: str, given: Sequence[str]) -> int:
    command, parser = _parser(name)
    # With words, options may stand anywhere.
    arguments = (parser.parse_intermixed_args if name in ("run", "preview") else parser.parse_args)(given)

    def work() -> CommandResult:
        return command(connect(arguments.robot, arguments.author), arguments, screen())

    return run_command(parser.prog, work, arguments.json)


run = program(_run)


def _parser(name: str) -> tuple[Command, argparse.ArgumentParser]:
    command, add_arguments, *epilog = _COMMANDS[name]
    result = _RESULTS.get(name, _RESULT)
    statuses = f"Exit status: {result}, 2 wrong usage, {UNAVAILABLE} no master or no skill manager."
    parser = Parser(prog=name, description=command.__doc__, epilog=" ".join([*epilog, statuses]))
    add_arguments(parser)
    parser.add_argument("--robot", default="", metavar="NAME", help="the skill manager, if there are several")
    parser.add_argument("--author", default=user(), metavar="NAME", help="author of commands (default: %(default)s)")
    parser.add_argument("--json", action="store_true", help="print JSON")
    return command, parser


def _nothing(parser: argparse.ArgumentParser) -> None:
    """Adds no arguments."""


def _skill(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("skill", metavar="SKILL", help="the label of an implementation, or a type")


def _task(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("task", metavar="TASK", nargs="?", type=_task_id, help="its number")


def _libraries(parser: argparse.ArgumentParser) -> None:
    help_text = "a library that the manager has loaded (default: all)"
    parser.add_argument("libraries", metavar="LIBRARY", nargs="*", help=help_text)


def _words(parser: argparse.ArgumentParser) -> None:
    parser.usage = "%(prog)s [OPTION ...] SKILL [KEY=VALUE ...] [SKILL [KEY=VALUE ...] ...]"
    parser.add_argument("words", metavar="SKILL KEY=VALUE", nargs="+", help="the skills to run, with parameters")


def _run_words(parser: argparse.ArgumentParser) -> None:
    _words(parser)
    parser.add_argument("--detach", action="store_true", help="do not wait for the end")


def _watch(parser: argparse.ArgumentParser) -> None:
    _task(parser)
    parser.add_argument("--once", action="store_true", help="show the present state and exit")


def _breakpoint(parser: argparse.ArgumentParser) -> None:
    actions = parser.add_subparsers(dest="action", metavar="ACTION", parser_class=Parser)
    actions.add_parser("list", help="list the breakpoints (default)")
    adding = actions.add_parser("add", help="add a breakpoint")
    adding.add_argument("kind", metavar="KIND", choices=("node", "condition", "world"), help="node, condition or world")
    adding.add_argument("pattern", metavar="PATTERN", help="matches names")
    adding.add_argument("when", metavar="WHEN", nargs="?", help="of a node: start (default) or end")
    removing = actions.add_parser("remove", help="remove a breakpoint")
    removing.add_argument("number", metavar="NUMBER", type=_number_or_all, help="its number, or all")


def _task_id(text: str) -> int:
    if not text.isdecimal():
        raise argparse.ArgumentTypeError(f"{text!r} is not a task number")
    return int(text)


def _number_or_all(text: str) -> str:
    if text != "all" and not text.isdecimal():
        raise argparse.ArgumentTypeError(f"{text!r} is neither a number nor all")
    return text


#: The meaning of exit statuses 0 and 1, by default and by command.
_RESULT = "0 done, 1 refused or not found"
_RESULTS = {
    "run": "0 succeeded, 1 failed or refused",
    "preview": "0 the skills would start, 1 they would be refused",
    "watch": "0 success, 1 the task has failed or does not exist",
}

#: By name: the function, its arguments, and the end of its help.
_COMMANDS: dict[str, tuple[Any, ...]] = {
    "list": (queries.list_skills, _nothing),
    "describe": (queries.describe, _skill),
    "why": (queries.why, _task),
    "run": (run_skills.run, _run_words, _VALUES),
    "preview": (run_skills.preview, _words, _VALUES),
    "stop": (control.stop, _task),
    "pause": (control.pause, _task),
    "resume": (control.resume, _task),
    "step": (control.step, _task),
    "breakpoint": (control.breakpoint_, _breakpoint, _BREAKPOINTS),
    "watch": (watch.watch, _watch),
    "reload": (control.reload, _libraries),
}
