"""For people: the state of a node, and the authors of the changes behind a failure. Not for use in a tick."""

from __future__ import annotations

import logging
import time
from collections.abc import Iterable, Sequence
from dataclasses import replace

from skiros2_common.core.abstract_skill import State
from skiros2_common.core.condition import ConditionBase
from skiros2_common.core.errors import FOREIGN_ERRORS, SkirosError, UnknownName
from skiros2_common.core.explanation import HOLD, POST, PRE, Change, Explanation, Provenance
from skiros2_common.core.params import ParamHandler
from skiros2_common.core.world_element import Element
from skiros2_common.core.world_model_port import WorldModelPort
from skiros2_runs.core.values import (
    FAILS,
    HOLDS,
    MAXIMUM,
    MINIMUM,
    UNKNOWN,
    ConditionStatus,
    NodeStatus,
    SignalBound,
    TaskBounds,
)
from skiros2_skill.core.engine.failures import name_in_scene
from skiros2_skill.core.engine.slot import format_values, provenance_of
from skiros2_skill.core.runtime.task import Task
from skiros2_skill.core.tree.node import SkillInterface
from skiros2_skill.core.tree.skill_node import SkillWrapper

log = logging.getLogger(__name__)

#: The id of all nodes of a task in a request.
ALL_NODES = -1

#: How many changes of an element are searched.
MAX_ENTRIES = 1000


def add_authors(explanations: Iterable[Explanation], wmi: WorldModelPort, timeout: float = 2.0) -> None:
    """Sets time and author of the last change of each fact before the failure.

    Changes that the journal does not have, and all when the world model does not answer, are left unset.

    :param timeout: s, after which no further query starts.
    """
    deadline = time.monotonic() + timeout
    for explanation in explanations:
        for change in explanation.all_changes():
            if not change.author and time.monotonic() < deadline:
                _add_author(change, explanation.stamp, wmi)
                if change.removed_from and change.removed_from not in explanation.labels:
                    explanation.labels[change.removed_from] = name_in_scene(change.removed_from, "", wmi)


def _add_author(change: Change, until: float, wmi: WorldModelPort) -> None:
    try:
        names = [change.name, *wmi.get_sub_properties(change.name)] if change.name else []
        entries = wmi.history(change.element, until=until, limit=MAX_ENTRIES)
    except SkirosError as error:
        log.debug("the author of %s %s is not known: %s", change.element, change.name, error)
        return
    entry = next((e for e in reversed(entries) if not names or e.affects(names)), None)
    if entry is not None:
        change.number, change.stamp, change.author = entry.number, entry.stamp, entry.author
        lost = (r["src"] for r in entry.unrelated if r["dst"] == change.element and r["type"] in names)
        change.removed_from = next(map(str, lost), "")


def inspect(task: Task, node_id: int, wmi: WorldModelPort) -> NodeStatus:
    """Inspects a node of a task.

    :param wmi: the world model that its conditions are evaluated against.
    :raises UnknownName: the task has no such node.
    """
    node = next((n for n in task.nodes() if n._id == node_id), None)
    if node is None:
        raise UnknownName(f"task {task.id} has no node {node_id}: it may have been replaced")
    status = NodeStatus(node_id, node._type, node._label, _params(node), time=time.time())
    if isinstance(node, SkillWrapper):
        # A copy, because the task continues meanwhile.
        params = ParamHandler(node.present_params.getCopy())
        has_ended = node.hasState(State.Success) or node.hasState(State.Failure)
        for stage, conditions in zip((PRE, HOLD, POST), node.present_conditions, strict=True):
            evaluated = (node.run.evaluated if node.run is not None else {}).get(stage)
            if evaluated is not None:
                status.conditions += [_with_elements(c, params) for c in evaluated]
            elif not has_ended and not task.ended.is_set():
                status.conditions += [_preview(stage, c, params, wmi) for c in list(conditions)]
    return status


def signal_bounds(task: Task) -> TaskBounds:
    """Returns the limits for signals that the nodes of a task have set in their last runs."""
    found = []
    for node in task.nodes():
        for condition in list(node.present_conditions[1]) if isinstance(node, SkillWrapper) else ():
            for bounds in condition.signal_bounds():
                for side, value in ((MINIMUM, bounds.limits.minimum), (MAXIMUM, bounds.limits.maximum)):
                    if value is not None:
                        bound = SignalBound(node._id, condition.label, bounds.signal, side, value, bounds.violated)
                        found.append(bound)
    return TaskBounds(found)


def inspection_json(task: Task, node_id: int, wmi: WorldModelPort) -> str:
    """Returns the result of `inspect` as JSON; for `ALL_NODES` that of `signal_bounds`. Raises like `inspect`."""
    return (signal_bounds(task) if node_id == ALL_NODES else inspect(task, node_id, wmi)).to_json()


def _params(node: SkillInterface) -> list[Provenance]:
    if node.run is not None and node.run.slots:
        return provenance_of(node.run.slots, node.run.pre_conditions)
    params = list(node.present_params.getParamMap().items())
    return [Provenance(key, format_values(p.current) if p.is_bound() else "", "") for key, p in params]


def _with_elements(condition: ConditionStatus, params: ParamHandler) -> ConditionStatus:
    """Completes a recorded evaluation."""
    found = "" if condition.found in condition.text else condition.found
    return replace(condition, found=found, elements=_elements_in([condition.text, found], params))


def _preview(stage: str, condition: ConditionBase, params: ParamHandler, wmi: WorldModelPort) -> ConditionStatus:
    """Evaluates a condition, whose code may raise anything."""
    own = condition.copy()
    text = type(own).__name__
    try:
        verdict = HOLDS if own.evaluate(params, wmi) else FAILS
        text = own.describe()
        found = own.found(params, wmi) if verdict == FAILS else ""
    except FOREIGN_ERRORS as error:
        return ConditionStatus(stage, own.label, text, UNKNOWN, f"it cannot be checked: {error}")
    return _with_elements(ConditionStatus(stage, own.label, text, verdict, found), params)


def _elements_in(texts: Sequence[str], params: ParamHandler) -> list[str]:
    """Returns the elements that texts name, as `id-label`."""
    known = {repr(v) for p in params.values() for v in p.values if isinstance(v, Element) and v.id}
    return sorted(name for name in known if any(name in text for text in texts))
