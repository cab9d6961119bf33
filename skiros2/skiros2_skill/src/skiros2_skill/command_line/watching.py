"""The command that watches tasks."""

from __future__ import annotations

import argparse
import json
import shutil
import sys
from collections.abc import Sequence
from typing import Any, Protocol, TextIO

from skiros2_common.command_line.command import OK, REFUSED, CommandResult, Unavailable, json_safe, screen
from skiros2_common.command_line.layout import Screen
from skiros2_common.core.errors import SkirosError, UnknownName
from skiros2_skill.command_line.connection import Manager
from skiros2_skill.command_line.tree import SUCCESS, Changes, HoldConditions, has_ended, picture, summary, word_of
from skiros2_skill.command_line.world import World

#: A task: the `SkillProgress` of each of its nodes, each before its children, the root first.
Nodes = Sequence[Any]

#: A terminal is drawn anew so often at most (s).
_PERIOD = 0.1


def watch(manager: Manager, arguments: argparse.Namespace, page: Screen) -> CommandResult:
    """Shows what tasks do, as a tree on a terminal, else a line for each change; by default all, until Ctrl-C."""
    holds = Conditions(World(manager.name, manager.author))
    if arguments.once:
        return _picture(_tasks(manager, arguments.task), page, holds)
    from skiros2_skill.command_line.following import Follower, become_node

    become_node("skill_watch")
    follower = Follower(manager)  # before it is asked: no news are lost
    try:
        first = _tasks(manager, arguments.task)
        return _follow(follower, arguments.task, first, _view(manager.name, arguments.json, page, holds))
    finally:
        follower.close()


def _tasks(manager: Manager, task_id: int | None) -> list[Nodes]:
    """The tasks that have not ended: this one, or all."""
    if task_id is None:
        return manager.tasks()
    tasks = manager.tasks(task_id)
    if not tasks:
        raise UnknownName(f"no task {task_id} runs on {manager.name}; why {task_id} may tell its end")
    return tasks


def _picture(tasks: list[Nodes], page: Screen, holds: HoldConditions) -> CommandResult:
    coloured = sys.stdout.isatty()
    lines: list[str] = []
    for nodes in tasks:
        lines += ["", *(line.shown(coloured) for line in picture(page, nodes, holds))]
    return CommandResult(lines[1:] or ["no task runs"], [task_json(nodes) for nodes in tasks])


def _follow(follower: Any, task_id: int | None, news: list[Nodes], view: View) -> CommandResult:
    """Shows what comes, until the task has ended; without one, until Ctrl-C."""
    try:
        while True:
            for nodes in news:
                if task_id in (None, nodes[0].id):
                    view.show(nodes)
            view.draw()
            ended = [nodes for nodes in news if nodes[0].id == task_id and has_ended(nodes)]
            if ended:
                return CommandResult(status=OK if ended[0][0].state == SUCCESS else REFUSED)
            news = follower.news(_PERIOD)
    except KeyboardInterrupt:
        return CommandResult()


def _view(robot: str, as_json: bool, page: Screen, holds: HoldConditions) -> View:
    if as_json:
        return JsonView(sys.stdout)
    if sys.stdout.isatty():
        return LiveView(sys.stdout, holds, idle=f"no task runs on {robot}; Ctrl-C ends")
    return LineView(sys.stdout, page)


class Conditions:
    """The hold-conditions of skills in words, from the world model; none where it does not tell them."""

    def __init__(self, world: World) -> None:
        self._world = world
        self._known: dict[tuple[str, str], list[str]] = {}
        self._is_there = True

    def __call__(self, skill_type: str, label: str) -> list[str]:
        key = (skill_type, label)
        if key not in self._known:
            self._known[key] = self._read(*key) if self._is_there and ":" in skill_type else []
        return self._known[key]

    def _read(self, skill_type: str, label: str) -> list[str]:
        try:
            return [c.text for c in self._world.registered(skill_type, label).conditions["hold"]]
        except Unavailable:
            self._is_there = False
            return []
        except SkirosError:  # a skill that is not offered by itself
            return []


class View(Protocol):
    """Shows tasks on a stream."""

    def show(self, nodes: Nodes) -> None:
        """A task is so now."""

    def draw(self) -> None:
        """Called when all that is new was shown, some times a second."""


class LineView:
    """A line for each change, and for the beginning and the end of each task."""

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
            self._out.write(f"{summary(nodes)}\n")
            del self._changes[root.id]

    def draw(self) -> None:
        self._out.flush()


class JsonView:
    """A line of JSON for each message."""

    def __init__(self, out: TextIO) -> None:
        self._out = out

    def show(self, nodes: Nodes) -> None:
        self._out.write(json.dumps(json_safe(task_json(nodes)), ensure_ascii=False) + "\n")

    def draw(self) -> None:
        self._out.flush()


class LiveView:
    """The trees of all tasks, drawn anew in place on a terminal. Those of tasks that have ended stay above.

    :param idle: stands there while no task runs.
    """

    def __init__(self, out: TextIO, holds: HoldConditions, idle: str = "") -> None:
        self._out = out
        self._holds = holds
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
        return [line.shown(True) for line in picture(screen(), nodes, self._holds, most)]


def task_json(nodes: Nodes) -> dict[str, Any]:
    """A task as JSON has it."""
    root = nodes[0]
    told = [
        {
            "id": node.id,
            "parent": node.parent_id,
            "type": node.type,
            "label": node.label,
            "processor": node.processor,
            "state": word_of(node.state),
            "code": node.progress_code,
            "time": node.progress_time,
            "message": node.progress_message,
        }
        for node in nodes[1:]
    ]
    return {
        "task": root.id,
        "robot": root.robot,
        "state": word_of(root.state),
        "ended": has_ended(nodes),
        "message": root.progress_message,
        "nodes": told,
    }
