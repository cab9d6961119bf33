"""Evaluates conditions of nodes, and determines what their results depend on."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from skiros2_common.core.abstract_skill import State
from skiros2_common.core.conditions import (
    AbstractConditionRelation,
    ConditionFunction,
    ConditionGenerate,
    ConditionHasProperty,
    ConditionIsSpecified,
    ConditionOnType,
    ConditionOr,
    ConditionProperty,
    ConditionRelation,
)
from skiros2_common.core.discrete_reasoner import reasoners
from skiros2_common.core.errors import FOREIGN_ERRORS, SkirosError
from skiros2_common.core.explanation import EXCEPTION, HOLD, POST, PRE
from skiros2_common.core.params import ParamHandler
from skiros2_common.core.source_location import format_error
from skiros2_common.core.world_element import Element
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

#: Conditions whose result follows from the ontologies and the elements in their parameters. Not their subclasses.
_OF_THEIR_ELEMENTS = (
    AbstractConditionRelation,
    ConditionGenerate,
    ConditionHasProperty,
    ConditionIsSpecified,
    ConditionOnType,
    ConditionProperty,
    ConditionRelation,
)


def check_conditions(stage: str, conditions: Sequence[Any], params: ParamHandler, wmi: Any) -> Failure | None:
    """Evaluates conditions.

    :param stage: `PRE`, `HOLD` or `POST`.
    :returns: the failure of the unsatisfied conditions, of stage `EXCEPTION` when a condition raises; None when all
        are satisfied.
    """
    prefix, code, raised_code = _STAGES[stage]
    try:
        unsatisfied = [c for c in conditions if not c.evaluate(params, wmi)]
        if not unsatisfied:
            return None
        text = "; ".join(_unsatisfied_text(c, params, wmi) for c in unsatisfied)
    except SkirosError as error:
        return Failure(stage, code, f"{prefix}: {error}")
    except FOREIGN_ERRORS as error:
        return Failure(EXCEPTION, raised_code, format_error(error))
    return Failure(stage, code, f"{prefix}: {text}", conditions=unsatisfied, params=params)


def _unsatisfied_text(condition: Any, params: ParamHandler, wmi: Any) -> str:
    """The description of an unsatisfied condition and, where that adds something, the fact found instead."""
    wanted: str = condition.getDescription()
    found: str = condition.found(params, wmi)
    return wanted if found in wanted else f"{wanted}, but {found}"


def is_volatile(condition: Any, wmi: Any) -> bool:
    """Whether a condition must be evaluated at every tick."""
    relation = getattr(condition, "relation", None)
    if condition.volatile or isinstance(condition, ConditionFunction):  # a dict may change in place
        return True
    return relation is not None and reasoners.find_or_load(relation) is not None


def depends_on_elements_only(condition: Any, params: dict[str, Any]) -> bool:
    """Whether a condition keeps its result while its parameters, their elements and the ontologies stay the same."""
    if condition.volatile:
        return True  # it is evaluated at every tick anyway
    if type(condition) is ConditionOr:
        return all(depends_on_elements_only(part, params) for part in condition.conditions)
    # An unset parameter may stand for any element of a class.
    return type(condition) in _OF_THEIR_ELEMENTS and all(
        key in params and params[key].is_bound() for key in condition.getKeys()
    )


def affects(change: Any, root: Any) -> bool:
    """Whether a change of the world model concerns an element that a hold-condition of a running node refers to.

    May be called while another thread ticks the tree: an outdated answer costs a superfluous tick, or delays one to
    the next period.
    """
    changed = {element.id for element in change.elements}
    for relation in change.relations:
        changed.update((relation["src"], relation["dst"]))
    pending = [root]
    while pending:
        node = pending.pop()
        if node._state is not State.Running:
            continue
        pending += node._children
        for condition in node._hold_conditions:
            if not changed or any(_refers_to(node, key, changed) for key in condition.getKeys()):
                return True
    return False


def _refers_to(node: Any, key: str, changed: set[str]) -> bool:
    """Whether a parameter holds one of these elements, or stands for any element of its class."""
    param = node._params._params.get(key)
    if param is None or not param.is_element:
        return False
    values = param._values
    return not values or any(isinstance(v, Element) and (v.id in changed or v.isAbstract()) for v in values)
