"""Clauses about facts and elements for people, with labels and times: "Blue cup is nowhere: root removed it ..."."""

from __future__ import annotations

import time

from skiros2_common.core.names import SCENE_ROOT, SPATIAL, local_name
from skiros2_common.core.wording import a, label_text, moment, unrelated, verb, words, wrong_value
from skiros2_task.core.actions import Variable
from skiros2_task.core.formula import And, Atom, Formula, Kind, Not, Or
from skiros2_task.core.world import WorldView

_CONTAIN = "skiros:contain"


class Clauses:
    """Formats facts of a world as clauses.

    :param world: None: elements are named by their ids, and nothing is known about them.
    """

    def __init__(self, world: WorldView | None) -> None:
        self._world = world

    def name(self, eid: str) -> str:
        """The label of an element, with the id if others have the same label, or else the id; without prefix."""
        element = self._world.objects.get(eid) if self._world is not None else None
        if eid == SCENE_ROOT:
            return "the scene"
        if self._world is None:
            return eid
        if element is None or not element.label:
            return local_name(eid)
        name = label_text(element.label)
        is_unique = len(self._world.instances(element.label)) < 2
        return name if is_unique else f"{name} ({local_name(eid)})"

    def kind(self, eid: str) -> str:
        """The class of an element, with its article: "a location"."""
        element = self._world.objects.get(eid) if self._world is not None else None
        return a(words(element.type if element is not None else eid.rpartition("-")[0]))

    def fact(self, formula: Formula) -> str:
        """A formula as a clause: "Shelf contains Blue cup"."""
        if isinstance(formula, And | Or):
            word = " and " if isinstance(formula, And) else " or "
            return word.join(map(self.fact, formula.parts)) or "(nothing)"
        atom, state = (formula.part, False) if isinstance(formula, Not) else (formula, True)
        if not isinstance(atom, Atom):
            return str(formula)
        predicate, names = atom.predicate, [self.name(term) for term in atom.terms]
        kind, be = predicate.kind, "is" if state else "is not"
        if kind is Kind.RELATION:
            return f"{names[0]} {verb(predicate.name, state)} {names[1]}"
        if kind is Kind.ALLOWED:
            return f"the ontology {'allows' if state else 'forbids'} that {names[0]} {verb(predicate.name)} {names[1]}"
        if kind is Kind.CAN:
            return f"{names[0]} {'has' if state else 'does not have'} the skill {predicate.name}"
        if kind is Kind.IN_SCENE:
            return f"{names[0]} {be} in the scene"
        if kind is Kind.HAS:
            return f"{names[0]} has {'a' if state else 'no'} value of {words(predicate.name)}"
        if kind is Kind.IS_A:
            return f"{names[0]} {be} {a(words(predicate.name))}"
        if kind is Kind.VALUE:
            return f"{words(predicate.name)} of {names[0]} {be} {predicate.value}"
        if kind is Kind.COMPARES:
            return f"{words(predicate.name)} of {names[0]} {be} {predicate.operator} {predicate.value}"
        return f"{names[0]} {be} {names[1]}"

    def obstacle(self, formula: Formula) -> str:
        """Why a fact cannot be reached that no skill brings about, or only skills that need it themselves."""
        atom, state = (formula.part, False) if isinstance(formula, Not) else (formula, True)
        if not isinstance(atom, Atom) or self._world is None:
            return f"{self.fact(formula)}: no skill achieves it"
        kind, key = atom.predicate.kind, atom.predicate.name
        if kind is Kind.CAN:
            return f"{self.name(atom.terms[0])} does not offer the skill {key}"
        if kind is Kind.RELATION and state and self._world.is_subproperty(key, SPATIAL):
            return self._place(key, *atom.terms)
        if kind is Kind.RELATION and state:
            others = [self.name(obj) for subject, obj in self._world.pairs(key) if subject == atom.terms[0]]
            text = unrelated(key, self.name(atom.terms[0]), self.name(atom.terms[1]), others=others)
        elif kind in (Kind.VALUE, Kind.COMPARES) and atom.terms[0] in self._world.objects:
            found = self._world.objects[atom.terms[0]].value_of(key)
            compared = f"{atom.predicate.operator} " if kind is Kind.COMPARES and atom.predicate.operator != "=" else ""
            wanted = f"{'' if state else 'not '}{compared}{atom.predicate.value}"
            shown = "" if found is None else str(found)
            text = wrong_value(key, self.name(atom.terms[0]), shown, wanted if state or compared else "")
        else:
            text = self.fact(Not(atom) if state else atom)
        return f"{text}, and no skill can change that"

    def _place(self, relation: str, wanted: str, eid: str) -> str:
        """Returns where an element is that cannot come to the wanted place."""
        assert self._world is not None
        thing = self.name(eid)
        holders = [
            (subject, held)
            for held in self._world.stated_relations()
            if self._world.is_subproperty(held, SPATIAL)
            for subject, obj in self._world.pairs(held)
            if obj == eid
        ]
        if holders:
            holder, held = holders[0]
            is_in = self._world.is_subproperty(held, _CONTAIN)
            where = f"{thing} is in" if is_in else f"{thing} is a part of"
            bring = "bring it to" if self._world.is_subproperty(relation, _CONTAIN) else "give it to"
            return f"{where} {self.name(holder)}, and no skill can {bring} {self.name(wanted)}"
        removal = self._world.removal(eid, SPATIAL)
        if removal is None:
            return f"{thing} is nowhere"
        holder, author, stamp = removal
        at = moment(stamp, time.time())
        return f"{thing} is nowhere: {author.strip('/')} removed it from {self.name(holder)} at {at}"


def needs(variable: Variable) -> str:
    """Returns the phrase that a skill needs an element: "needs a product for Object"."""
    return f"needs {' and '.join(a(words(cls)) for cls in variable.classes)} for {variable.key or 'Robot'}"
