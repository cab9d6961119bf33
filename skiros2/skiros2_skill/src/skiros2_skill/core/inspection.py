"""A node of a running task looked at: its parameters and whether its conditions hold now. Plain data that travels as
JSON; made when somebody asks, in any thread, while the task is ticked."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from skiros2_common.core.errors import FOREIGN_ERRORS, UnknownName
from skiros2_common.core.explanation import HOLD, POST, PRE, Provenance
from skiros2_common.core.json_data import JsonData
from skiros2_common.core.params import ParamHandler
from skiros2_common.core.world_element import Element
from skiros2_skill.core.node import SkillInterface
from skiros2_skill.core.origins import origins, told_values
from skiros2_skill.core.task import Task
from skiros2_skill.core.wrapper import SkillWrapper

#: Whether a condition holds; the last where it cannot be said.
HOLDS, FAILS, UNKNOWN = "holds", "fails", "unknown"


@dataclass
class ConditionNow:
    """A condition as it is now.

    :param stage: `PRE`, `HOLD` or `POST`: when the node needs it.
    :param text: what it asks for, with the values of the parameters.
    :param verdict: `HOLDS`, `FAILS` or `UNKNOWN`.
    :param found: what is so instead, or why it cannot be said; "" where nothing more is known.
    :param elements: those that it speaks of, as they stand in the text: `id-label`.
    """

    stage: str
    label: str
    text: str
    verdict: str
    found: str = ""
    elements: list[str] = field(default_factory=list)


@dataclass
class NodeNow(JsonData):
    """A node as it is now.

    :param node: its id in the task.
    :param params: the values of its parameters and where they came from.
    """

    _data_name = "node"

    node: int
    type: str
    label: str
    params: list[Provenance] = field(default_factory=list)
    conditions: list[ConditionNow] = field(default_factory=list)


def inspect(task: Task, node_id: int, wmi: Any) -> NodeNow:
    """What a node of a task is now.

    :param wmi: the world model that its conditions are checked against.
    :raises UnknownName: the task has no such node.
    """
    node = next((n for n in task.nodes() if n._id == node_id), None)
    if node is None:
        raise UnknownName(f"task {task.id} has no node {node_id}: it may have been replaced")
    now = NodeNow(node_id, node._type, node._label, _params(node))
    if isinstance(node, SkillWrapper):
        stages = ((PRE, node._pre_conditions), (HOLD, node._hold_conditions), (POST, node._post_conditions))
        # The task goes on meanwhile: what is checked is a copy.
        params = ParamHandler(node._params.getCopy())
        now.conditions = [_checked(stage, c, params, wmi) for stage, conditions in stages for c in list(conditions)]
    return now


def _params(node: SkillInterface) -> list[Provenance]:
    if isinstance(node, SkillWrapper) and node.slots:
        return origins(node.slots, node._pre_conditions)
    return [Provenance(key, told_values(p._values) if p.is_bound() else "", "") for key, p in _pairs(node)]


def _pairs(node: SkillInterface) -> Sequence[tuple[str, Any]]:
    return list(node._params.getParamMap().items())


def _checked(stage: str, condition: Any, params: ParamHandler, wmi: Any) -> ConditionNow:
    """A condition's own code may raise anything."""
    own = condition.copy()
    text = type(own).__name__
    elements: list[str] = []
    try:
        verdict = HOLDS if own.evaluate(params, wmi) else FAILS
        text = own.getDescription().removeprefix(f"[{own.label}] ")
        found = own.found(params, wmi) if verdict == FAILS else ""
        known = {repr(v) for p in params.values() for v in p.values if isinstance(v, Element) and v.id}
        elements = sorted(name for name in known if name in text or name in found)
    except FOREIGN_ERRORS as error:
        return ConditionNow(stage, own.label, text, UNKNOWN, f"it cannot be checked: {error}", elements)
    return ConditionNow(stage, own.label, text, verdict, "" if found in text else found, elements)
