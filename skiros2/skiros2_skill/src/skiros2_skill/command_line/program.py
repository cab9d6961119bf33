"""The commands of `rosrun skiros2_skill`: arguments, exit statuses, and the commands that control tasks."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from typing import TYPE_CHECKING, Any, Protocol

from skiros2_common.command_line.command import UNAVAILABLE, CommandResult, Parser, program, run_command, screen, user
from skiros2_common.command_line.completion import Typed, complete_by
from skiros2_common.command_line.layout import Screen, table
from skiros2_common.core.errors import Refused, SkirosError
from skiros2_skill.client.port import ALL, ManagerPort
from skiros2_skill.command_line import completers, queries, run_skills, watch
from skiros2_skill.command_line.connection import connect, registered_managers

if TYPE_CHECKING:
    from skiros2_skill.client.manager import ManagerClient


def stop(manager: ManagerClient, arguments: argparse.Namespace, screen: Screen) -> CommandResult:
    """Preempts a task, or all tasks."""
    return _result(manager.command("preempt", _or_all(arguments.task)), "being preempted")


def pause(manager: ManagerClient, arguments: argparse.Namespace, screen: Screen) -> CommandResult:
    """Pauses a task, or all tasks."""
    return _result(manager.command("pause", _or_all(arguments.task)), "paused")


def resume(manager: ManagerClient, arguments: argparse.Namespace, screen: Screen) -> CommandResult:
    """Resumes a paused task, or all paused tasks."""
    resumed = []
    refusals = []
    for task_id in _task_ids(manager) if arguments.task is None else [arguments.task]:
        try:
            resumed.append(manager.command("start", task_id))
        except SkirosError as error:  # it is running, or has ended meanwhile
            refusals.append(str(error))
    if not resumed:
        raise Refused("; ".join(refusals) or "no task is paused")
    return CommandResult([f"task {task_id} is resumed" for task_id in resumed], {"tasks": resumed})


def step(manager: ManagerClient, arguments: argparse.Namespace, screen: Screen) -> CommandResult:
    """Ticks a paused task once, by default the only task."""
    task_id = arguments.task
    if task_id is None:
        tasks = _task_ids(manager)
        if len(tasks) != 1:
            problem = f"there are {len(tasks)} tasks ({', '.join(map(str, tasks))}): name one"
            raise Refused(problem if tasks else "no task runs")
        task_id = tasks[0]
    manager.command("tick_once", task_id)
    return CommandResult([f"task {task_id} was ticked once"], {"tasks": [task_id]})


def reload(manager: ManagerClient, arguments: argparse.Namespace, screen: Screen) -> CommandResult:
    """Reloads skill libraries with their present source. Running tasks keep the old code."""
    text = manager.reload(arguments.libraries)
    return CommandResult([f"{manager.name}: {text}"], {"robot": manager.name, "text": text})


def _result(task_id: int, done: str) -> CommandResult:
    lines = [f"all tasks are {done}" if task_id == ALL else f"task {task_id} is {done}"]
    return CommandResult(lines, {"tasks": "all" if task_id == ALL else [task_id]})


def _or_all(task_id: int | None) -> int:
    return ALL if task_id is None else task_id


def _task_ids(manager: ManagerClient) -> list[int]:
    """The ids of the tasks that have not ended."""
    return [nodes[0].id for nodes in manager.read_tasks()]


def breakpoint_(manager: ManagerClient, arguments: argparse.Namespace, screen: Screen) -> CommandResult:
    """Lists, adds or removes breakpoints, at which tasks pause."""
    if arguments.action == "remove":
        number = ALL if arguments.number == "all" else int(arguments.number)
        manager.remove_breakpoint(number)
        text = "all breakpoints are removed" if number == ALL else f"breakpoint {number} is removed"
        return CommandResult([text], {"number": number})
    if arguments.action == "add":
        number = manager.set_breakpoint(arguments.kind, arguments.pattern, arguments.when or "")
        added = manager.breakpoints()[number]
        return CommandResult([f"breakpoint {number}: {added}"], {"number": number, **vars(added)})
    known = manager.breakpoints()
    rows = [(str(number), b.kind, b.pattern, b.when) for number, b in known.items()]
    lines = table(screen, rows, ("number", "kind", "pattern", "when")) if rows else ["no breakpoints"]
    return CommandResult(lines, [{"number": number, **vars(b)} for number, b in known.items()])


def safety(manager: ManagerClient, arguments: argparse.Namespace, screen: Screen) -> CommandResult:
    """Shows whether the robot is stopped, and why. This is not a safety-rated function."""
    status = manager.safety()
    known = {"state": status.state, "source": status.source, "reason": status.reason, "stops": list(status.stops)}
    lines = queries.stop_lines(manager.name, status) or [f"{manager.name} is not stopped"]
    return CommandResult(lines, {"robot": manager.name, **known, "since": status.since.to_sec()})


Command = Callable[[Any, argparse.Namespace, Screen], CommandResult]

_VALUES = (
    "A VALUE is of the type that the skill declares: an element by its id or label, a list or dict in JSON, several "
    "values as a JSON list. More skills with their values may follow; they run in sequence."
)
_BREAKPOINTS = (
    "A PATTERN is the label or type of a node, the label of a condition, or the id or label of an element or a "
    "relation of the world model, with wildcards * and ?. Resume or step continues a paused task."
)


def status(name: str, given: Sequence[str], cell: Cell | None = None) -> int:
    """Runs a command. Returns its exit status.

    :param given: its arguments.
    :param cell: opens the cell of a command without ROS; None: a manager over ROS.
    """
    command, parser = _parser(name)
    if cell is not None:
        cell.add_arguments(parser)
    # With words, options may stand anywhere.
    arguments = (parser.parse_intermixed_args if name in ("run", "preview") else parser.parse_args)(given)

    def work() -> CommandResult:
        if cell is None:
            return command(connect(arguments.robot, arguments.author), arguments, screen())
        with cell.manager(arguments, reads=name != "run") as manager:
            return command(manager, arguments, screen())

    return run_command(parser.prog, work, arguments.json)


run = program(status)


class Cell(Protocol):
    """A cell in this process."""

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Adds the arguments that name the cell."""

    def manager(self, arguments: argparse.Namespace, reads: bool) -> AbstractContextManager[ManagerPort]:
        """Opens the cell, and yields the manager of its robot, or of the one with the name `arguments.robot`.

        :param reads: whether no skill is started.
        """


def _parser(name: str) -> tuple[Command, argparse.ArgumentParser]:
    command, add_arguments, *epilog = _COMMANDS[name]
    result = _RESULTS.get(name, _RESULT)
    statuses = f"Exit status: {result}, 2 wrong usage, {UNAVAILABLE} no master or no skill manager."
    parser = Parser(prog=name, description=command.__doc__, epilog=" ".join([*epilog, statuses]))
    add_arguments(parser)
    robot = parser.add_argument("--robot", default="", metavar="NAME", help="the skill manager, if there are several")
    complete_by(robot, lambda typed, _: registered_managers())
    parser.add_argument("--author", default=user(), metavar="NAME", help="author of commands (default: %(default)s)")
    parser.add_argument("--json", action="store_true", help="print JSON")
    return command, parser


def _manager(typed: Typed) -> ManagerClient:
    """The manager of a command line that is being typed."""
    return connect(typed.options.get("robot", ""), user())


def _nothing(parser: argparse.ArgumentParser) -> None:
    """Adds no arguments."""


def _skill(parser: argparse.ArgumentParser) -> None:
    skill = parser.add_argument("skill", metavar="SKILL", help="the label of an implementation, or a type")
    complete_by(skill, lambda typed, _: completers.skill_names(_manager(typed)))


def _task(parser: argparse.ArgumentParser) -> None:
    task = parser.add_argument("task", metavar="TASK", nargs="?", type=_task_id, help="its number")
    complete_by(task, lambda typed, _: completers.task_numbers(_manager(typed)))


def _libraries(parser: argparse.ArgumentParser) -> None:
    help_text = "a library that the manager has loaded (default: all)"
    parser.add_argument("libraries", metavar="LIBRARY", nargs="*", help=help_text)


def _words(parser: argparse.ArgumentParser) -> None:
    parser.usage = "%(prog)s [OPTION ...] SKILL [KEY=VALUE ...] [SKILL [KEY=VALUE ...] ...]"
    text = "the skills to run, with parameters"
    words = parser.add_argument("words", metavar="SKILL KEY=VALUE", nargs="+", help=text)
    complete_by(words, lambda typed, current: completers.step_words(_manager(typed), typed, current))


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
    number = removing.add_argument("number", metavar="NUMBER", type=_number_or_all, help="its number, or all")
    complete_by(number, lambda typed, _: [*map(str, _manager(typed).breakpoints()), "all"])


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
    "stop": (stop, _task),
    "pause": (pause, _task),
    "resume": (resume, _task),
    "step": (step, _task),
    "breakpoint": (breakpoint_, _breakpoint, _BREAKPOINTS),
    "watch": (watch.watch, _watch),
    "reload": (reload, _libraries),
    "safety": (safety, _nothing),
}
