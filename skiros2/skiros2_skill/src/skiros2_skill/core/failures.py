"""What failed in a task: kept while it runs and after, to be explained to people.

A failure is noted as cheap data where it happens. It becomes an `Explanation`, for which the world model is searched,
when the same node has not failed so just before: a reactive tree may have a node that fails at each tick.
"""

from __future__ import annotations

import logging
import re
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from skiros2_common.core.abstract_skill import State
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
from skiros2_common.core.params import ParamHandler
from skiros2_common.core.source_location import format_error
from skiros2_skill.core.node import SkillInterface
from skiros2_skill.core.origins import origins
from skiros2_skill.core.wrapper import SkillWrapper

log = logging.getLogger(__name__)

#: So many failures of a task are kept, the last ones.
MOST_KEPT = 100

PRE_FAILED, HOLD_FAILED, POST_FAILED = -1, -2, -3
START_RAISED, EXECUTE_RAISED, PREEMPT_RAISED = -404, -405, -406

#: A value may be another one at each tick: such failures are one kind.
_NUMBER = re.compile(r"\d+(?:\.\d+)?(?:e[+-]?\d+)?")

#: In words, and the codes for those that do not hold and those that raise.
_CONDITIONS = {
    PRE: ("Pre-condition failed", PRE_FAILED, START_RAISED),
    HOLD: ("Hold-condition failed", HOLD_FAILED, EXECUTE_RAISED),
    POST: ("Post-condition failed", POST_FAILED, EXECUTE_RAISED),
}


@dataclass
class Failure:
    """A failure of a node, not explained yet.

    :param stage, code, message: as in `Explanation`.
    :param label: of the implementation; "" for that of the node.
    :param conditions: those that do not hold of `params`.
    :param origins: tells where the values of the parameters came from; None: those of the node.
    :param late: the node had failed or was ended already: this is not why.
    """

    stage: str
    code: int
    message: str
    label: str = ""
    conditions: Sequence[Any] = ()
    params: ParamHandler | None = None
    candidates: list[InferenceFailure] = field(default_factory=list)
    origins: Callable[[], list[Provenance]] | None = None
    tried: Sequence[Failure] = ()
    late: bool = False


def unmet(stage: str, conditions: Sequence[Any], params: ParamHandler, wmi: Any) -> Failure | None:
    """The failure of the conditions that do not hold; None when all do.

    :param stage: `PRE`, `HOLD` or `POST`; `EXCEPTION` when a condition's own code raises.
    """
    words, code, raised = _CONDITIONS[stage]
    try:
        failed = [c for c in conditions if not c.evaluate(params, wmi)]
        if not failed:
            return None
        text = "; ".join(_told(c, params, wmi) for c in failed)
    except SkirosError as error:
        return Failure(stage, code, f"{words}: {error}")
    except FOREIGN_ERRORS as error:
        return Failure(EXCEPTION, raised, format_error(error))
    return Failure(stage, code, f"{words}: {text}", conditions=failed, params=params)


def _told(condition: Any, params: ParamHandler, wmi: Any) -> str:
    """A condition that does not hold, and what is so instead where that says more."""
    wanted: str = condition.getDescription()
    found: str = condition.found(params, wmi)
    return wanted if found in wanted else f"{wanted}, but {found}"


@dataclass
class _Kept:
    node: SkillInterface
    explanation: Explanation
    late: bool


class Failures:
    """The failures of one task. Noted by the thread that ticks it, read by any.

    :param wmi: the world model as the task sees it.
    """

    def __init__(self, wmi: Any) -> None:
        self._wmi = wmi
        self._kept: dict[tuple[Any, ...], _Kept] = {}  # the one that failed last is the last
        self._lock = threading.Lock()

    def note(self, node: SkillInterface, failure: Failure) -> None:
        """Keeps a failure; one that the same node had before, with the same message but for numbers, is counted."""
        key = (_place(node), failure.label, failure.stage, failure.code, _NUMBER.sub("#", failure.message))
        known = self._kept.get(key)
        if known is not None and known.explanation.message == failure.message:
            explanation = known.explanation
        else:
            explanation = self._explained(node, failure)
        times = known.explanation.times + 1 if known is not None else 1
        kept = _Kept(node, replace(explanation, times=times), failure.late)
        with self._lock:
            self._kept.pop(key, None)
            self._kept[key] = kept
            if len(self._kept) > MOST_KEPT:
                del self._kept[next(iter(self._kept))]

    def explanations(self) -> list[Explanation]:
        """Why nodes failed, in the order in which they failed last."""
        with self._lock:
            kept = list(self._kept.values())
        return [replace(k.explanation, node=k.node._id) for k in kept]

    def cause(self) -> tuple[SkillInterface, Explanation] | None:
        """The node because of which the root failed last, and why; None when no node failed."""
        for kept in reversed(self._kept.values()):
            if not kept.late and all(node._state is State.Failure for node in _path(kept.node)):
                return kept.node, kept.explanation
        return None

    def cause_under(self, node: SkillInterface) -> tuple[str, int] | None:
        """The message, in one line, and the code of the failure because of which a compound has failed."""
        for kept in reversed(self._kept.values()):
            failed = kept.node
            if not kept.late and failed._state is State.Failure and failed.inSubtreeOf(node):
                text = kept.explanation.message.strip().partition("\n")[0]
                return f"{failed.label or failed.type}: {text}", min(kept.explanation.code, -1)
        return None

    def _explained(self, node: SkillInterface, failure: Failure) -> Explanation:
        path = [_name(n) for n in _path(node) if n._parent is not None or n is node]
        return self._explanation(node, failure, path)

    def _explanation(self, node: SkillInterface, failure: Failure, path: list[str]) -> Explanation:
        return Explanation(
            failure.stage,
            node._type,
            failure.label or node._label,
            node._id,
            failure.code,
            failure.message,
            path,
            self._findings(failure),
            failure.candidates,
            failure.origins() if failure.origins is not None else _origins(node),
            [self._explanation(node, tried, []) for tried in failure.tried],
            time.time(),
        )

    def _findings(self, failure: Failure) -> list[Finding]:
        """What is to say of the conditions. One that cannot be explained, as the world model does not answer or as
        its own code raises, is told by its description."""
        findings = []
        for condition in failure.conditions:
            try:
                findings.append(condition.explain(failure.params, self._wmi))
            except FOREIGN_ERRORS:
                log.exception("a condition cannot be explained: %s", condition.getDescription())
                wanted = condition.getDescription()
                findings.append(Finding(type(condition).__name__, condition.label, {}, wanted, f"not {wanted}"))
        return findings


def _origins(node: SkillInterface) -> list[Provenance]:
    return origins(node.slots, node._pre_conditions) if isinstance(node, SkillWrapper) else []


def _path(node: SkillInterface) -> list[SkillInterface]:
    """The nodes from the root to a node."""
    path = []
    above: SkillInterface | None = node
    while above is not None:
        path.append(above)
        above = above._parent
    return path[::-1]


def _place(node: SkillInterface) -> tuple[int, ...]:
    """Which child of which child a node is: that stays so when a subtree is made anew."""
    return tuple(n._place for n in _path(node))


def _name(node: SkillInterface) -> str:
    """A skill that no implementation was chosen for goes by its type, an unnamed node by its processor."""
    if node._label:
        return node._label
    return node._type.partition(":")[2] if isinstance(node, SkillWrapper) else node._processor.printType()
