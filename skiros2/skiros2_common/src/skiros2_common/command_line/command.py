"""The frame of all command-line programs: arguments, usage errors, result, output and exit status."""

from __future__ import annotations

import argparse
import getpass
import json
import math
import os
import shutil
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, NoReturn

from skiros2_common.command_line.layout import Screen
from skiros2_common.command_line.master import Unavailable
from skiros2_common.core.errors import SkirosError

#: Exit statuses.
OK, REFUSED, USAGE, UNAVAILABLE = 0, 1, 2, 3
#: Exit status of a command that Ctrl-C interrupted.
INTERRUPTED = 130


class UsageError(SkirosError):
    """The arguments are wrong in every state of the system; ends with `USAGE`."""


@dataclass
class CommandResult:
    """The output of a command and its exit status.

    :param lines: text for people.
    :param data: JSON data for programs, or a function that returns it.
    """

    lines: list[str] = field(default_factory=list)
    data: Any = None
    status: int = OK


class Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        """Wrong usage, in one line."""
        self.exit(USAGE, f"{self.prog}: {message}; see {self.prog} --help\n")


def command_arguments(arguments: Sequence[str] | None = None) -> list[str]:
    """The arguments without what rosrun and roslaunch give to every node.

    :param arguments: None: those of this process.
    """
    given = sys.argv[1:] if arguments is None else arguments
    return [a for a in given if not (a.startswith("__") and ":=" in a)]


def program(status: Callable[[str, Sequence[str]], int]) -> Callable[..., NoReturn]:
    """The program of a package's commands.

    :param status: does a command: of its name and arguments the exit status.
    """

    def run(name: str, arguments: Sequence[str] | None = None) -> NoReturn:
        """Runs a command and ends the process with its status.

        :param name: the command.
        :param arguments: of the command line; None: of this process's.
        """
        end(status(name, command_arguments(arguments)))

    return run


def run_command(program: str, work: Callable[[], CommandResult], as_json: bool, refused: int = REFUSED) -> int:
    """Does the work of a command and prints its answer; what goes wrong is one line on stderr.

    :param refused: the exit status when it is refused.
    :returns: the exit status.
    """
    sys.stdout.reconfigure(errors="replace")  # type: ignore[union-attr]
    try:
        answer = work()
    except Unavailable as error:
        return _fail(program, error, UNAVAILABLE)
    except UsageError as error:
        return _fail(program, error, USAGE)
    except SkirosError as error:
        return _fail(program, error, refused)
    except KeyboardInterrupt:
        return INTERRUPTED
    except BrokenPipeError:  # it prints by itself, and who reads has seen enough
        return OK
    lines = answer.lines
    if as_json and answer.data is not None:
        data = answer.data() if callable(answer.data) else answer.data
        lines = [json.dumps(json_safe(data), ensure_ascii=False, indent=2)]
    try:
        sys.stdout.writelines(f"{line}\n" for line in lines)
    except BrokenPipeError:
        return OK
    return answer.status


def end(status: int) -> NoReturn:
    """Ends the process, also when nobody reads what it has printed."""
    try:
        sys.stdout.flush()
    except BrokenPipeError:  # who reads has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    sys.exit(status)


def _fail(program: str, error: Exception, status: int) -> int:
    """An error, in one line."""
    sys.stderr.write(f"{program}: {' '.join(str(error).split())}\n")
    return status


def screen() -> Screen:
    """What this process prints on."""
    width = shutil.get_terminal_size().columns if sys.stdout.isatty() else None
    try:
        "├".encode(sys.stdout.encoding or "ascii")
    except UnicodeEncodeError:
        return Screen(width, fancy=False)
    return Screen(width)


def user() -> str:
    """Who runs this process."""
    try:
        return getpass.getuser()
    except (KeyError, OSError):
        return "command line"


def json_safe(data: Any) -> Any:
    """The data with texts for infinite numbers and for what is no number, which JSON has not."""
    if isinstance(data, dict):
        return {key: json_safe(value) for key, value in data.items()}
    if isinstance(data, (list, tuple)):
        return [json_safe(value) for value in data]
    return str(data) if isinstance(data, float) and not math.isfinite(data) else data
