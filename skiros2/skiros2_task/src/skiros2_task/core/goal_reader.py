"""Reads goal texts into formulas over names of the ontology and elements of the scene.

A name of a relation, property, class or element may be written as in PDDL (any case, `_` for other signs) and without
its prefix. `(contain a b)` is a relation; `(Painted a)`, `(State_Painted a)` and `(= (State a) Painted)` compare a text
property, `(> (Weight a) 2)` a number; `(Open a)` is a boolean property; `(has_Weight a)` tests for a value;
`(= ?x a)` is identity.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import cached_property
from itertools import product

from skiros2_common.core.limits import NO_LIMITS
from skiros2_common.core.names import local_name
from skiros2_task.core.formula import (
    Atom,
    Exists,
    ForAll,
    Formula,
    Kind,
    Not,
    Predicate,
    conjunction,
    disjunction,
    same,
)
from skiros2_task.core.goal_text import (
    GoalError,
    Name,
    ParsedAtom,
    ParsedComparison,
    ParsedEquality,
    ParsedGoal,
    ParsedJunction,
    ParsedNot,
    goal_error,
    parse_goals,
)
from skiros2_task.core.goal_values import value_problem
from skiros2_task.core.pddl_names import NameIndex, pddl_name
from skiros2_task.core.world import WorldView
from skiros2_world_model.core.vocabulary import Vocabulary

#: The class of a quantified variable without a type.
ANY_OBJECT = "sumo:Object"

Variables = dict[str, str]


class GoalReader:
    """Reads goals for a snapshot of the world."""

    def __init__(self, world: WorldView, predicates: Iterable[Predicate], vocabulary: Vocabulary | None = None) -> None:
        """
        :param predicates: of the conditions of skills.
        :param vocabulary: goals beyond its limits, `rdfs:domain` or `rdfs:range` are refused too; None: these are not
            checked, as the world model accepts such relations.
        """
        self._world = world
        self._known = list(predicates)
        self._vocabulary = vocabulary
        self._text = ""

    def read(self, text: str) -> Formula:
        """Returns the conjunction of the goals in a text. Adds templates that they name to the objects of the world.

        :raises GoalError: the text does not parse, has an unknown name, or compares a property with a value of
            another kind.
        """
        self._text = text
        return conjunction(self._goal(parsed, {}) for parsed in parse_goals(text))

    # -- names, collected on first use -------------------------------------------------------------------------

    @cached_property
    def _relations(self) -> NameIndex:
        return _prefixed(self._world.relations() | {p.name for p in self._known if p.kind is Kind.RELATION})

    @cached_property
    def _classes(self) -> NameIndex:
        return _prefixed(self._world.classes())

    @cached_property
    def _properties(self) -> NameIndex:
        kinds = (Kind.VALUE, Kind.HAS, Kind.COMPARES)
        return _prefixed(self._world.properties() | {p.name for p in self._known if p.kind in kinds})

    @cached_property
    def _booleans(self) -> set[str]:
        """The boolean properties."""
        values = (p for p in self._known if p.kind is Kind.VALUE)
        return self._world.boolean_properties() | {p.name for p in values if isinstance(p.value, bool)}

    @cached_property
    def _values(self) -> NameIndex:
        """The text values of properties, in skills and in the scene."""
        values = {(p.name, p.value) for p in self._known if p.kind is Kind.VALUE and isinstance(p.value, str)}
        values |= {(key, value) for key, value in self._world.texts() if key not in self._booleans}
        index = NameIndex()
        for prop, value in sorted(values):
            index.add(Predicate(Kind.VALUE, prop, value), value, f"{prop}_{value}", f"{local_name(prop)}_{value}")
        return index

    @cached_property
    def _objects(self) -> NameIndex:
        index = NameIndex()
        for name in self._world.objects:
            index.add(name, name)
        return index

    @cached_property
    def _labels(self) -> NameIndex:
        """The names of templates, and the labels of elements."""
        index = _prefixed(self._world.templates())
        for element in self._world.objects.values():
            if element.label:
                index.add(element.label, element.label)
        return index

    # -- formulas ----------------------------------------------------------------------------------------------

    def _goal(self, goal: ParsedGoal, variables: Variables) -> Formula:
        if isinstance(goal, ParsedAtom):
            return self._atom(goal, variables)
        if isinstance(goal, ParsedComparison):
            prop = self._named(self._properties, goal.property, "property")
            self._check_value(prop, goal.operator, goal.value, goal.property)
            predicate = self._equals(prop, goal.value)
            if goal.operator != "=":
                predicate = Predicate(Kind.COMPARES, prop, goal.value, goal.operator)
            return self._with_terms(predicate, (goal.subject,), variables)
        if isinstance(goal, ParsedEquality):
            choices = product(self._term(goal.one, variables), self._term(goal.other, variables))
            return disjunction(same(one, other) for one, other in choices)
        if isinstance(goal, ParsedNot):
            return Not(self._goal(goal.part, variables))
        if isinstance(goal, ParsedJunction):
            parts = [self._goal(part, variables) for part in goal.parts]
            return conjunction(parts) if goal.every else disjunction(parts)
        typed: list[tuple[str, str]] = []
        for variable, cls in goal.variables:
            typed.append((variable.text, ANY_OBJECT if cls is None else self._class(cls)))
        body = self._goal(goal.body, {**variables, **dict(typed)})
        return (ForAll if goal.every else Exists)(tuple(typed), body)

    def _atom(self, goal: ParsedAtom, variables: Variables) -> Formula:
        name, count = goal.predicate, len(goal.terms)
        if count == 2:
            relation = self._named(self._relations, name, "relation")
            return self._with_terms(Predicate(Kind.RELATION, relation), goal.terms, variables)
        if count == 1:
            predicates = self._unary(name)
            if len(predicates) == 1:
                return self._with_terms(predicates[0], goal.terms, variables)
            if predicates:
                choices = " or ".join(sorted(f"{p.name}_{p.value}" for p in predicates))
                raise self._error(name, f"{name.text!r} is a value of several properties; write {choices}")
            if self._relations.find(name.text):
                raise self._error(name, f"{name.text!r} is a relation: expected subject and object, found one name")
            if self._classes.find(name.text):
                raise self._error(name, f"{name.text!r} is a class; no skill changes the class of an element")
        elif not count:
            raise self._error(name, f"expected ({name.text} subject) or ({name.text} subject object), found no subject")
        else:
            raise self._error(name, f"expected one or two elements after {name.text!r}, found {count}")
        indices = (self._values, self._properties, self._relations)
        raise self._unknown(name, "predicate", indices, "a relation, a property's value or a truth property")

    def _unary(self, name: Name) -> list[Predicate]:
        """The predicates of one element that a name may mean."""
        text = name.text
        for prop in self._properties.find(text):
            if prop in self._booleans:
                return [Predicate(Kind.VALUE, str(prop), True)]
        values = [p for p in self._values.find(text) if isinstance(p, Predicate)]
        if values:
            return values
        if text.lower().startswith("has_") and len(self._properties.find(text[4:])) == 1:
            return [Predicate(Kind.HAS, str(self._properties.find(text[4:])[0]))]
        properties = self._properties.find(text)
        if len(properties) == 1:
            return [Predicate(Kind.HAS, str(properties[0]))]
        for cut in (i for i, char in enumerate(text) if char == "_"):
            found = self._properties.find(text[:cut])
            if len(found) == 1 and text[cut + 1 :]:
                self._check_value(str(found[0]), "=", text[cut + 1 :], name)
                return [self._equals(str(found[0]), text[cut + 1 :])]
        return []

    def _equals(self, prop: str, value: str | float) -> Predicate:
        """Returns the predicate that a property has a value."""
        if isinstance(value, float):
            return Predicate(Kind.COMPARES, prop, value, "=")
        known = [p for p in self._values.find(f"{prop}_{value}") if isinstance(p, Predicate)]
        if len(known) == 1:
            return known[0]
        truth = value.lower() in ("true", "false")
        return Predicate(Kind.VALUE, prop, value.lower() == "true" if truth else value)

    def _check_value(self, prop: str, operator: str, value: str | float, at: Name) -> None:
        """
        :raises GoalError: the property has values of another kind, or beyond the value.
        """
        kind, limits = self._world.value_type(prop) or (bool if prop in self._booleans else None), NO_LIMITS
        if self._vocabulary is not None:
            kind, limits = kind or self._vocabulary.value_type("", prop), self._vocabulary.limits(prop)
        if problem := value_problem(kind, operator, value, limits):
            raise self._error(at, f"{local_name(prop)}: {problem}")

    def _with_terms(self, predicate: Predicate, terms: tuple[Name, ...], variables: Variables) -> Formula:
        """Returns the disjunction of the predicate over all objects that the terms may denote."""
        objects = [self._term(term, variables) for term in terms]
        for side, (term, found) in enumerate(zip(terms, objects, strict=True)):
            types = [variables[name] if name in variables else self._world.objects[name].type for name in found]
            self._check_ends(predicate.name, types, side, term)
        return disjunction(Atom(predicate, choice) for choice in product(*objects))

    def _check_ends(self, name: str, types: Sequence[str], side: int, at: Name) -> None:
        """
        :param types: the classes of the objects that a term may denote.
        :param side: 0 for the subject, 1 for the object.
        :raises GoalError: none is in the domain or range of the predicate.
        """
        if self._vocabulary is None:
            return
        problems = [self._vocabulary.mismatch(*((cls, name, ""), ("", name, cls))[side]) for cls in types]
        if all(problems):
            raise self._error(at, f"{at.text}: {problems[0]}")

    # -- names -------------------------------------------------------------------------------------------------

    def _term(self, name: Name, variables: Variables) -> tuple[str, ...]:
        """Returns the objects that a name denotes: one, or all instances of a template."""
        if name.text.startswith("?"):
            if name.text not in variables:
                declared = f"; declared: {', '.join(variables)}" if variables else ""
                raise self._error(name, f"unknown variable {name.text!r}{declared}")
            return (name.text,)
        found = self._objects.find(name.text)
        if found:
            return (self._only(found, name),)
        labels = self._labels.find(name.text)
        if not labels:
            raise self._unknown_object(name)
        label = self._only(labels, name)
        instances = self._world.instances(label)
        if not instances:
            template = self._world.template(label)
            if template is None:
                raise self._unknown_object(name)
            self._world.add_template(label, template)
            self._objects.add(label, label)
            instances = [label]
        return tuple(instances)

    def _unknown_object(self, name: Name) -> GoalError:
        if self._classes.find(name.text):
            message = f"{name.text!r} is a class; for some element of it write (exists (?x - {name.text}) ...)"
            return self._error(name, message)
        indices = (self._objects, self._labels)
        return self._unknown(name, "element", indices, "the id of an element or the name of a template")

    def _class(self, name: Name) -> str:
        if pddl_name(name.text) == "object":
            return ANY_OBJECT
        return self._named(self._classes, name, "type")

    def _named(self, index: NameIndex, name: Name, what: str) -> str:
        found = index.find(name.text)
        if found:
            return self._only(found, name)
        expected = {"relation": "a relation", "property": "a property", "type": "a class of the ontology"}[what]
        raise self._unknown(name, what, (index,), expected)

    def _only(self, found: list[object], name: Name) -> str:
        if len(found) > 1:
            raise self._error(name, f"{name.text!r} may be {' or '.join(map(str, found))}; write one in full")
        return str(found[0])

    def _unknown(self, name: Name, what: str, indices: Iterable[NameIndex], expected: str) -> GoalError:
        near = list(dict.fromkeys(known for index in indices for known in index.near_matches(name.text)))[:4]
        hint = f"; did you mean {' or '.join(near)}?" if near else f"; expected {expected}"
        return self._error(name, f"unknown {what} {name.text!r}{hint}")

    def _error(self, at: Name, message: str) -> GoalError:
        return goal_error(self._text, at, message)


def _prefixed(names: Iterable[str]) -> NameIndex:
    index = NameIndex()
    for name in sorted(names):
        index.add_prefixed(name)
    return index
