"""The blackboard of a task: one flat map from keys to parameters, shared by all nodes of the task.

The blackboard key of a node's parameter results from the remaps of the node and its ancestors. At its start, and before
each `execute`, a node *pulls* the values of its keys; afterwards it *pushes* its own. Nodes share the list of values
itself: all of them see changes in place.
"""

from __future__ import annotations

import logging
from collections.abc import Collection, Mapping
from typing import Any

from skiros2_common.core.errors import UnknownName, WrongType
from skiros2_common.core.explanation import CHANGED, DEFAULT, GIVEN, PULLED, SPECIFIED, UNSET
from skiros2_common.core.names import nearest
from skiros2_common.core.params import Origin, Param, ParamHandler, ParamTypes
from skiros2_common.core.revision import local_revision
from skiros2_common.core.world_element import Element
from skiros2_skill.core.engine.skill_run import Node, SkillRun, scope
from skiros2_skill.core.engine.slot import Slot, ids_of, is_same

log = logging.getLogger(__name__)


class Blackboard:
    """The parameters of a task by key. For the thread that ticks the task.

    :param params: the parameters of the root, which store the blackboard.
    """

    def __init__(self, params: ParamHandler) -> None:
        self._handler = params
        self._content = object()  # a different object after each change

    @property
    def _entries(self) -> dict[str, Param]:
        return self._handler._params

    def __contains__(self, key: str) -> bool:
        return key in self._entries

    def origin(self, key: str) -> Origin:
        """The origin of the values of a key."""
        entry = self._entries.get(key)
        return entry.origin if entry is not None else Origin.GIVEN

    def values(self, key: str) -> list[Any]:
        """The values of a key; [] when the blackboard does not have it."""
        entry = self._entries.get(key)
        return entry.current if entry is not None else []

    def ids(self) -> set[str]:
        """The ids of all elements on the blackboard."""
        return {v.id for p in self._entries.values() if p.is_element for v in p.current}

    def pull(self, node: Node, slots: list[Slot], is_start: bool = False) -> bool:
        """Copies values from the blackboard to the parameters of a node. Returns whether a parameter has changed.

        A parameter with a default keeps it, unless the default is an abstract element or elements with the same ids. At
        a start, an element that was not given is only a candidate for a parameter that can be inferred, and a key with
        a suggested element is not pulled. While the node runs, an inferred element does not replace another one.
        """
        entries = self._handler._params
        changed = False
        for slot in slots:
            entry = entries.get(slot.key)
            if entry is None or (is_start and slot.suggested):
                continue
            values, param = entry.current, slot.param
            if values is param.current or values is slot.ignored or values is slot.shared or not values:
                continue
            if slot.default_ids is not None and slot.default_ids != ids_of(values):
                continue
            is_open = slot.is_element and slot.default_ids is None and param.paramType is not ParamTypes.Optional
            if is_open and entry.origin is not Origin.GIVEN:
                if not is_start:
                    if entry.origin is Origin.INFERRED and param.is_bound() and ids_of(values) != ids_of(param.current):
                        continue
                elif len(values) == 1 and ids_of(values)[0]:
                    slot.candidate = values
                    continue
            slot.shared = values
            try:
                param.current = param.checked(values)
            except WrongType as error:
                log.error("%s keeps its own value, not the one on the blackboard: %s", node.printState(), error)
                continue
            if param.shared_snapshot is not None:
                param.shared_snapshot = list(param.current)
            if slot.default_ids is None:
                slot.bind(entry.origin)
            else:
                slot.origin, slot.ids = Origin.GIVEN, slot.default_ids
            pushed = PULLED if is_start or not node.children else CHANGED
            slot.provenance, slot.pushed_by = pushed if entry.set_by else GIVEN, entry.set_by
            changed = True
        return changed

    def push(self, run: SkillRun, everything: bool = False, removes: bool = True) -> list[str]:
        """Copies parameters of a run that were assigned or changed in place to the blackboard; a parameter without a
        value removes its key. Returns the keys that have changed.

        Does nothing if neither the blackboard nor any parameter has changed since all of them were pushed: most skills
        end so.

        :param everything: also pushes unchanged parameters, except for abstract elements that are defaults.
        :param removes: whether keys are removed.
        """
        local = local_revision.current
        if run.pushed_at == (self._content, local) and not run.exposed:
            return []
        entries = self._handler._params
        if len(run.params._params) != len(run.slots):  # the running skill has declared parameters
            update_slots(run)
        pushed: list[str] = []
        exposed: list[Param] = []
        is_complete = everything
        for slot in run.slots:
            param = slot.param
            values = param.current
            changed = param.assigned
            if changed:
                param.assigned = False
                slot.placeholder = None
                slot.provenance, slot.pushed_by = CHANGED, ""
            if param.shared_snapshot is not None:
                exposed.append(param)
                if not is_same(values, param.shared_snapshot):
                    param.shared_snapshot = list(values)
                    changed = True
            if slot.placeholder is not None and values is slot.placeholder and values and values[0].id:
                slot.placeholder = None  # the skill has added the element to the world model
                changed = True
            if changed:
                slot.note_change()
            elif not everything:
                continue
            entry = entries.get(slot.key)
            if not values or values is slot.placeholder:
                is_complete = False
            if not values:
                # Where its elements are gone, and another skill has set the key since, that value stays.
                is_own = changed or slot.ignored is None or (entry is not None and entry.current is slot.ignored)
                if removes and entry is not None and is_own:
                    del entries[slot.key]
                    pushed.append(slot.key)
            elif entry is not None and entry.current is values:
                if changed or (entry.origin is not slot.origin and slot.is_given_again(entry)):
                    entry.origin, entry.set_by = slot.origin, run.label
                    pushed.append(slot.key)
            elif changed or not (slot.is_at_placeholder or (entry is not None and entry.current is slot.shared)):
                entries[slot.key] = entry = param.with_values(values)
                entry.key = slot.key
                entry.origin, entry.set_by = slot.origin, run.label
                slot.shared = values
                pushed.append(slot.key)
        run.exposed = exposed or ()
        if pushed:
            self._content = object()
        run.pushed_at = (self._content, local) if is_complete else None
        return pushed


def make_slots(run: SkillRun, declared: ParamHandler) -> tuple[ParamHandler, list[Slot]]:
    """Creates the parameters of a run that starts, with their specified values or defaults, and their slots.

    Defaults are not copied yet, see `Slot.copy_default`. Unknown keys and values of a wrong type are logged and
    ignored.

    :param declared: the parameters of the implementation.
    """
    node, names, parent = run.node, run.keys, run.node.parent
    specified: Mapping[str, list[Any]] = node.specified_values
    if node.remaps:
        specified = {node.own_name(name): values for name, values in specified.items()}
    provenance = GIVEN if parent is not None and parent.parent is None else SPECIFIED
    params: dict[str, Param] = {}
    slots = []
    for key, param in declared._params.items():
        values, defaults = specified.get(key), param.defaults
        own = param.checked_or_log([*map(_as_read, values)]) if values is not None else None
        params[key] = param = param.with_values(defaults if own is None else own)
        if own is not None:
            param.defaults = list(own)
        is_default = own is None or (provenance == GIVEN and is_same(own, defaults))
        slot = Slot(param, names.get(key, key), DEFAULT if is_default else provenance)
        if slot.placeholder is not None or not param.current:
            slot.provenance = UNSET
        slots.append(slot)
    for key in specified.keys() - params.keys():
        log.error("%s: %s", node.printState(), declared.unknown(key))
    return ParamHandler(params, is_strict=True), slots


def update_slots(run: SkillRun) -> None:
    """Updates the slots of a skill that has declared parameters since its start."""
    known = {slot.param: slot for slot in run.slots}
    run.set_slots([known.get(param) or _new_slot(param, run) for param in run.params.values()])


def _new_slot(param: Param, run: SkillRun) -> Slot:
    slot = Slot(param, run.keys.get(param.key, param.key), DEFAULT if param.is_bound() else UNSET)
    slot.ids = ()  # what the skill has assigned since is a change
    return slot


def _as_read(value: Any) -> Any:
    return value.as_read() if isinstance(value, Element) else value  # an element only names the one to use


# -- remaps without a target ---------------------------------------------------------------------------------------


def unprovided_remap(node: Node, slot: Slot, blackboard: Blackboard) -> str:
    """The error text when a parameter is remapped to a key that no other node has; else ""."""
    if slot.key == slot.param.key or slot.key in blackboard:
        return ""
    known: set[str] = set()
    root = node
    while root.parent is not None:
        root = root.parent
    pending: list[tuple[Node, Mapping[str, str]]] = [(root, {})]
    while pending:
        other, outer = pending.pop()
        names = scope(outer, other.remaps)
        pending += [(child, names) for child in other.children]
        if other is not node:
            known.update(names.get(key, key) for key in _declared_keys(other))
    if slot.key in known:
        return ""
    near = nearest(slot.key, known | set(blackboard._entries))
    return (
        f"parameter {slot.param.key!r} is remapped to {slot.key!r}, which no other node of the task has"
        f"{'; near: ' + ', '.join(near) if near else ''}"
    )


def _declared_keys(node: Node) -> Collection[str]:
    """The keys that a node declares; () for an unknown skill."""
    try:
        return list(node.declared_params())
    except UnknownName:
        return ()
