"""Evaluates the conditions of nodes."""

from __future__ import annotations

import time
from collections.abc import Sequence

from skiros2_common.core.condition import ConditionBase
from skiros2_common.core.errors import FOREIGN_ERRORS, SkirosError
from skiros2_common.core.explanation import EXCEPTION, HOLD, POST, PRE
from skiros2_common.core.params import ParamHandler
from skiros2_common.core.source_location import format_error
from skiros2_common.core.world_model_port import WorldModelPort
from skiros2_runs.core.values import FAILS, HOLDS, ConditionStatus
from skiros2_skill.core.engine.failures import (
    EXECUTE_RAISED,
    HOLD_FAILED,
    POST_FAILED,
    PRE_FAILED,
    START_RAISED,
    Failure,
)

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
) -> Failure | None:
    """Evaluates conditions.

    :param stage: `PRE`, `HOLD` or `POST`.
    :param evaluated: the last evaluations of the node, by stage; updated.
    :returns: the failure of the unsatisfied conditions, of stage `EXCEPTION` when a condition raises; None when all
        are satisfied.
    """
    prefix, code, raised_code = _STAGES[stage]
    try:
        unsatisfied = [c for c in conditions if not c.evaluate(params, wmi)]
        if conditions:
            _record(stage, conditions, unsatisfied, params, wmi, evaluated)
        if not unsatisfied:
            return None
        text = "; ".join(_unsatisfied_text(c, params, wmi) for c in unsatisfied)
    except SkirosError as error:
        return Failure(stage, code, f"{prefix}: {error}")
    except FOREIGN_ERRORS as error:
        return Failure(EXCEPTION, raised_code, format_error(error))
    return Failure(stage, code, f"{prefix}: {text}", conditions=unsatisfied, params=params)


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
