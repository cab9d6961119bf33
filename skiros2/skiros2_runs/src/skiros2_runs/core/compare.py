"""Compares task runs: the divergence between two ticks, and between two whole runs.

Allowed differences: ids of tasks and nodes, times; the labels of groups and of the root; the message of a root or
compound that succeeds without its own message; measured numbers in messages, within a tolerance.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

from skiros2_runs.core.frame import NodeProgress
from skiros2_runs.core.history import NodeHistory, NodeReport, node_histories
from skiros2_runs.core.progress import GROUP_TYPE, ROOT_TYPE
from skiros2_runs.core.states import ENDS, FAILURE, RUNNING, SUCCESS, style_of
from skiros2_runs.core.task_run import TaskRun
from skiros2_runs.core.tolerance import Tolerance, same_text

#: Number of state changes to print before a divergence.
CONTEXT = 4

#: Codes and messages with which nodes with children report success.
_DEFAULT_SUCCESS = frozenset({(0, ""), (1, "Success"), (1, "End")})

#: Symbol in the names of processors that run their children in parallel.
_PARALLEL = "|"

#: The nodes of a tree by their child indices from the root.
Nodes = Mapping[tuple[int, ...], NodeProgress]


@dataclass(frozen=True)
class Divergence:
    """The first difference between two runs.

    :param where: time and tick, for people.
    :param what: the node (its path in the tree), element or plan step.
    :param expected, got: the values in the first and in the second run.
    :param context: the state changes before.
    :param time: s since the start of the task; 0.0 if unknown.
    """

    where: str
    what: str
    expected: str
    got: str
    context: tuple[str, ...] = ()
    time: float = 0.0

    def __str__(self) -> str:
        lines = [f"first divergence: {self.where}", f"  {self.what}"]
        for label, text in (("expected: ", self.expected), ("got     : ", self.got)):
            lines += ["  " + label + text.replace("\n", "\n" + " " * 14)]
        if self.context:
            lines += ["  before that:", *(f"    {line}" for line in self.context)]
        return "\n".join(lines)


def path_text(names: tuple[str, ...]) -> str:
    """Formats the names from below the root to a node."""
    return " / ".join(("root", *names))


def report_text(state: int, code: int, message: str) -> str:
    """Formats a node's state, code and message."""
    text = f"{style_of(state).word}, code {code}"
    return f"{text}: {message}" if message else text


# -- one tick ----------------------------------------------------------------------------------------------------------


def first_difference(expected: Nodes, got: Nodes, tolerance_of: Callable[[str], Tolerance]) -> tuple[int, ...] | None:
    """Returns the index path of the most specific node that differs between two trees; None for equal trees.

    In order of priority: the first node with a different skill; the deepest that failed in only one tree; the first
    that exists in only one tree; the deepest.

    :param tolerance_of: returns the tolerance of numbers in the messages of a skill, by its label.
    """
    mismatches: list[tuple[int, int, tuple[int, ...]]] = []
    for index_path in {*expected, *got}:
        one, other = expected.get(index_path), got.get(index_path)
        if one is None or other is None:
            mismatches.append((2, len(index_path), index_path))
        elif one.type != other.type:
            mismatches.append((0, len(index_path), index_path))
        elif not nodes_match(one, other, tolerance_of(one.label)):
            one_failed = (other.state == FAILURE) != (one.state == FAILURE)
            mismatches.append((1 if one_failed else 3, -len(index_path), index_path))
    return min(mismatches)[2] if mismatches else None


def nodes_match(one: NodeProgress, other: NodeProgress, tolerance: Tolerance) -> bool:
    """Whether two nodes report the same progress."""
    if (one.type, one.processor, one.state) != (other.type, other.processor, other.state):
        return False
    if one.label != other.label and one.type not in (ROOT_TYPE, GROUP_TYPE):
        return False
    if _are_default_successes(one, other):
        return True
    return one.code == other.code and same_text(one.message, other.message, tolerance)


def _are_default_successes(*nodes: NodeProgress | NodeReport) -> bool:
    return all(node.state == SUCCESS and (node.code, node.message) in _DEFAULT_SUCCESS for node in nodes)


# -- whole runs --------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _End:
    """The end of a node, or its last report if it did not end.

    :param time: s since the start of the task.
    """

    time: float
    node: NodeHistory
    report: NodeReport

    @property
    def what(self) -> str:
        return path_text(self.node.path)

    def __str__(self) -> str:
        message = f": {self.report.message}" if self.report.message else ""
        return f"{style_of(self.report.state).word}{message}"

    def matches(self, other: _End, tolerance: Tolerance, compares_successes: bool) -> bool:
        one, two = self.report, other.report
        if (self.node.index_path, self.node.path, self.node.type) != (
            other.node.index_path, other.node.path, other.node.type
        ):  # fmt: skip
            return False
        if one.state != two.state:
            return False
        if not compares_successes and one.state != FAILURE:
            return True
        return _are_default_successes(one, two) or same_text(one.message, two.message, tolerance)


def compare_task_runs(
    expected: TaskRun, got: TaskRun, tolerance: Tolerance, compares_successes: bool = False
) -> Divergence | None:
    """Returns the first divergence between the ends of the nodes of two runs; None without one.

    When a node was first seen running depends on timing, and is not compared. The order of ends is compared where the
    tree determines it: below a node that runs its children in parallel, only within each child.

    :param compares_successes: whether the messages of nodes that succeeded are compared, not only those of failures.
    """
    found: list[Divergence] = []
    for one, two in _sequences(_ends(expected), _ends(got)):
        for index in range(max(len(one), len(two))):
            wanted, now = (side[index] if index < len(side) else None for side in (one, two))
            if wanted is not None and now is not None and wanted.matches(now, tolerance, compares_successes):
                continue
            found.append(_divergence(wanted, now, one[max(0, index - CONTEXT) : index]))
            break
    return min(found, key=lambda divergence: divergence.time, default=None)


def _divergence(wanted: _End | None, now: _End | None, before: list[_End]) -> Divergence:
    named = wanted is not None and now is not None and wanted.node.path != now.node.path
    texts = [("nothing more" if e is None else f"{e.what}: {e}" if named else str(e)) for e in (wanted, now)]
    at = wanted or now
    assert at is not None
    context = tuple(f"{end.time:.2f} s: {end.what}: {end}" for end in before)
    return Divergence(f"{at.time:.2f} s after its start", at.what, texts[0], texts[1], context, at.time)


def _ends(run: TaskRun) -> list[_End]:
    """Returns the ends of all nodes in order; within one tick from the leaves to the root."""
    found = []
    for node in node_histories(run).values():
        changes = node.state_changes()
        reports = [r for r in changes if r.state in ENDS or (r is changes[-1] and r.state == RUNNING)]
        found += [_End(report.time - run.start, node, report) for report in reports]
    return sorted(found, key=lambda end: (end.time, -len(end.node.index_path), end.node.index_path))


def _sequences(expected: list[_End], got: list[_End]) -> Iterator[tuple[list[_End], list[_End]]]:
    """Yields the parts of two runs with a determined order: all; with parallel nodes, each node and each branch."""
    ends = [*expected, *got]
    parallel = {end.node.index_path for end in ends if _PARALLEL in end.node.processor}
    if not parallel:
        yield expected, got
        return
    parts: list[Callable[[_End], object]] = [
        lambda end: end.node.index_path,
        lambda end: _branches(end.node.index_path, parallel),
    ]
    for part_of in parts:
        for part in dict.fromkeys(map(part_of, ends)):
            yield [end for end in expected if part_of(end) == part], [end for end in got if part_of(end) == part]


def _branches(path: tuple[int, ...], parallel: set[tuple[int, ...]]) -> tuple[tuple[int, ...], ...]:
    """Returns the children of parallel nodes that contain a node."""
    return tuple(path[: depth + 1] for depth in range(len(path)) if path[:depth] in parallel)
