"""The commands stop, pause, resume, step, breakpoint and reload."""

from __future__ import annotations

import argparse

from skiros2_common.command_line.command import CommandResult
from skiros2_common.command_line.layout import Screen, table
from skiros2_common.core.errors import Refused, SkirosError
from skiros2_skill.command_line.connection import Manager

_ALL = -1


def stop(manager: Manager, arguments: argparse.Namespace, screen: Screen) -> CommandResult:
    """Preempts a task, or all tasks."""
    return _result(manager.command("preempt", _or_all(arguments.task)), "being preempted")


def pause(manager: Manager, arguments: argparse.Namespace, screen: Screen) -> CommandResult:
    """Pauses a task, or all tasks."""
    return _result(manager.command("pause", _or_all(arguments.task)), "paused")


def resume(manager: Manager, arguments: argparse.Namespace, screen: Screen) -> CommandResult:
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


def step(manager: Manager, arguments: argparse.Namespace, screen: Screen) -> CommandResult:
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


def reload(manager: Manager, arguments: argparse.Namespace, screen: Screen) -> CommandResult:
    """Reloads skill libraries with their present source. Running tasks keep the old code."""
    text = manager.reload(arguments.libraries)
    return CommandResult([f"{manager.name}: {text}"], {"robot": manager.name, "text": text})


def _result(task_id: int, done: str) -> CommandResult:
    lines = [f"all tasks are {done}" if task_id == _ALL else f"task {task_id} is {done}"]
    return CommandResult(lines, {"tasks": "all" if task_id == _ALL else [task_id]})


def _or_all(task_id: int | None) -> int:
    return _ALL if task_id is None else task_id


def _task_ids(manager: Manager) -> list[int]:
    """The ids of the tasks that have not ended."""
    return [nodes[0].id for nodes in manager.tasks()]


def breakpoint_(manager: Manager, arguments: argparse.Namespace, screen: Screen) -> CommandResult:
    """Lists, adds or removes breakpoints, at which tasks pause."""
    action = arguments.action or "list"
    if action == "add":
        number, known = manager.breakpoint("add", arguments.kind, arguments.pattern, arguments.when or "")
        added = next(b for b in known if b["number"] == number)
        return CommandResult([f"breakpoint {number}: {added['kind']} {added['pattern']} {added['when']}"], added)
    if action == "remove":
        number = _ALL if arguments.number == "all" else int(arguments.number)
        manager.breakpoint("remove", number=number)
        text = "all breakpoints are removed" if number == _ALL else f"breakpoint {number} is removed"
        return CommandResult([text], {"number": number})
    _, known = manager.breakpoint("list")
    rows = [(str(b["number"]), b["kind"], b["pattern"], b["when"]) for b in known]
    lines = table(screen, rows, ("number", "kind", "pattern", "when")) if rows else ["no breakpoints"]
    return CommandResult(lines, known)
