"""The commands of `rosrun skiros2_world_model`: their arguments and exit statuses."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any, Protocol

from skiros2_common.command_line.command import (
    OK,
    REFUSED,
    UNAVAILABLE,
    USAGE,
    CommandResult,
    Parser,
    program,
    run_command,
    screen,
    user,
)
from skiros2_common.command_line.completion import Completer, Typed, complete_by
from skiros2_common.command_line.layout import Screen, table
from skiros2_common.command_line.master import check_node
from skiros2_common.core.operations import SCENE
from skiros2_world_model.command_line import reading, writing
from skiros2_world_model.core.report import VIOLATION, Report
from skiros2_world_model.core.world_model_client import WorldModelClient


def connect(name: str, author: str, computing: bool = False) -> WorldModelClient:
    """Connects to a running world model node, without subscribing to its changes.

    :param name: relative to the namespace of this process (`ROS_NAMESPACE`).
    :param author: the author of the changes.
    :param computing: loads the server's reasoners, for relations that they compute.
    :raises Unavailable: the node does not answer within a few seconds.
    """
    import rosgraph  # not there without ROS

    full = rosgraph.names.ns_join(rosgraph.names.get_ros_namespace(), name)
    check_node(full, "get", "world model")
    import rospy  # slow to import, so only after the check

    from skiros2_world_model.ros.ros_transport import RosTransport
    from skiros2_world_model.ros.world_model_interface import load_reasoners

    if rosgraph.names.is_legal_base_name(author):
        rospy.names._set_caller_id(f"/{author}")  # no node is started, but the server logs this name
    if computing:
        load_reasoners(full)
    return WorldModelClient(RosTransport(author, full))


def validate(wm: WorldModelClient, arguments: argparse.Namespace, screen: Screen) -> CommandResult:
    """Validates the current scene against the ontologies and the shapes."""
    report = wm.validate(arguments.context)
    return CommandResult(_lines(report, screen), _json(report), _status(report))


def validate_scene(_wm: None, arguments: argparse.Namespace, screen: Screen) -> CommandResult:
    """Validates scene files without a world model: everything that loading would refuse or warn of, and the shapes."""
    from skiros2_world_model.command_line.scene_file import validate_scene_file  # takes time, and an RDF library

    folders = arguments.ontologies, arguments.workspace
    reports = [validate_scene_file(file, *folders, arguments.context, arguments.strict) for file in arguments.files]
    lines = [line for report in reports for line in _lines(report, screen)]
    return CommandResult(lines, [_json(report) for report in reports], max(map(_status, reports)))


def _status(report: Report) -> int:
    return REFUSED if report.count(VIOLATION) else OK


def _lines(report: Report, screen: Screen) -> list[str]:
    rows = [(f.severity, f.element, f.property, f.text) for f in report.findings]
    lines = table(screen, rows, ("severity", "element", "property", "what")) if rows else []
    return [screen.fitted(f"{report.origin}: {report.summary}"), *lines]


def _json(report: Report) -> dict[str, Any]:
    keys = ("severity", "element", "property", "text")
    findings = [{key: getattr(finding, key) for key in keys} for finding in report.findings]
    return {"validated": report.origin, "violations": report.count(VIOLATION), "findings": findings}


Command = Callable[[Any, argparse.Namespace, Screen], CommandResult]

_TIMES = "A TIME is 14:05, '2026-11-21 14:05', 10m (ago; s, m, h, d), or #NUMBER of a change."
_VALUES = (
    "Values have the type that the ontologies declare. Without a declaration, numbers, true and false are parsed, "
    'and "7" in quotes is text. Put values that begin with - after --.'
)


def status(name: str, given: Sequence[str], cell: Cell | None = None) -> int:
    """Runs a command. Returns its exit status.

    :param given: its arguments.
    :param cell: opens the cell of a command without ROS; None: a world model over ROS.
    """
    command, parser = _parser(name)
    if cell is not None:
        cell.add_arguments(parser)
    parse = parser.parse_intermixed_args if name == "set" else parser.parse_args  # --remove may be anywhere
    arguments = parse(given)

    def work() -> CommandResult:
        if name == "validate_scene" or (name == "diff" and not reading.needs_world_model(arguments)):
            return command(None, arguments, screen())
        author = getattr(arguments, "author", "") or user()
        if cell is None:
            return command(connect(arguments.wm, author), arguments, screen())
        with cell.scene(arguments, author, name not in _WRITING) as wm:
            return command(wm, arguments, screen())

    return run_command(parser.prog, work, arguments.json, USAGE if name in _OF_FILES else REFUSED)


run = program(status)


class Cell(Protocol):
    """A cell in this process."""

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Adds the arguments that name the cell."""

    def scene(
        self, arguments: argparse.Namespace, author: str, reads: bool
    ) -> AbstractContextManager[WorldModelClient]:
        """Opens the cell without its robots. Yields its world model.

        :param reads: whether nothing is changed.
        """


def _parser(name: str) -> tuple[Command, argparse.ArgumentParser]:
    command, epilog = _COMMANDS[name]
    description = (command.__doc__ or "").partition("\n\n")[0]
    parser = Parser(prog=name, description=description, epilog=f"{epilog} {_statuses(name)}".strip())
    group = parser.add_mutually_exclusive_group(required=True) if name == "query" else parser
    for names, options in _ARGUMENTS.get(name, ()):
        action = group.add_argument(*names, **options)
        if names[0] in _COMPLETERS:
            complete_by(action, _COMPLETERS[names[0]])
    parser.add_argument(
        "--context",
        default="" if name == "query" else SCENE,
        metavar="NAME",
        help="the context (default: %(default)s)" if name != "query" else "the context (default: all)",
    )
    parser.add_argument("--json", action="store_true", help="print JSON")
    if name != "validate_scene":
        parser.add_argument("--wm", default="wm", metavar="NAME", help="the world model's node (default: %(default)s)")
    return command, parser


def _statuses(name: str) -> str:
    if name == "validate_scene":
        return "Exit status: 0 no violations, 1 violations, 2 a file cannot be read, or wrong usage."
    results = _RESULTS.get(name, "0 done, 1 refused or not found")
    trouble = "2 trouble" if name == "diff" else "2 wrong usage"
    return f"Exit status: {results}, {trouble}, {UNAVAILABLE} no master or no world model."


def _argument(*names: str, **options: Any) -> tuple[tuple[str, ...], dict[str, Any]]:
    return names, options


def _world_model(typed: Typed) -> WorldModelClient:
    """The world model of a command line that is being typed."""
    return connect(typed.options.get("wm", "wm"), user())


#: By argument.
_COMPLETERS: dict[str, Completer] = {
    "id": lambda typed, begun: reading.element_ids(_world_model(typed), begun),
    "property": lambda typed, _: reading.names_of(_world_model(typed), typed.words[0]),
    "name": lambda typed, _: reading.names_of(_world_model(typed), typed.words[0]),
}

_AUTHOR = _argument("--author", default=user(), metavar="NAME", help="author of the change (default: %(default)s)")

#: The arguments of the commands, beside those that all have.
_ARGUMENTS = {
    "view": [
        _argument("id", nargs="?", default="", help="show only this element and its descendants"),
        _argument("--all", action="store_true", help="all properties, relations and elements"),
    ],
    "get": [
        _argument("id", help="the element"),
        _argument("property", nargs="?", help="only this property or relation, `label` or `type`: a value a line"),
    ],
    "set": [
        _argument("id", help="the element"),
        _argument("name", help="a property, a relation, `label` or `type`"),
        _argument("values", nargs="*", metavar="VALUE", help="its values, or the ids of its objects"),
        _argument("--remove", action="store_true", help="remove these values or relations; without any, all"),
        _AUTHOR,
    ],
    "query": [
        _argument("sparql", nargs="?", help="the query; prefixes need not be declared"),
        _argument("-f", "--file", help="a file with the query"),
    ],
    "load": [
        _argument("file", nargs="?", default="", metavar="FILE",
                  help="in the workspace of the world model (default: the context's own file)"),
        _AUTHOR,
    ],
    "save": [_argument("file", metavar="FILE", help="in the workspace of the world model")],
    "history": [
        _argument("id", nargs="?", default="", help="only changes of this element"),
        _argument("--at", metavar="TIME", help="show the scene or element at that time"),
        _argument("--since", metavar="TIME", help="only changes after that time"),
        _argument("--until", metavar="TIME", help="only changes up to that time"),
        _argument("--author", default="", help="only changes by this author"),
        _argument("--limit", type=int, default=20, metavar="N", help="the last N requests (default: 20; 0: all)"),
        _argument("--all", action="store_true", help="all changes of large requests; with --at, all of the scene"),
    ],
    "diff": [
        _argument("old", metavar="OLD", help="a scene file, or @TIME"),
        _argument("new", nargs="?", default="", metavar="NEW", help="same as OLD (default: the current scene)"),
    ],
    "validate_scene": [
        _argument("files", nargs="+", type=Path, metavar="FILE", help="a scene file"),
        _argument("--workspace", type=Path, metavar="DIR",
                  help="the folder of your ontologies and shapes (default: the file's folder, if it has any)"),
        _argument("--ontologies", type=Path, metavar="DIR", help="base ontologies (default: those of skiros2)"),
        _argument("--strict", action="store_true", help="report unknown names as violations, as with ~strict"),
    ],
}  # fmt: skip

#: Commands that change the world model, or what it knows of its files.
_WRITING = ("set", "load", "save")

#: Commands that read files; their refusals are usage errors.
_OF_FILES = ("diff", "validate_scene")

#: The meaning of the exit statuses 0 and 1, where it is not the usual one.
_RESULTS = {"diff": "0 no difference, 1 differences", "validate": "0 no violations, 1 violations or refused"}

#: For each command: its function, and the epilog of its help.
_COMMANDS: dict[str, tuple[Command, str]] = {
    "view": (reading.view, ""),
    "get": (reading.get, ""),
    "query": (reading.query, ""),
    "set": (writing.set_values, _VALUES),
    "load": (writing.load, ""),
    "save": (writing.save, ""),
    "history": (reading.history, _TIMES),
    "diff": (reading.diff, _TIMES),
    "validate": (validate, ""),
    "validate_scene": (validate_scene, ""),
}
