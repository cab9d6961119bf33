"""The command watch."""

from __future__ import annotations

import argparse
import json
import shutil
import sys
from collections.abc import Sequence
from typing import Any, Protocol, TextIO

from skiros2_common.command_line.command import OK, REFUSED, CommandResult, json_safe, screen
from skiros2_common.command_line.layout import Screen
from skiros2_common.core.errors import UnknownName
from skiros2_runs.core.progress import NodeMessage, has_ended, task_state
from skiros2_runs.core.states import SUCCESS, state_name
from skiros2_skill.client.manager import ManagerClient
from skiros2_skill.command_line.queries import present_stops
from skiros2_skill.command_line.tree import Changes, frame_of, picture, summary

#: A task: the `SkillProgress` of each node, parents before children.
Nodes = Sequence[NodeMessage]

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
    coloured = sys.stdout.isatty()
    lines: list[str] = []
    for nodes in tasks:
        lines += ["", *(line.shown(coloured) for line in picture(page, frame_of(nodes), nodes[0].robot))]
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
    if sys.stdout.isatty():
        return LiveView(sys.stdout, idle=f"no task runs on {robot}; Ctrl-C ends")
    return LineView(sys.stdout, page)


class View(Protocol):
    """Shows tasks on a stream."""

    def show(self, nodes: Nodes) -> None:
        """Adds a message."""

    def draw(self) -> None:
        """Called several times a second, after new messages were added."""


class LineView:
    """One line per change, and per start and end of a task."""

    def __init__(self, out: TextIO, page: Screen) -> None:
        self._out = out
        self._page = page
        self._changes: dict[int, Changes] = {}

    def show(self, nodes: Nodes) -> None:
        root = nodes[0]
        if root.id not in self._changes:
            self._changes[root.id] = Changes(self._page)
            self._out.write(f"task {root.id} on {root.robot}\n")
        which = f"{root.id}: " if len(self._changes) > 1 else ""
        for line in self._changes[root.id].lines(nodes):
            self._out.write(f"{which}{line.text}\n")
        if has_ended(nodes):
            self._out.write(f"{summary(frame_of(nodes), root.robot)}\n")
            del self._changes[root.id]

    def draw(self) -> None:
        self._out.flush()


class JsonView:
    """One line of JSON per message."""

    def __init__(self, out: TextIO) -> None:
        self._out = out

    def show(self, nodes: Nodes) -> None:
        self._out.write(json.dumps(json_safe(task_json(nodes)), ensure_ascii=False) + "\n")

    def draw(self) -> None:
        self._out.flush()


class LiveView:
    """The trees of all tasks, redrawn in place on a terminal. The trees of ended tasks stay above.

    :param idle: shown while no task runs.
    """

    def __init__(self, out: TextIO, idle: str = "") -> None:
        self._out = out
        self._idle = [idle] if idle else []
        self._tasks: dict[int, Nodes] = {}
        self._drawn: list[str] = []

    def show(self, nodes: Nodes) -> None:
        self._tasks[nodes[0].id] = nodes

    def draw(self) -> None:
        ended = [nodes for nodes in self._tasks.values() if has_ended(nodes)]
        for nodes in ended:
            del self._tasks[nodes[0].id]
        height = shutil.get_terminal_size().lines - 1
        most = max(2, height // max(1, len(self._tasks)))
        above = [text for nodes in ended for text in self._picture(nodes, height)]
        live = [text for _, nodes in sorted(self._tasks.items()) for text in self._picture(nodes, most)]
        live = live[-height:] or self._idle
        if above or live != self._drawn:
            back = f"\033[{len(self._drawn)}A\033[J" if self._drawn else ""
            self._out.write(back + "".join(f"{text}\n" for text in [*above, *live]))
            self._drawn = live
        self._out.flush()

    def _picture(self, nodes: Nodes, most: int) -> list[str]:
        return [line.shown(True) for line in picture(screen(), frame_of(nodes), nodes[0].robot, most)]


def task_json(nodes: Nodes) -> dict[str, Any]:
    """Converts a task to JSON data."""
    root = nodes[0]
    children = [
        {
            "id": node.id,
            "parent": node.parent_id,
            "type": node.type,
            "label": node.label,
            "processor": node.processor,
            "state": state_name(node.state),
            "code": node.progress_code,
            "time": node.progress_time,
            "message": node.progress_message,
        }
        for node in nodes[1:]
    ]
    return {
        "task": root.id,
        "robot": root.robot,
        "state": state_name(root.state),
        "status": task_state(root),
        "ended": has_ended(nodes),
        "message": root.progress_message,
        "nodes": children,
    }
