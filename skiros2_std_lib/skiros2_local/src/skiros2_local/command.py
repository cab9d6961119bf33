"""The command `skiros2`: what works without ROS."""

from __future__ import annotations

import logging
import sys
from collections.abc import Sequence
from importlib import import_module
from typing import NoReturn

from skiros2_common.command_line.command import INTERRUPTED, OK, REFUSED, UNAVAILABLE, USAGE, VERSION, end
from skiros2_common.command_line.layout import next_commands
from skiros2_common.core.errors import SkirosError
from skiros2_common.core.names import nearest

_SKILL, _TASK, _WORLD = (f"skiros2_{name}.command_line.program" for name in ("skill", "task", "world_model"))

#: The commands that work in a cell, by name: the module, the command in it, and what it does.
_CELL_COMMANDS: dict[str, tuple[str, str, str]] = {
    "list": (_SKILL, "list", "list the robot's skills"),
    "describe": (_SKILL, "describe", "show a skill's parameters and conditions"),
    "run": (_SKILL, "run", "run skills"),
    "preview": (_SKILL, "preview", "show whether skills would start"),
    "why": (_SKILL, "why", "show why a skill failed"),
    "plan": (_TASK, "plan", "plan for a goal"),
    "explain": (_TASK, "explain", "explain the plan, or why there is none"),
    "achieve": (_TASK, "achieve", "plan for a goal, and run the plan"),
    "view": (_WORLD, "view", "show the scene"),
    "get": (_WORLD, "get", "show an element"),
    "set": (_WORLD, "set", "change an element"),
    "query": (_WORLD, "query", "answer a SPARQL query"),
    "history": (_WORLD, "history", "show the changes, with their times and authors"),
    "diff": (_WORLD, "diff", "compare scenes"),
    "load": (_WORLD, "load", "start again from the scene file, or from another"),
    "save": (_WORLD, "save", "write the scene to a file"),
}
#: The other commands: the module, the arguments of its `run` before those of the command line, and what it does.
_PROGRAMS: dict[str, tuple[str, tuple[str, ...], str]] = {
    "new": ("skiros2_skill.command_line.new", (), "make a package with skills, or a skill, reasoner or scene in one"),
    "lint": ("skiros2_skill.command_line.lint", (), "check skill libraries, ontologies and scenes"),
    "test": ("skiros2_skill.command_line.test", (), "run the tests of the package in this folder"),
    "validate": (_WORLD, ("validate_scene",), "check scene files"),
    "learn": ("skiros2_learning.command_line.program", (), "learn parameters of skills in simulation"),
}
#: What to type after the tour.
NEXT = {
    "skiros2 new my_skills": "a package of your own: a robot, its skills, a scene",
    "cd my_skills && skiros2 achieve '(my_skills:Inspected skiros:Product-5)'": "a goal: Bolt 1 is inspected",
    "skiros2 --help": "all commands",
}
_TRY = "a robot reaches goals in the terminal, is disturbed, and explains a failure (half a minute)"
#: Commands of a running system.
_WITH_ROS = ("stop", "pause", "resume", "step", "breakpoint", "watch", "reload", "safety", "doctor")


def run() -> NoReturn:
    """Runs the command with the arguments of this process, and ends the process."""
    try:
        end(main(sys.argv[1:]))
    except KeyboardInterrupt:
        end(INTERRUPTED)


def main(arguments: Sequence[str]) -> int:
    """Runs the command.

    :returns: the exit status: 0 done, 1 failed, 2 wrong usage, 3 a library is missing, 130 interrupted.
    :raises SystemExit: another program than `try` has ended.
    """
    command, *given = arguments or ["--help"]
    try:
        if command in _CELL_COMMANDS or command == "learn":
            from skiros2_local.cell import CommandCell
        if command in _CELL_COMMANDS:
            logging.basicConfig(format="%(message)s", level=logging.ERROR)
            module, name, _ = _CELL_COMMANDS[command]
            return int(import_module(module).status(name, given, CommandCell()))
        if command in _PROGRAMS:
            module, fixed, _ = _PROGRAMS[command]
            import_module(module).run(*fixed, given, *([CommandCell()] if command == "learn" else []))
    except ModuleNotFoundError as error:
        extra = "; it needs: pip install 'skiros2[learning]'" if command == "learn" else ""
        sys.stderr.write(f"skiros2 {command}: {error}{extra}\n")
        return UNAVAILABLE
    if command == "try" and not given:
        return _try()
    if command in ("-h", "--help"):
        sys.stdout.write(_help())
        return OK
    if command == "--version":
        sys.stdout.write(f"{VERSION}\n")
        return OK
    sys.stderr.write(f"{_unknown(command)}\n")
    return USAGE


def _unknown(command: str) -> str:
    if command == "try":
        return "skiros2 try: expected no arguments; see skiros2 --help"
    if command in _WITH_ROS:
        return f"skiros2: {command} is for a system with ROS: rosrun skiros2_skill {command}. Here Ctrl-C stops a task"
    near = nearest(command, ["try", *_CELL_COMMANDS, *_PROGRAMS], 1)
    hint = f"did you mean {near[0]!r}? " if near else ""
    return f"skiros2: there is no command {command!r}; {hint}skiros2 --help lists the commands"


def _help() -> str:
    programs = {**_CELL_COMMANDS, **_PROGRAMS}
    first = {"try": _TRY, **{name: programs[name][2] for name in ("new", "lint", "test")}}
    cell = {name: text for name, (_, _, text) in _CELL_COMMANDS.items()}
    last = {name: programs[name][2] for name in _PROGRAMS if name not in first}
    lines = ["usage: skiros2 COMMAND [ARGUMENTS]"]
    for title, rows in (("", first), ("in a cell, which is a scene with robots:", cell), ("", last)):
        lines += ["", *([title] if title else []), *(f"  {name:<9} {text}" for name, text in rows.items())]
    more = "A command finds the cell as the one before has left it. skiros2 COMMAND --help shows the arguments."
    return "\n".join([*lines, "", more, ""])


def _try() -> int:
    logging.basicConfig(level=logging.CRITICAL)  # modules of libraries that need ROS are skipped
    try:
        from skiros2_local.tour import Tour

        if not Tour(sys.stdout).run():
            return REFUSED
        sys.stdout.write(next_commands(NEXT))
        return OK
    except ModuleNotFoundError as error:
        sys.stderr.write(f"skiros2: {error}; install what is missing with: pip install skiros2\n")
    except SkirosError as error:
        sys.stderr.write(f"skiros2: {error}\n")
    except KeyboardInterrupt:
        sys.stderr.write("\nskiros2: stopped\n")
        return INTERRUPTED
    return REFUSED
