"""How the parameters of a running node come from, and go back to, the nodes above it.

A node's key is looked up level by level: the parent may declare it, rename it, or pass it on; the root keeps what
nobody declares. A value is *taken* from above, *fixed* (by `specify`, or a default), *inferred*, or *changed* by the
skill's own code. Changed values go back at once, fixed ones when the skill has succeeded, inferred ones never: they
belong to the skill that inferred them.
"""

from __future__ import annotations

import logging
from enum import Enum
from typing import Any

from skiros2_common.core.errors import WrongType
from skiros2_common.core.params import Param, ParamHandler
from skiros2_common.core.world_element import Element
from skiros2_skill.core.node import SkillInterface

log = logging.getLogger(__name__)

Source = Enum("Source", "Unset Taken Fixed Inferred Changed")
_UNSET, _TAKEN, _FIXED, _CHANGED = Source.Unset, Source.Taken, Source.Fixed, Source.Changed


class Slot:
    """One parameter of a running node: where its values came from, and what they were when last looked at."""

    __slots__ = ("is_element", "known", "param", "seen_above", "source")

    def __init__(self, param: Param, source: Source) -> None:
        self.param = param
        self.is_element = param.is_element
        self.source = source
        self.known: list[Any] = param._values
        self.seen_above: list[Any] | None = None


def declared_above(node: SkillInterface, key: str) -> tuple[Param | None, ParamHandler, str]:
    """The parameter that a node's key stands for above it.

    :returns: the parameter, None when nobody has it yet; the handler that has it or would get it; its name there.
    """
    name = node._remaps.get(key, key)
    above = node._parent
    holder = node._params
    while above is not None:
        holder = above._params
        param = holder._params.get(name)
        if param is not None:
            return param, holder, name
        if above._parent is None:
            break
        name = above._remaps.get(name, name)
        above = above._parent
    return None, holder, name


def fix(node: SkillInterface, params: ParamHandler) -> list[Slot]:
    """Slots for the parameters of a node that starts: set to what the node was given.

    :param params: at their defaults.
    :raises UnknownName: a fixed parameter is none of the skill's.
    :raises WrongType: a fixed value is of another type.
    """
    slots = {key: Slot(param, _FIXED if param.hasSpecifiedDefault() else _UNSET) for key, param in params.items()}
    for name, values in node._specified.items():
        key = node.own_name(name)
        params.specify(key, _own(values))
        slots[key].source = _FIXED
    for slot in slots.values():
        slot.known = slot.param._values
    return list(slots.values())


def take(node: SkillInterface, slots: list[Slot]) -> bool:
    """Takes the values from above that are new there. Returns whether any was.

    :raises WrongType: a value above is of another type.
    """
    new = False
    for slot in slots:
        if slot.source is not _UNSET and slot.source is not _TAKEN:
            continue
        above, _, name = declared_above(node, slot.param.key)
        if above is None or above._values is slot.seen_above:
            continue
        if not above.isSpecified() and slot.source is _UNSET:
            continue
        slot.seen_above = above._values
        if above.isSpecified():
            _assign(slot.param, above._values, name)
            slot.source = _TAKEN
        else:
            slot.param.setDefault()
            slot.source = _UNSET
        slot.known = slot.param.values
        new = True
    return new


def renew(slots: list[Slot], wmi: Any, present: Any) -> None:
    """Reads the elements among the values anew from the world model; one that is gone leaves its parameter unset.

    :param present: the world model's `Present`, which tells which are the same; None: it is not known.
    """
    for slot in slots:
        param = slot.param
        if not slot.is_element or not param._values:
            continue
        renewed = []
        is_same = True
        for value in param._values:
            mark = present.element(value.id) if present is not None else None
            if value.isAbstract() or (mark is not None and mark.version == value.version and not value.touched):
                renewed.append(value)
                continue
            is_same = False
            found = wmi.find_element(value.id)
            if found is not None:
                renewed.append(found)
        if is_same:
            continue
        if renewed:
            param._values = renewed
        else:
            param.unset()
        slot.known = param._values


def write_elements(slots: list[Slot], wmi: Any) -> None:
    """Writes the elements that the skill changed through its parameters; adds abstract ones that got data.

    :param slots: those of element type.
    :raises WmException: the world model refuses.
    """
    for slot in slots:
        for element in slot.param._values:
            if not element.touched:
                continue
            changes = element.changes()
            if element.isAbstract():
                if changes or element.local_relations or (changes is None and _has_data(element)):
                    wmi.add_element(element)
            elif changes or element.local_relations:
                wmi.update_element(element)


def drop_changes(slots: list[Slot], wmi: Any) -> None:
    """Forgets what the skill has changed on its elements and is not to be written: they are read anew."""
    for slot in slots:
        values = slot.param._values
        if any(element.touched for element in values):
            found = [wmi.find_element(element.id) for element in values if not element.isAbstract()]
            slot.param._values = slot.known = [element for element in found if element is not None]


def give_changed(node: SkillInterface, slots: list[Slot]) -> bool:
    """Passes the values that were changed here to the nodes above. Returns whether there were any."""
    given = False
    params = node._params._params
    if len(params) != len(slots):  # the skill has declared parameters while it runs
        known = {slot.param.key for slot in slots}
        slots += [Slot(param, _CHANGED) for key, param in params.items() if key not in known]
    for slot in slots:
        param = params.get(slot.param.key)
        if param is None:
            continue
        slot.param = param
        if param._values is not slot.known:
            slot.known = param._values
            slot.source = _CHANGED
            given |= _give(node, param)
    return given


def give_fixed(node: SkillInterface, slots: list[Slot]) -> bool:
    """Passes the fixed values of a skill that has succeeded to the nodes above. Returns whether any was new there."""
    given = False
    for slot in slots:
        if slot.source is _FIXED and slot.param.isSpecified():
            given |= _give(node, slot.param)
    return given


def _give(node: SkillInterface, param: Param) -> bool:
    above, holder, name = declared_above(node, param.key)
    if node._parent is None:
        return False
    if above is None:
        if not param.isSpecified():
            return False
        holder.addParam(name, param.dataType(), param.paramType, param.description)
        above = holder._params[name]
        above._default = [v for v in param._default if isinstance(v, Element) and v.isAbstract()]
    elif above._values == param._values:
        return False
    try:
        above.assign(list(param._values))
    except WrongType as error:
        log.error(
            "%s gives its parameter %r to %r above, which is of another type: %s",
            node.printState(), param.key, name, error,
        )  # fmt: skip
        return False
    above.given_by = (above._values, node._label)
    return True


def giver_of(param: Param) -> str:
    """The label of the node below that has put the values of a parameter there; "" when none has."""
    values, label = param.given_by
    return label if values is param._values else ""


def _assign(param: Param, values: list[Any], name: str) -> None:
    try:
        param.assign(_own(values))
    except WrongType as error:
        raise WrongType(f"parameter {param.key!r} takes the value of {name!r}: {error}") from None


def _own(values: Any) -> Any:
    """The values with elements of one's own, so that what is changed here is seen only when it is written."""
    if isinstance(values, Element):
        return values.view()
    if isinstance(values, (list, tuple)):
        return [v.view() if isinstance(v, Element) else v for v in values]
    return values


def _has_data(element: Element) -> bool:
    return bool(element.label or element.available_properties or element.getRelations())
