"""The first difference between a replay and its recording."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from skiros2_bags.core.tolerance import DEFAULT_SUCCESS, GROUP_TYPE, ROOT_TYPE, Tolerance, same_text
from skiros2_bags.testing.recording import NodeProgress

#: Number of recorded state changes to print before a divergence.
CONTEXT = 4


@dataclass(frozen=True)
class Divergence:
    """The first difference.

    :param where: time in the bag and tick.
    :param what: the node (its path in the tree), element or plan step.
    :param expected, got: recorded value and value in the replay.
    :param context: the state changes before.
    """

    where: str
    what: str
    expected: str
    got: str
    context: tuple[str, ...] = ()

    def __str__(self) -> str:
        lines = [f"first divergence: {self.where}", f"  {self.what}"]
        lines += _labelled("expected", self.expected) + _labelled("got     ", self.got)
        if self.context:
            lines += ["  before that:", *(f"    {line}" for line in self.context)]
        return "\n".join(lines)


def path_of(nodes: Sequence[NodeProgress], index_path: tuple[int, ...]) -> str:
    """Returns the names of the nodes from the root to a node, separated by slashes."""
    names = {node.index_path: node.name for node in nodes}
    return " / ".join(names.get(index_path[:depth], "?") for depth in range(len(index_path) + 1))


def first_difference(
    expected: Sequence[NodeProgress], got: Sequence[NodeProgress], tolerance: Tolerance
) -> tuple[int, ...] | None:
    """Returns the index path of the most specific node that differs between two trees; None for equal trees.

    In order of priority: the first node with a different skill; the deepest that failed in only one tree; the first
    that exists in only one tree; the deepest.
    """
    wanted, found = {n.index_path: n for n in expected}, {n.index_path: n for n in got}
    mismatches: list[tuple[int, int, tuple[int, ...]]] = []
    for index_path in {*wanted, *found}:
        one, other = wanted.get(index_path), found.get(index_path)
        if one is None or other is None:
            mismatches.append((2, len(index_path), index_path))
        elif one.type != other.type:
            mismatches.append((0, len(index_path), index_path))
        elif not nodes_match(one, other, tolerance):
            one_failed = (other.state == "F") != (one.state == "F")
            mismatches.append((1 if one_failed else 3, -len(index_path), index_path))
    return min(mismatches)[2] if mismatches else None


def nodes_match(one: NodeProgress, other: NodeProgress, tolerance: Tolerance, *, code: bool = True) -> bool:
    """Whether two nodes report the same progress.

    :param code: whether to compare their progress codes.
    """
    if (one.index_path, one.type, one.processor) != (other.index_path, other.type, other.processor):
        return False
    if one.state != other.state:
        return False
    if one.label != other.label and one.type not in (ROOT_TYPE, GROUP_TYPE):
        return False
    if both_succeed_without_message(one, other):
        return True
    return (not code or one.code == other.code) and same_text(one.message, other.message, tolerance)


def both_succeed_without_message(one: NodeProgress, other: NodeProgress) -> bool:
    """Whether both nodes succeeded with a default message."""
    return all(n.state == "S" and (n.code, n.message) in DEFAULT_SUCCESS for n in (one, other))


def node_text(node: NodeProgress | None) -> str:
    """Formats a node's state, code and message."""
    if node is None:
        return "no such node"
    words = {"R": "running", "S": "success", "F": "failure", ".": "idle"}
    text = f"{words.get(node.state, node.state)}, code {node.code}"
    return f"{text}: {node.message}" if node.message else text


def _labelled(label: str, text: str) -> list[str]:
    lines = text.splitlines() or [""]
    return [f"  {label}: {lines[0]}", *(" " * 14 + line for line in lines[1:])]
