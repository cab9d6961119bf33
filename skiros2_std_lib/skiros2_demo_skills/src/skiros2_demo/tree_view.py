"""Plans and trees of running skills as text for a terminal."""

from __future__ import annotations

import json
import shutil
import time
from collections.abc import Callable
from typing import Any, TextIO

from skiros2_common.core.errors import WrongValue

_SUCCESS, _FAILURE, _RUNNING, _IDLE = 1, 2, 3, 4
#: State on the wire -> symbol, word, ANSI colour.
_LOOKS = {
    _SUCCESS: ("✓", "Success", "32"),
    _FAILURE: ("✗", "Failure", "31"),
    _RUNNING: ("▶", "Running", "36"),
    _IDLE: ("·", "Idle", "90"),
}


def plan_lines(plan: str, name: Callable[[str], str]) -> list[str]:
    """A line for each step of a plan.

    :param plan: the task manager's JSON.
    :param name: what a person calls the element with an id.
    :raises WrongValue: the text is no plan.
    """
    try:
        steps = json.loads(plan)["children"]
        return [f"{number}. {_step(step, name)}" for number, step in enumerate(steps, 1)]
    except (ValueError, KeyError, TypeError) as error:
        raise WrongValue(f"the plan cannot be read: {error!r} in {plan!r}") from error


def _step(step: dict[str, Any], name: Callable[[str], str]) -> str:
    facts = []
    for param in step["ph"]:
        shown = [name(v["id"]) if isinstance(v, dict) and "id" in v else str(v) for v in param["values"]]
        if shown and param["key"] != "Robot":
            facts.append(f"{param['key']}: {', '.join(shown)}")
    return f"{step['name']:<8} {'; '.join(facts)}"


def tree_lines(nodes: list[Any], coloured: bool = False) -> list[str]:
    """A line for each node of a `TreeProgress` message, indented as the tree is; the root is left out."""
    depth: dict[int, int] = {}
    lines = []
    for node in nodes:
        depth[node.id] = depth[node.parent_id] + 1 if node.parent_id in depth else -1
        if depth[node.id] < 0:
            continue
        symbol, word, colour = _LOOKS.get(node.state, ("?", str(node.state), "33"))
        name = f"{'   ' * depth[node.id]}{symbol} {node.label or node.type} {node.processor}".rstrip()
        text = f"{name:<36} {word:<8} {_first_line(node.progress_message)}".rstrip()
        lines.append(f"\033[{colour}m{text}\033[0m" if coloured else text)
    return lines


def _first_line(text: str) -> str:
    return text.strip().splitlines()[0] if text.strip() else ""


class TreeView:
    """Shows a tree while it runs: drawn anew in place on a terminal, elsewhere a line for each change of a state.

    :param out: where to.
    :param width: columns; longer lines are cut.
    """

    def __init__(self, out: TextIO, width: int | None = None) -> None:
        self._out = out
        self._live = out.isatty()
        size = shutil.get_terminal_size()
        self._width = width or size.columns
        self._height = size.lines
        self._drawn = 0
        self._states: dict[int, int] = {}
        self._began_at = time.monotonic()

    def show(self, nodes: list[Any]) -> None:
        """Shows the nodes of a `TreeProgress` message."""
        if self._live:
            self._draw(nodes)
        else:
            self._report(nodes)
        self._out.flush()

    def _draw(self, nodes: list[Any]) -> None:
        lines = [_cut(line, self._width) for line in tree_lines(nodes, coloured=True)][-(self._height - 2) :]
        if self._drawn:
            self._out.write(f"\033[{self._drawn}A\033[J")
        self._out.write("".join(line + "\n" for line in lines))
        self._drawn = len(lines)

    def _report(self, nodes: list[Any]) -> None:
        """A node's beginning comes before its children, its end after them."""
        passed = time.monotonic() - self._began_at
        open_nodes: list[tuple[Any, str]] = []
        for node, line in zip(nodes[1:], tree_lines(nodes), strict=True):
            while open_nodes and open_nodes[-1][0].id != node.parent_id:
                self._tell_if_new(*open_nodes.pop(), passed)
            if node.state in (_RUNNING, _IDLE):
                self._tell_if_new(node, line, passed)
            open_nodes.append((node, line))
        for node, line in reversed(open_nodes):
            self._tell_if_new(node, line, passed)

    def _tell_if_new(self, node: Any, line: str, passed: float) -> None:
        if node.state != self._states.get(node.id, _IDLE):
            self._states[node.id] = node.state
            self._out.write(f"{passed:6.1f} s  {line}\n")


def _cut(coloured: str, width: int) -> str:
    """A coloured line of at most `width` columns."""
    head, text = coloured.split("m", 1)
    text = text.removesuffix("\033[0m")
    return f"{head}m{text[: width - 1]}\033[0m"
