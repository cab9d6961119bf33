"""The final failures of a task: those that must not be retried. See `FailureKind`.

After one, no skill of the task starts any more, except reactions such as a retreat; running skills continue. The task
fails, whatever its processors make of the failure.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from skiros2_common.core.errors import UnknownName
from skiros2_common.core.explanation import START
from skiros2_common.core.failure_kind import FailureKind
from skiros2_skill.core.engine.failures import NOT_RETRIED, Failure
from skiros2_skill.core.engine.skill_run import Node, SkillNode, SkillRun


@dataclass(frozen=True)
class FinalFailure:
    """A final failure of a node."""

    node: Node
    kind: FailureKind

    @property
    def text(self) -> str:
        """Why no skill starts after it, for people, as a main clause."""
        return f"{self.node.display_name} has failed and must not be retried: {self.kind.words}"


class FinalFailures:
    """For the thread that ticks the task.

    A reaction is a scope of its own: its children start in spite of earlier failures, until one of them fails.
    """

    def __init__(self) -> None:
        self._failures: dict[Node | None, list[FinalFailure]] = {}  # by scope: a reaction; None: the task
        self._reactions: set[Node] = set()

    def __bool__(self) -> bool:
        return bool(self._failures)

    def note(self, run: SkillRun) -> None:
        """Notes the failure of a run if it is final. That of a compound is the one of its children."""
        run.failure_kind = run.failure_kind.worst(run.instance.failure_kind)
        of_children = self.below(run.node)
        if run.failure_kind.severity > of_children.severity:
            self._add(run.node, run.failure_kind)
        run.failure_kind = run.failure_kind.worst(of_children)

    def _add(self, node: Node, kind: FailureKind) -> None:
        failure, above = FinalFailure(node, kind), node.parent
        while above is not None:
            if above in self._reactions:
                self._failures.setdefault(above, []).append(failure)
            above = above.parent
        self._failures.setdefault(None, []).append(failure)

    def below(self, node: Node) -> FailureKind:
        """The most severe kind of the failures in the subtree of a node; `RETRYABLE` without any."""
        kind = FailureKind.RETRYABLE
        for failure in self._failures.get(None, ()):
            if failure.node.inSubtreeOf(node):
                kind = kind.worst(failure.kind)
        return kind

    def refusal(self, node: SkillNode) -> Failure | None:
        """Returns the failure of a node that must not start; None if it may."""
        if not self._failures:
            return None
        may_react = is_reaction(node)
        failures = self._failures.get(self._scope(node.parent if may_react else node), [])
        if may_react and not any(failure.node.inSubtreeOf(node) for failure in failures):  # no second try
            failures = [failure for failure in failures if not failure.kind.allows_reaction]
            if not failures:
                self.begin_reaction(node)
        if not failures:
            return None
        return Failure(START, NOT_RETRIED, f"Not started: {failures[0].text}", secondary=True, kind=failures[0].kind)

    def forbids_reaction(self) -> FinalFailure | None:
        """Returns a failure of the task after which not even reactions may start; None without any."""
        return next((f for f in self._failures.get(None, ()) if not f.kind.allows_reaction), None)

    def begin_reaction(self, node: Node) -> None:
        """Lets a node and its children start in spite of the failures so far."""
        self._reactions.add(node)
        self._failures.pop(node, None)

    def _scope(self, node: Node | None) -> Node | None:
        while node is not None and node not in self._reactions:
            node = node.parent
        return node


def is_reaction(node: SkillNode) -> bool:
    """Whether the skill of a node is declared to be a reaction."""
    try:
        return all(implementation.declared.is_reaction for implementation in node.candidates())
    except UnknownName:
        return False  # its start reports that


def is_active(runs: Mapping[Node, SkillRun]) -> bool:
    """Whether a skill runs, not only compounds whose processors wait or retry."""
    return any(run.implementation.runs_after_children or not run.node.children for run in runs.values())
