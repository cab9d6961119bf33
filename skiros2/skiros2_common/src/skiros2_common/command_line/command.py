"""The frame of all command-line programs: arguments, usage errors, result, output and exit status."""

from __future__ import annotations

import argparse
import getpass
import json
import logging
import math
import os
import select
import shutil
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any, NoReturn

from skiros2_common import __version__
from skiros2_common.command_line.completion import VARIABLE, print_completions
from skiros2_common.command_line.layout import Screen
from skiros2_common.core.errors import SkirosError

#: What --version prints.
VERSION = f"SkiROS2 {__version__}"
#: Exit statuses.
OK, REFUSED, USAGE, UNAVAILABLE = 0, 1, 2, 3
#: Exit status of a command that Ctrl-C interrupted.
INTERRUPTED = 130


class UsageError(SkirosError):
    """The arguments are wrong in every state of the system."""

    status = USAGE


class Unavailable(SkirosError):
    """The master or the requested node is not running."""

    status = UNAVAILABLE


@contextmanager
def quiet(level: int, *packages: str) -> Iterator[None]:
    """Logs of some packages only what is at least as severe as a level of `logging`."""
    loggers = [logging.getLogger(package) for package in packages]
    levels = [logger.level for logger in loggers]
    for logger in loggers:
        logger.setLevel(level)
    try:
        yield
    finally:
        for logger, before in zip(loggers, levels, strict=True):
            logger.setLevel(before)


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
    """A parser of arguments that has --version, reports wrong usage in one line, and completes command lines."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self.add_argument("--version", action="version", version=VERSION)

    def parse_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Same as `argparse`; ends the process if a shell asks for completions."""
        self._complete(args)
        return super().parse_args(args, namespace)

    def parse_intermixed_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Same as `argparse`; ends the process if a shell asks for completions."""
        self._complete(args)
        return super().parse_intermixed_args(args, namespace)

    def _complete(self, given: Sequence[str] | None) -> None:
        if VARIABLE in os.environ:
            print_completions(self, sys.argv[1:] if given is None else given)
            end(OK)

    def error(self, message: str) -> NoReturn:
        """Reports a usage error in one line."""
        self.exit(USAGE, f"{self.prog}: {message}; see {self.prog} --help\n")


def command_arguments(arguments: Sequence[str] | None = None) -> list[str]:
    """The arguments without those that rosrun and roslaunch append.

    :param arguments: None: those of this process.
    """
    passed = sys.argv[1:] if arguments is None else arguments
    return [a for a in passed if not (a.startswith("__") and ":=" in a)]


def program(status: Callable[[str, Sequence[str]], int]) -> Callable[..., NoReturn]:
    """The program of a package's commands.

    :param status: runs a command, given its name and arguments, and returns the exit status.
    """

    def run(name: str, arguments: Sequence[str] | None = None) -> NoReturn:
        """Runs a command and ends the process with its exit status.

        :param name: the command.
        :param arguments: of the command line; None: those of this process.
        """
        end(status(name, command_arguments(arguments)))

    return run


def run_command(program: str, work: Callable[[], CommandResult], as_json: bool, refused: int = REFUSED) -> int:
    """Runs a command and prints its result, or an error on stderr: in one line, or in one for each of its `texts`.

    :param refused: the exit status for a refused command.
    :returns: the exit status.
    """
    sys.stdout.reconfigure(errors="replace")  # type: ignore[union-attr]
    try:
        result = work()
    except SkirosError as error:
        for text in getattr(error, "texts", (str(error),)):
            sys.stderr.write(f"{program}: {' '.join(text.split())}\n")
        return getattr(error, "status", refused)
    except KeyboardInterrupt:
        return INTERRUPTED
    except BrokenPipeError:
        if _has_reader():
            raise
        return OK  # a command that prints itself
    lines = result.lines
    if as_json and result.data is not None:
        data = result.data() if callable(result.data) else result.data
        lines = [json.dumps(json_safe(data), ensure_ascii=False, indent=2)]
    try:
        sys.stdout.writelines(f"{line}\n" for line in lines)
    except BrokenPipeError:
        return OK
    return result.status


def _has_reader() -> bool:
    """Whether stdout is still read: the pipe is not closed."""
    poll = select.poll()
    poll.register(sys.stdout.fileno(), 0)
    return not any(event & select.POLLERR for _, event in poll.poll(0))


def end(status: int) -> NoReturn:
    """Ends the process, even if the reader of its output has closed the pipe."""
    try:
        sys.stdout.flush()
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    sys.exit(status)


def screen() -> Screen:
    """The screen of this process."""
    width = shutil.get_terminal_size().columns if sys.stdout.isatty() else None
    try:
        "├".encode(sys.stdout.encoding or "ascii")
    except UnicodeEncodeError:
        return Screen(width, fancy=False)
    return Screen(width)


def user() -> str:
    """The name of the user of this process."""
    try:
        return getpass.getuser()
    except (KeyError, OSError):
        return "command line"


def json_safe(data: Any) -> Any:
    """The data with strings for infinity and NaN, which JSON lacks."""
    if isinstance(data, dict):
        return {key: json_safe(value) for key, value in data.items()}
    if isinstance(data, (list, tuple)):
        return [json_safe(value) for value in data]
    return str(data) if isinstance(data, float) and not math.isfinite(data) else data
