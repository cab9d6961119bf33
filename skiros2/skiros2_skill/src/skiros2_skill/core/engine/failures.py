"""The failures of a task, with their explanations: unsatisfied conditions, exceptions, refusals.

A failure is recorded as plain data. Its `Explanation`, which needs queries of the world model, is only made when the
failure differs from the node's last one: a node of a reactive tree may fail at every tick.
"""

from __future__ import annotations

import logging
import re
import threading
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from skiros2_common.core.abstract_skill import State
from skiros2_common.core.condition import ConditionBase
from skiros2_common.core.errors import FOREIGN_ERRORS, SkirosError
from skiros2_common.core.explanation import (
    EXCEPTION,
    HOLD,
    POST,
    PRE,
    Explanation,
    Finding,
    InferenceFailure,
    Provenance,
)
from skiros2_common.core.failure_kind import FailureKind
from skiros2_common.core.names import SCENE_ROOT, local_name
from skiros2_common.core.params import ParamHandler
from skiros2_common.core.source_location import format_error
from skiros2_common.core.wording import ids_in
from skiros2_common.core.world_element import Element
from skiros2_common.core.world_model_port import WorldModelPort
from skiros2_runs.core.values import FAILS, HOLDS, ConditionStatus
from skiros2_skill.core.engine.skill_run import Node
from skiros2_skill.core.engine.slot import provenance_of

log = logging.getLogger(__name__)

#: How many failures of a task are kept.
MAX_FAILURES = 100

PRE_FAILED, HOLD_FAILED, POST_FAILED = -1, -2, -3
#: Of a skill that does not start after a final failure.
NOT_RETRIED = -6
START_RAISED, EXECUTE_RAISED, PREEMPT_RAISED = -404, -405, -406

#: Numbers in messages, which may differ from tick to tick: such failures are of one kind.
_NUMBER = re.compile(r"\d+(?:\.\d+)?(?:e[+-]?\d+)?")


@dataclass
class Failure:
    """A failure of a node, not explained yet.

    :param stage, code, message: see `Explanation`.
    :param label: of the implementation; "" for that of the node.
    :param conditions: the unsatisfied conditions.
    :param params: the parameters they were evaluated with.
    :param provenance: returns the provenance of the parameters; None: that of the node's.
    :param tried: the failures of the rejected implementations.
    :param secondary: the node had failed or ended before: this is not the cause.
    :param by, running: see `Explanation`.
    :param kind: whether the skill may be tried again.
    """

    stage: str
    code: int
    message: str
    label: str = ""
    conditions: Sequence[ConditionBase] = ()
    params: ParamHandler = field(default_factory=ParamHandler)
    candidates: list[InferenceFailure] = field(default_factory=list)
    provenance: Callable[[], list[Provenance]] | None = None
    tried: Sequence[Failure] = ()
    secondary: bool = False
    by: str = ""
    running: list[str] = field(default_factory=list)
    kind: FailureKind = FailureKind.RETRYABLE


@dataclass
class _Entry:
    """:param pending: the last failure, if its message differs from the explained one in numbers."""

    node: Node
    explanation: Explanation
    secondary: bool
    pending: Failure | None = None

    @property
    def is_final(self) -> bool:
        return self.explanation.failure_kind.is_final


class Failures:
    """The failures of one task, recorded by the thread that ticks it and read by any thread.

    :param wmi: the world model as the task sees it.
    """

    def __init__(self, wmi: WorldModelPort) -> None:
        self._wmi = wmi
        self._entries: dict[tuple[Any, ...], _Entry] = {}  # by kind; the last failure is the last entry
        self._lock = threading.Lock()

    def record(self, node: Node, failure: Failure) -> None:
        """Records a failure; a repetition, whose message differs at most in numbers, increments the count."""
        text = _NUMBER.sub("#", failure.message)
        key = (_child_indices(node), failure.label, failure.stage, failure.code, failure.kind, text)
        known = self._entries.get(key)
        if known is None:
            entry = _Entry(node, self._explained(node, failure), failure.secondary)
        else:
            times, pending = known.explanation.times + 1, known.pending
            if known.explanation.message != failure.message:
                pending = failure  # explained when somebody asks: the number may change in each tick
            explanation = replace(known.explanation, message=failure.message, times=times)
            entry = _Entry(node, explanation, failure.secondary, pending)
        with self._lock:
            self._entries.pop(key, None)
            self._entries[key] = entry
            if len(self._entries) > MAX_FAILURES:
                del self._entries[next(iter(self._entries))]

    def explanations(self) -> list[Explanation]:
        """The explanations, ordered by the last occurrence of each failure; that of the root's failure is the last."""
        self.settle()
        with self._lock:
            entries = list(self._entries.values())
            cause = self._cause_entry()
        entries.sort(key=lambda entry: entry is cause)
        return [replace(entry.explanation, node=entry.node.id) for entry in entries]

    def settle(self) -> None:
        """Explains the last failures in full, while the nodes still have the values that they failed with."""
        with self._lock:
            pending = [(entry, entry.pending) for entry in self._entries.values() if entry.pending is not None]
        for entry, failure in pending:
            explanation = self._explained(entry.node, failure)
            entry.explanation, entry.pending = replace(explanation, times=entry.explanation.times), None

    def cause(self) -> tuple[Node, Explanation] | None:
        """The node that made the root fail, and the explanation; None when no node failed."""
        entry = self._cause_entry()
        return (entry.node, entry.explanation) if entry is not None else None

    def _cause_entry(self) -> _Entry | None:
        """The last failure with failed ancestors only; that of the root, which was ended from outside, or the first
        final one takes precedence."""
        entries = self._causes()
        failed = [e for e in entries if all(node.state is State.Failure for node in _path(e.node))]
        last = failed[0] if failed else None
        if last is not None and last.node.parent is None:
            return last
        return next((entry for entry in reversed(entries) if entry.is_final), last)

    def cause_below(self, node: Node) -> tuple[str, int] | None:
        """The message (one line) and the code of the failure that made a compound fail: the first final one, or the
        last one."""
        entries = [e for e in self._causes() if e.node.state is State.Failure and e.node.inSubtreeOf(node)]
        entry = next((entry for entry in reversed(entries) if entry.is_final), entries[0] if entries else None)
        if entry is None:
            return None
        text = entry.explanation.message.strip().partition("\n")[0]
        return f"{entry.node.label or entry.node.type}: {text}", min(entry.explanation.code, -1)

    def _causes(self) -> list[_Entry]:
        """The failures that do not follow from others, the last first."""
        return [entry for entry in reversed(self._entries.values()) if not entry.secondary]

    def _explained(self, node: Node, failure: Failure) -> Explanation:
        path = [n.display_name for n in _path(node) if n.parent is not None or n is node]
        explanation = self._explanation(node, failure, path)
        held = [v for params in (failure.params, node.present_params) for p in params.values() for v in p.values]
        if node.run is not None:
            held += [v for slot in node.run.slots for v in slot.ignored or ()]  # elements that were removed
        return with_labels(explanation, self._wmi, (value for value in held if isinstance(value, Element)))

    def _explanation(self, node: Node, failure: Failure, path: list[str]) -> Explanation:
        return Explanation(
            failure.stage,
            node.type,
            failure.label or node.label,
            node.id,
            failure.code,
            failure.message,
            path,
            self._findings(failure),
            failure.candidates,
            failure.provenance() if failure.provenance is not None else _provenance(node),
            [self._explanation(node, tried, []) for tried in failure.tried],
            time.time(),
            by=failure.by,
            running=failure.running,
            kind=failure.kind.value,
        )

    def _findings(self, failure: Failure) -> list[Finding]:
        """The findings of the conditions. A condition that cannot be explained, because the world model does not
        answer or its code raises, is represented by its description."""
        findings = []
        for condition in failure.conditions:
            try:
                findings.append(condition.explain(failure.params, self._wmi))
            except FOREIGN_ERRORS:
                log.exception("a condition cannot be explained: %s", condition.getDescription())
                wanted = condition.getDescription()
                findings.append(Finding(type(condition).__name__, condition.label, {}, wanted, f"not {wanted}"))
        return findings


def with_labels(explanation: Explanation, wmi: WorldModelPort, known: Iterable[Element] = ()) -> Explanation:
    """Adds the labels of the elements that an explanation names. Returns it.

    :param known: elements that may have been removed.
    """
    labels = {element.id: element.label for element in known}
    try:
        for eid in ids_in(explanation.to_json()):
            explanation.labels[eid] = name_in_scene(eid, labels.get(eid, ""), wmi)
    except FOREIGN_ERRORS:  # a world model that does not answer, or that of a library
        log.debug("labels of an explanation", exc_info=True)
    return explanation


def name_in_scene(eid: str, label: str, wmi: WorldModelPort) -> str:
    """The label of an element, followed by its id in brackets if others have the same label.

    :param label: of an element that is not in the scene.
    """
    if eid == SCENE_ROOT:
        return "the scene"
    element = wmi.find_element(eid)
    label = element.label if element is not None else label
    same = [e for e in wmi.resolve_elements(Element("", label)) if e.type != "skiros:Parameter"] if label else []
    return label if len(same) < 2 else f"{label} ({local_name(eid)})"


def _provenance(node: Node) -> list[Provenance]:
    return provenance_of(node.run.slots, node.run.pre_conditions) if node.run is not None and node.run.slots else []


def _path(node: Node) -> list[Node]:
    """The nodes from the root to a node."""
    path = []
    current: Node | None = node
    while current is not None:
        path.append(current)
        current = current.parent
    return path[::-1]


def _child_indices(node: Node) -> tuple[int, ...]:
    """The child indices from the root to a node. They stay the same when a subtree is expanded again."""
    return tuple(n.child_index for n in _path(node))


#: By stage: the message, the code of an unsatisfied condition, and the code of one that raises.
_STAGES = {
    PRE: ("Pre-condition failed", PRE_FAILED, START_RAISED),
    HOLD: ("Hold-condition failed", HOLD_FAILED, EXECUTE_RAISED),
    POST: ("Post-condition failed", POST_FAILED, EXECUTE_RAISED),
}


def check_conditions(
    stage: str,
    conditions: Sequence[ConditionBase],
    params: ParamHandler,
    wmi: WorldModelPort,
    evaluated: dict[str, list[ConditionStatus]],
    note: Callable[[ConditionBase, bool], None] | None = None,
) -> Failure | None:
    """Evaluates conditions.

    :param stage: `PRE`, `HOLD` or `POST`.
    :param evaluated: the last evaluations of the node, by stage; updated.
    :param note: called with each condition and whether it holds; None: nobody is interested.
    :returns: the failure of the unsatisfied conditions, of stage `EXCEPTION` when a condition raises; None when all
        are satisfied.
    """
    prefix, code, raised_code = _STAGES[stage]
    try:
        unsatisfied = []
        for condition in conditions:
            if not condition.evaluate(params, wmi):
                unsatisfied.append(condition)
        if note is not None:
            failed = set(map(id, unsatisfied))
            for condition in conditions:
                note(condition, id(condition) not in failed)
        if conditions:
            _record(stage, conditions, unsatisfied, params, wmi, evaluated)
        if not unsatisfied:
            return None
        text = "; ".join(_unsatisfied_text(c, params, wmi) for c in unsatisfied)
    except SkirosError as error:
        return Failure(stage, code, f"{prefix}: {error}")
    except FOREIGN_ERRORS as error:
        return Failure(EXCEPTION, raised_code, format_error(error))
    kind = max((c.failure_kind for c in unsatisfied), key=lambda kind: kind.severity)
    return Failure(stage, code, f"{prefix}: {text}", conditions=unsatisfied, params=params, kind=kind)


def _record(
    stage: str,
    conditions: Sequence[ConditionBase],
    unsatisfied: Sequence[ConditionBase],
    params: ParamHandler,
    wmi: WorldModelPort,
    evaluated: dict[str, list[ConditionStatus]],
) -> None:
    """Records an evaluation. The texts of hold-conditions are formatted again only when a condition is unsatisfied."""
    now, known = time.time(), evaluated.get(stage)
    if stage == HOLD and known is not None and not unsatisfied:
        for status in known:
            status.time = now
        return
    failed = set(map(id, unsatisfied))
    evaluated[stage] = [
        ConditionStatus(stage, c.label, c.describe(), FAILS, c.found(params, wmi), time=now)
        if id(c) in failed
        else ConditionStatus(stage, c.label, c.describe(), HOLDS, time=now)
        for c in conditions
    ]


def _unsatisfied_text(condition: ConditionBase, params: ParamHandler, wmi: WorldModelPort) -> str:
    """The description of an unsatisfied condition and, where that adds something, the fact found instead."""
    wanted = condition.getDescription()
    found = condition.found(params, wmi)
    return wanted if found in wanted else f"{wanted}, but {found}"
