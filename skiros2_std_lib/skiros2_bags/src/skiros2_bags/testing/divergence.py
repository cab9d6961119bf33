"""Where a replay went another way than the recording, so that one sees why."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from skiros2_bags.core.normal import GROUP_TYPE, PLAIN_ENDS, ROOT_TYPE, Tolerance, same_text
from skiros2_bags.testing.recording import Seen

#: So many lines of what came before are shown.
CONTEXT = 4


@dataclass(frozen=True)
class Divergence:
    """The first difference.

    :param where: time in the bag and tick, or what else tells the moment.
    :param what: the node (its path in the tree), element or step.
    :param expected, got: as recorded, and now.
    :param context: the lines before.
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


def path_of(nodes: Sequence[Seen], place: tuple[int, ...]) -> str:
    """The names of the nodes from the root to one."""
    names = {node.place: node.name for node in nodes}
    return " / ".join(names.get(place[:depth], "?") for depth in range(len(place) + 1))


def first_difference(expected: Sequence[Seen], got: Sequence[Seen], tolerance: Tolerance) -> tuple[int, ...] | None:
    """The place of the node that tells best why two trees differ; None when they do not.

    That is the first one that is another skill; else the lowest that has failed in one of them only; else the first
    that is there in one of them only; else the lowest.
    """
    wanted, found = {n.place: n for n in expected}, {n.place: n for n in got}
    wrong: list[tuple[int, int, tuple[int, ...]]] = []
    for place in {*wanted, *found}:
        one, other = wanted.get(place), found.get(place)
        if one is None or other is None:
            wrong.append((2, len(place), place))
        elif one.type != other.type:
            wrong.append((0, len(place), place))
        elif not same_node(one, other, tolerance):
            one_has_failed = (other.state == "F") != (one.state == "F")
            wrong.append((1 if one_has_failed else 3, -len(place), place))
    return min(wrong)[2] if wrong else None


def same_node(one: Seen, other: Seen, tolerance: Tolerance, *, code: bool = True) -> bool:
    """Whether two nodes were told in the same way.

    :param code: whether their progress codes are compared too; those of steps count ticks.
    """
    if (one.place, one.type, one.processor, one.state) != (other.place, other.type, other.processor, other.state):
        return False
    if one.label != other.label and one.type not in (ROOT_TYPE, GROUP_TYPE):
        return False
    if both_end_plainly(one, other):
        return True
    return (not code or one.code == other.code) and same_text(one.message, other.message, tolerance)


def both_end_plainly(one: Seen, other: Seen) -> bool:
    """Whether both nodes succeeded without a message of their own."""
    return all(n.state == "S" and (n.code, n.message) in PLAIN_ENDS for n in (one, other))


def node_text(node: Seen | None) -> str:
    """A node's state, code and message."""
    if node is None:
        return "no such node"
    words = {"R": "running", "S": "success", "F": "failure", ".": "idle"}
    text = f"{words.get(node.state, node.state)}, code {node.code}"
    return f"{text}: {node.message}" if node.message else text


def _labelled(label: str, text: str) -> list[str]:
    lines = text.splitlines() or [""]
    return [f"  {label}: {lines[0]}", *(" " * 14 + line for line in lines[1:])]
