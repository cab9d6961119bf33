"""Inspects a node of a running task: its parameters and whether its conditions hold. The result is plain data with a
JSON form. Any thread, while another ticks the task."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from skiros2_common.core.errors import FOREIGN_ERRORS, UnknownName
from skiros2_common.core.explanation import HOLD, POST, PRE, Provenance
from skiros2_common.core.json_data import JsonData
from skiros2_common.core.params import ParamHandler
from skiros2_common.core.world_element import Element
from skiros2_skill.core.diagnosis.provenance import format_values, provenance_of
from skiros2_skill.core.runtime.task import Task
from skiros2_skill.core.tree.node import SkillInterface
from skiros2_skill.core.tree.skill_node import SkillWrapper

#: The verdict on a condition; `UNKNOWN` when it cannot be evaluated.
HOLDS, FAILS, UNKNOWN = "holds", "fails", "unknown"


@dataclass
class ConditionStatus:
    """The present status of a condition.

    :param stage: `PRE`, `HOLD` or `POST`.
    :param text: its description, with the values of the parameters.
    :param verdict: `HOLDS`, `FAILS` or `UNKNOWN`.
    :param found: the fact found instead, or why it is unknown; may be "".
    :param elements: the elements named in the text, as `id-label`.
    """

    stage: str
    label: str
    text: str
    verdict: str
    found: str = ""
    elements: list[str] = field(default_factory=list)


@dataclass
class NodeStatus(JsonData):
    """The present status of a node.

    :param node: its id in the task.
    :param params: the values of its parameters and their provenance.
    """

    _data_name = "node"

    node: int
    type: str
    label: str
    params: list[Provenance] = field(default_factory=list)
    conditions: list[ConditionStatus] = field(default_factory=list)


def inspect(task: Task, node_id: int, wmi: Any) -> NodeStatus:
    """Inspects a node of a task.

    :param wmi: the world model that its conditions are evaluated against.
    :raises UnknownName: the task has no such node.
    """
    node = next((n for n in task.nodes() if n._id == node_id), None)
    if node is None:
        raise UnknownName(f"task {task.id} has no node {node_id}: it may have been replaced")
    status = NodeStatus(node_id, node._type, node._label, _params(node))
    if isinstance(node, SkillWrapper):
        stages = ((PRE, node._pre_conditions), (HOLD, node._hold_conditions), (POST, node._post_conditions))
        # A copy, because the task continues meanwhile.
        params = ParamHandler(node._params.getCopy())
        status.conditions = [_checked(stage, c, params, wmi) for stage, conditions in stages for c in list(conditions)]
    return status


def _params(node: SkillInterface) -> list[Provenance]:
    if isinstance(node, SkillWrapper) and node.slots:
        return provenance_of(node.slots, node._pre_conditions)
    params = list(node._params.getParamMap().items())
    return [Provenance(key, format_values(p._values) if p.is_bound() else "", "") for key, p in params]


def _checked(stage: str, condition: Any, params: ParamHandler, wmi: Any) -> ConditionStatus:
    """Evaluates a condition, whose code may raise anything."""
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
        return ConditionStatus(stage, own.label, text, UNKNOWN, f"it cannot be checked: {error}", elements)
    return ConditionStatus(stage, own.label, text, verdict, "" if found in text else found, elements)
