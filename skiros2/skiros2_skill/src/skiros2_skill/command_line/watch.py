"""The command watch."""

from __future__ import annotations

import argparse
import sys
from typing import TYPE_CHECKING, Any

from skiros2_common.command_line.command import OK, REFUSED, CommandResult
from skiros2_common.command_line.layout import Screen
from skiros2_common.core.errors import UnknownName
from skiros2_runs.core.progress import has_ended
from skiros2_runs.core.states import SUCCESS
from skiros2_skill.command_line.queries import present_stops
from skiros2_skill.command_line.tree import frame_of, picture
from skiros2_skill.command_line.views import JsonView, Nodes, View, task_json, view_of

if TYPE_CHECKING:
    from skiros2_skill.client.manager import ManagerClient

#: Minimum time between redraws of a terminal (s).
_PERIOD = 0.1


def watch(manager: ManagerClient, arguments: argparse.Namespace, page: Screen) -> CommandResult:
    """Shows tasks: a live tree on a terminal, otherwise one line per change; by default all tasks, until Ctrl-C."""
    if arguments.once:
        shown = _picture(_tasks(manager, arguments.task), page)
        return CommandResult([*present_stops(manager), *shown.lines], shown.data)
    from skiros2_skill.command_line.connection import TaskMonitor, become_node

    become_node("skill_watch")
    monitor = TaskMonitor(manager)  # before the query, so that no message is lost
    try:
        first = _tasks(manager, arguments.task)
        return _show_until_end(monitor, arguments.task, first, _view(manager.name, arguments.json, page))
    finally:
        monitor.close()


def _tasks(manager: ManagerClient, task_id: int | None) -> list[Nodes]:
    """The tasks that have not ended: one, or all."""
    if task_id is None:
        return manager.read_tasks()
    tasks = manager.read_tasks(task_id)
    if not tasks:
        raise UnknownName(f"no task {task_id} runs on {manager.name}; it may have ended, see why {task_id}")
    return tasks


def _picture(tasks: list[Nodes], page: Screen) -> CommandResult:
    lines: list[str] = []
    for nodes in tasks:
        lines += ["", *(line.shown(sys.stdout) for line in picture(page, frame_of(nodes), nodes[0].robot))]
    return CommandResult(lines[1:] or ["no task runs"], [task_json(nodes) for nodes in tasks])


def _show_until_end(monitor: Any, task_id: int | None, messages: list[Nodes], view: View) -> CommandResult:
    """Shows messages until the task has ended; without `task_id`, until Ctrl-C."""
    try:
        while True:
            for nodes in messages:
                if task_id in (None, nodes[0].id):
                    view.show(nodes)
            view.draw()
            ended = [nodes for nodes in messages if nodes[0].id == task_id and has_ended(nodes)]
            if ended:
                return CommandResult(status=OK if ended[0][0].state == SUCCESS else REFUSED)
            messages = monitor.receive(_PERIOD)
    except KeyboardInterrupt:
        return CommandResult()


def _view(robot: str, as_json: bool, page: Screen) -> View:
    if as_json:
        return JsonView(sys.stdout)
    return view_of(sys.stdout, page, idle=f"no task runs on {robot}; Ctrl-C ends")
