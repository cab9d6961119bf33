"""The commands stop, pause, resume, step, breakpoint and reload."""

from __future__ import annotations

import argparse

from skiros2_common.command_line.command import CommandResult
from skiros2_common.command_line.layout import Screen, table
from skiros2_common.core.errors import Refused, SkirosError
from skiros2_skill.client.manager import ALL, ManagerClient


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
