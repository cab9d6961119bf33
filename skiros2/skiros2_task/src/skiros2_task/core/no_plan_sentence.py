"""The one sentence that says why there is no plan, with labels and times: "Blue cup is nowhere: ..."."""

from __future__ import annotations

import time
from collections.abc import Callable

from skiros2_common.core.names import local_name
from skiros2_task.core.formula import Atom, Formula, Kind, Not
from skiros2_task.core.world import WorldView

#: The relations of a holder to what it holds and contains, and the root of the scene.
_SPATIAL, _CONTAIN, _ROOT = "skiros:spatiallyRelated", "skiros:contain", "skiros:Scene-0"

#: Units of the time since a change: the number of seconds, and the name.
_UNITS = ((86_400, "d"), (3_600, "h"), (60, "min"), (1, "s"))


def sentence_of(formula: Formula, world: WorldView, now: Callable[[], float] = time.time) -> str:
    """Returns why a fact cannot be reached, which no skill brings about or only skills that need it themselves."""
    atom, state = (formula.part, False) if isinstance(formula, Not) else (formula, True)
    if not isinstance(atom, Atom):
        return ""
    first = label_of(world, atom.terms[0])
    kind, name = atom.predicate.kind, local_name(atom.predicate.name)
    if kind is Kind.CAN:
        return f"{first} does not offer the skill {atom.predicate.name}."
    if kind is Kind.RELATION and state and world.is_subproperty(atom.predicate.name, _SPATIAL):
        return _place(atom.terms[0], atom.terms[1], world, now)
    if kind is Kind.RELATION:
        fact, holds = f"({name} {first} {label_of(world, atom.terms[1])})", "does not hold" if state else "holds"
        return f"{fact} {holds}, and no skill changes that."
    if kind in (Kind.VALUE, Kind.COMPARES):
        element = world.objects.get(atom.terms[0])
        found = None if element is None else element.value_of(atom.predicate.name)
        operator = atom.predicate.operator or "="
        wanted = f"{'' if state else 'not '}{operator} {atom.predicate.value}"
        present = f"has no {name}" if found is None else f"has {name} = {found}"
        return f"{first} {present}; {wanted} is needed, and no skill brings it about."
    return ""


def label_of(world: WorldView, eid: str) -> str:
    """The label of an element without prefix, or else its id."""
    element = world.objects.get(eid)
    return local_name(element.label) if element is not None and element.label else eid


def _place(wanted: str, eid: str, world: WorldView, now: Callable[[], float]) -> str:
    """Returns where an element is that cannot come to the wanted place."""
    thing, place = label_of(world, eid), label_of(world, wanted)
    holders = [
        (subject, world.is_subproperty(relation, _CONTAIN))
        for relation in world.stated_relations()
        if world.is_subproperty(relation, _SPATIAL)
        for subject, obj in world.pairs(relation)
        if obj == eid
    ]
    if holders:
        holder, is_in = holders[0]
        name = "the scene" if holder == _ROOT else label_of(world, holder)
        if not is_in:
            return f"{thing} is a part of {name}, and no skill can give it to {place}."
        return f"{thing} is in {name}, and no skill can bring it to {place}."
    removal = world.removal(eid, _SPATIAL)
    if removal is None:
        return f"{thing} is nowhere."
    holder, author, stamp = removal
    clock = time.strftime("%H:%M", time.localtime(stamp))
    return f"{thing} is nowhere: {author} removed it from {label_of(world, holder)} at {clock} ({_ago(now() - stamp)})."


def _ago(seconds: float) -> str:
    """Formats the time since a change in the largest unit that it reaches."""
    size, unit = next(((size, unit) for size, unit in _UNITS if seconds >= size), _UNITS[-1])
    return f"{max(0, int(seconds // size))} {unit} ago"
