"""The command `skiros2`: what works without ROS."""

from __future__ import annotations

import logging
import sys
from collections.abc import Sequence
from importlib import import_module
from typing import NoReturn

from skiros2_common.command_line.command import INTERRUPTED, OK, REFUSED, UNAVAILABLE, USAGE
from skiros2_common.core.errors import SkirosError

#: The programs by name: the module, the arguments of its `run` before those of the command line, and what it does.
_PROGRAMS: dict[str, tuple[str, tuple[str, ...], str]] = {
    "new": ("skiros2_skill.command_line.new", (), "make a package with skills, or a skill, reasoner or scene in one"),
    "lint": ("skiros2_skill.command_line.lint", (), "check skill libraries"),
    "plan": ("skiros2_task.command_line.program", ("plan",), "plan for a goal, with --scene FILE"),
    "explain": ("skiros2_task.command_line.program", ("explain",), "explain the plan, or why there is none"),
    "validate": ("skiros2_world_model.command_line.program", ("validate_scene",), "check scene files"),
}
_TRY = "a robot reaches goals in the terminal, is disturbed, and explains a failure (half a minute)"


def run() -> NoReturn:
    """Runs the command with the arguments of this process, and ends the process."""
    sys.exit(main(sys.argv[1:]))


def main(arguments: Sequence[str]) -> int:
    """Runs the command.

    :returns: the exit status: 0 done, 1 failed, 2 wrong usage, 3 a library is missing, 130 interrupted.
    :raises SystemExit: another program than `try` has ended.
    """
    command, *given = arguments or ["--help"]
    if command in _PROGRAMS:
        module, fixed, _ = _PROGRAMS[command]
        try:
            import_module(module).run(*fixed, given)
        except ModuleNotFoundError as error:
            sys.stderr.write(f"skiros2 {command}: this needs ROS, or a missing library: {error}\n")
            return UNAVAILABLE
    if command == "try" and not given:
        return _try()
    wrong = command not in ("-h", "--help")
    (sys.stderr if wrong else sys.stdout).write(_help())
    return USAGE if wrong else OK


def _help() -> str:
    rows = {"try": _TRY, **{name: text for name, (_, _, text) in _PROGRAMS.items()}}
    lines = [f"  {name:<9} {text}" for name, text in rows.items()]
    usage, more = "usage: skiros2 COMMAND [ARGUMENTS]", "skiros2 COMMAND --help shows the arguments."
    return "\n".join([usage, "", *lines, "", more, ""])


def _try() -> int:
    logging.basicConfig(level=logging.CRITICAL)  # modules of libraries that need ROS are skipped
    try:
        from skiros2_local.tour import Tour

        return OK if Tour(sys.stdout).run() else REFUSED
    except ModuleNotFoundError as error:
        sys.stderr.write(f"skiros2: {error}; install what is missing with: pip install skiros2\n")
    except SkirosError as error:
        sys.stderr.write(f"skiros2: {error}\n")
    except KeyboardInterrupt:
        sys.stderr.write("\nskiros2: stopped\n")
        return INTERRUPTED
    return REFUSED
