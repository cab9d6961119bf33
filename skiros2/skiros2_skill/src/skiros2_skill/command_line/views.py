"""Views of running tasks on a stream: lines, a live tree, or JSON."""

from __future__ import annotations

import json
import shutil
from collections.abc import Sequence
from typing import Any, Protocol, TextIO

from skiros2_common.command_line.command import json_safe, screen
from skiros2_common.command_line.layout import Screen, can_redraw
from skiros2_runs.core.progress import NodeMessage, has_ended, task_state
from skiros2_runs.core.states import state_name
from skiros2_skill.command_line.tree import Changes, frame_of, picture, summary

#: A task: the `SkillProgress` of each node, parents before children.
Nodes = Sequence[NodeMessage]


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


def view_of(out: TextIO, page: Screen, idle: str = "") -> View:
    """Returns a live view of a terminal that can redraw lines, otherwise a view of lines.

    :param idle: shown by a live view while no task runs.
    """
    return LiveView(out, idle) if can_redraw(out) else LineView(out, page)


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
        return [line.shown(self._out) for line in picture(screen(), frame_of(nodes), nodes[0].robot, most)]


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
