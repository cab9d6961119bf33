"""Compiles skills, scene and goal to a planning task.

Passes: actions of the skills; existence of elements; relevance for the goal; candidates of the variables; expansion of
the goal's quantifiers; objects; facts.
"""

from __future__ import annotations

import operator
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

from skiros2_task.core.actions import Action, Effect, Variable, condition_predicates, make_actions
from skiros2_task.core.conditions import IN_SCENE, FactFamilies, Literal
from skiros2_task.core.formula import (
    FALSE,
    TRUE,
    Atom,
    Exists,
    ForAll,
    Formula,
    Kind,
    Not,
    Predicate,
    Variables,
    conjunction,
    disjunction,
    expand_quantifiers,
    fold,
    literal_formula,
    literals,
    rewrite,
)
from skiros2_task.core.task import EVERYTHING, PlanningTask
from skiros2_task.core.world import WorldView

_COMPARE: dict[str, Callable[[float, float], bool]] = {
    ">": operator.gt,
    "<": operator.lt,
    ">=": operator.ge,
    "<=": operator.le,
}

#: For each argument position of a predicate, the objects that a condition, effect or goal may have there.
_Domains = dict[Predicate, tuple[set[str], ...]]


def make_task(world: WorldView, goal: Formula) -> PlanningTask:
    """Returns the planning task for a goal in a world. Adds objects that skills may create to the world.

    :param goal: a result of `GoalReader.read`.
    """
    actions, notes = make_actions(world.robots)
    existence = _Existence(actions, world.is_subclass)
    mentioned = sorted(condition_predicates(world.robots) | {atom.predicate for atom, _ in literals(goal)}, key=str)
    guarded = [existence.guard_action(action, mentioned) for action in actions]
    families = FactFamilies((e.atom.predicate for a in guarded for e in a.effects), world.is_subproperty)
    part = relevant_part(guarded, existence.guard_goal(goal), families)
    part = _without_static_existence(part)
    for name, cls in existence.new_objects(part.actions, goal).items():
        world.add_new(name, cls)
    if part.left_out:
        notes.append(f"skills that cannot help with this goal are left out: {', '.join(part.left_out)}")
    actions, unusable = _with_candidates(part.actions, world)
    ground_goal = expand_quantifiers(part.goal, world.quantified)
    empty = _empty_classes(goal, world)
    notes += map(note_of_empty_class, empty)
    members = _members(actions, ground_goal, world)
    domains = _domains(actions, ground_goal, members)
    used = set(members[EVERYTHING])
    unused = Counter(e.type for name, e in world.objects.items() if name not in used)
    if unused:
        listed = ", ".join(f"{count} {cls}" for cls, count in sorted(unused.items()))
        notes.append(f"elements that neither a relevant skill nor the goal can use are left out: {listed}")
    return PlanningTask(
        actions=tuple(actions),
        objects={name: world.objects[name].type for name in members[EVERYTHING]},
        members=members,
        predicates=tuple(p for p in part.predicates if p in domains),
        init=frozenset(_facts(domains, actions, families, world)),
        goal=ground_goal,
        notes=(*notes, *unusable),
        empty_classes=empty,
    )


def note_of_empty_class(cls: str) -> str:
    """Returns a message about a class of the goal without instances."""
    return f"the scene has no element of class {cls}, which the goal names"


def _empty_classes(goal: Formula, world: WorldView) -> tuple[str, ...]:
    """Returns the classes of the goal's quantifiers that have no instance in the scene."""

    def joined(parts: Iterable[tuple[str, ...]]) -> tuple[str, ...]:
        return tuple(dict.fromkeys(cls for part in parts for cls in part))

    def quantifier(kind: type[ForAll | Exists], variables: Variables, inner: tuple[str, ...]) -> tuple[str, ...]:
        return joined([tuple(cls for _, cls in variables if not world.quantified(cls)), inner])

    return fold(goal, lambda atom, state: (), joined, joined, quantifier)


def _without_static_existence(part: Relevant) -> Relevant:
    """Removes `IN_SCENE` conditions if no relevant skill creates or removes elements."""
    if any(e.atom.predicate == IN_SCENE for a in part.actions for e in a.effects):
        return part
    return replace(
        part,
        actions=tuple(replace(a, precondition=_without_existence(a.precondition)) for a in part.actions),
        goal=_without_existence(part.goal),
        predicates=tuple(p for p in part.predicates if p != IN_SCENE),
    )


def _with_candidates(actions: Iterable[Action], world: WorldView) -> tuple[list[Action], list[str]]:
    """Returns the actions that have an object for each variable, and messages about the others."""
    usable, notes = [], []
    for action in actions:
        if action.precondition == FALSE:
            notes.append(f"skill {action.skill.name} cannot run: its pre-conditions can never hold")
            continue
        empty = [v for v in action.variables if not world.members_of_all(v.classes)]
        if empty:
            wanted = ", ".join(f"{v.key or v.name} ({' and '.join(v.classes)})" for v in empty)
            notes.append(f"skill {action.skill.name} cannot run: the scene has no element for {wanted}")
        else:
            usable.append(action)
    return usable, notes


def _members(actions: Sequence[Action], goal: Formula, world: WorldView) -> dict[str, tuple[str, ...]]:
    """Returns the objects of each class that a variable has; under `EVERYTHING`, all objects of the task."""
    classes = dict.fromkeys(cls for a in actions for v in a.variables for cls in v.classes)
    members = {cls: world.members(cls) for cls in classes}
    named: set[str] = {term for atom, _ in literals(goal) for term in atom.terms}
    for action in actions:
        own = {v.name for v in action.variables}
        for variable in action.variables:
            named |= world.members_of_all(variable.classes)
        atoms = [*(atom for atom, _ in literals(action.precondition)), *(e.atom for e in action.effects)]
        bound = own | {name for e in action.effects for name, _ in e.each}
        named |= {term for atom in atoms for term in atom.terms if term not in bound and term in world.objects}
    everything = tuple(name for name in world.objects if name in named)
    inside = set(everything)
    return {
        **{cls: tuple(name for name in names if name in inside) for cls, names in members.items()},
        EVERYTHING: everything,
    }


def _domains(actions: Sequence[Action], goal: Formula, members: dict[str, tuple[str, ...]]) -> _Domains:
    domains: _Domains = {}

    def add(atom: Atom, possible: dict[str, set[str]]) -> None:
        known = domains.setdefault(atom.predicate, tuple(set() for _ in atom.terms))
        for domain, term in zip(known, atom.terms, strict=True):
            if term in possible:
                domain |= possible[term]
            else:
                domain.add(term)

    for atom, _ in literals(goal):
        add(atom, {})
    for action in actions:
        possible = {v.name: set.intersection(*(set(members[cls]) for cls in v.classes)) for v in action.variables}
        for atom, _ in literals(action.precondition):
            add(atom, possible)
        for effect in action.effects:
            add(effect.atom, {**possible, **{name: set(members[cls]) for name, cls in effect.each}})
    return domains


def _facts(domains: _Domains, actions: Sequence[Action], families: FactFamilies, world: WorldView) -> Iterator[Atom]:
    """Yields the current facts over the domains of the predicates."""
    stated = world.stated_relations()
    for predicate, domain in domains.items():
        kind, name = predicate.kind, predicate.name
        if kind is Kind.RELATION:
            if world.computed(name):  # statements in the scene are ignored
                for pair in world.computed_pairs(name, sorted(domain[0]), sorted(domain[1])):
                    yield Atom(predicate, pair)
                continue
            tracked = families.tracked(name)
            for relation in stated:
                if relation == name or (relation not in tracked and world.is_subproperty(relation, name)):
                    for pair in world.pairs(relation):
                        if pair[0] in domain[0] and pair[1] in domain[1]:
                            yield Atom(predicate, pair)
        elif kind is Kind.ALLOWED:
            yield from (Atom(predicate, pair) for pair in world.allowed_pairs(name, domain[0], domain[1]))
        elif kind is Kind.CAN:
            robots = {robot for a in actions if a.name == name for robot, _ in a.managers}
            yield from (Atom(predicate, (robot,)) for robot in robots & domain[0])
        else:
            yield from (Atom(predicate, (obj,)) for obj in domain[0] if _is_true(predicate, obj, world))


def _is_true(predicate: Predicate, name: str, world: WorldView) -> bool:
    element = world.objects[name]
    if predicate.kind is Kind.IN_SCENE:
        return name not in world.to_create
    if predicate.kind is Kind.IS_A:
        return world.is_a(name, predicate.name)
    if predicate.kind is Kind.HAS:
        return element.hasProperty(predicate.name, not_none=True)
    if predicate.kind is Kind.VALUE or predicate.operator == "=":
        return element.hasProperty(predicate.name, predicate.value)
    try:
        return _COMPARE[predicate.operator](float(element.value_of(predicate.name)), float(predicate.value or 0.0))
    except (TypeError, ValueError):
        return False  # missing, or not a number


@dataclass(frozen=True)
class Relevant:
    """The part of a domain that is relevant for a goal.

    :param actions: with pre-conditions in negation normal form and effects on `predicates` only.
    :param goal: in negation normal form.
    :param predicates: of pre-conditions and goal, in a stable order.
    :param left_out: the names of the other actions.
    """

    actions: tuple[Action, ...]
    goal: Formula
    predicates: tuple[Predicate, ...]
    left_out: tuple[str, ...]


def relevant_part(actions: Sequence[Action], goal: Formula, families: FactFamilies) -> Relevant:
    """Returns the relevant actions, found by backward search from the goal.

    An action is relevant if one of its effects makes a literal true that the goal or the pre-condition of a relevant
    action needs. Other actions occur only in plans with redundant steps.
    """
    normal = [replace(a, precondition=rewrite(a.precondition, families.literal)) for a in actions]
    goal = rewrite(goal, families.literal)
    needed: dict[Literal, None] = {}
    _add_needed(goal, needed)
    chosen: set[str] = set()
    growing = True
    while growing:
        growing = False
        for action in normal:
            if action.name not in chosen and _produces(action, needed, families):
                chosen.add(action.name)
                _add_needed(action.precondition, needed)
                growing = True
    predicates = tuple(dict.fromkeys(predicate for predicate, _ in needed))
    kept = tuple(
        replace(
            a,
            effects=_consequences(a.effects, predicates, families),
            during=_consequences(a.during, predicates, families),
        )
        for a in normal
        if a.name in chosen
    )
    return Relevant(kept, goal, predicates, tuple(a.name for a in actions if a.name not in chosen))


def _add_needed(formula: Formula, needed: dict[Literal, None]) -> None:
    for atom, state in literals(formula):
        needed[(atom.predicate, state)] = None


def _produces(action: Action, needed: dict[Literal, None], families: FactFamilies) -> bool:
    predicates = {predicate for predicate, _ in needed}
    return any(
        literal in needed
        for effect in action.effects
        for literal in families.consequences(effect.atom.predicate, effect.state, predicates)
    )


def _consequences(
    effects: Sequence[Effect], predicates: Sequence[Predicate], families: FactFamilies
) -> tuple[Effect, ...]:
    """Returns the effects on relevant predicates. An atom that is made both true and false is true, as in PDDL."""
    found: dict[tuple[Atom, tuple[tuple[str, str], ...]], bool] = {}
    for effect in effects:
        for predicate, state in families.consequences(effect.atom.predicate, effect.state, predicates):
            key = (Atom(predicate, effect.atom.terms), effect.each)
            found[key] = state or found.get(key, False)
    return tuple(Effect(atom, state, each) for (atom, each), state in found.items())


# -- elements that skills create or remove ----------------------------------------------------------------------------


class _Existence:
    """The classes whose elements some skill creates or removes."""

    def __init__(self, actions: Sequence[Action], is_subclass: Callable[[str, str], bool]) -> None:
        self._is_subclass = is_subclass
        self._changing = [
            cls for a in actions for v in a.variables if v.name in a.created | a.removed for cls in v.classes
        ]

    def may_change(self, classes: Iterable[str]) -> bool:
        """Whether an element of these classes may be created or removed."""
        return any(
            self._is_subclass(cls, other) or self._is_subclass(other, cls)
            for cls in classes
            for other in self._changing
        )

    def guard_action(self, action: Action, predicates: Iterable[Predicate]) -> Action:
        """Returns the action with the pre-condition that its elements exist; a removed element loses all its facts.

        :param predicates: of all conditions and the goal.
        """
        if not self._changing:
            return action
        guards = [
            Atom(IN_SCENE, (v.name,))
            for v in action.variables
            if v.name not in action.created and self.may_change(v.classes)
        ]
        lost = [e for term in sorted(action.removed) for e in _losses(term, predicates)]
        return replace(
            action,
            precondition=conjunction([action.precondition, *guards]),
            effects=(*action.effects, *lost),
        )

    def guard_goal(self, goal: Formula) -> Formula:
        """Returns the goal with its quantifiers restricted to existing elements."""

        def guarded(kind: type[ForAll | Exists], variables: Variables, body: Formula) -> Formula:
            guards = [Atom(IN_SCENE, (name,)) for name, cls in variables if self.may_change([cls])]
            if kind is ForAll:
                return ForAll(variables, disjunction([*(Not(g) for g in guards), body]))
            return Exists(variables, conjunction([*guards, body]))

        return fold(goal, literal_formula, conjunction, disjunction, guarded)

    def new_objects(self, actions: Iterable[Action], goal: Formula) -> dict[str, str]:
        """Returns names and classes of objects for elements that skills may create, enough for the goal's `exists`."""
        found: dict[str, str] = {}
        for action in actions:
            for variable in action.variables:
                if variable.name in action.created:
                    cls = self._narrowest(variable)
                    for number in range(1, max(1, _count_exists(goal)) + 1):
                        found[f"new {cls} {number}"] = cls
        return found

    def _narrowest(self, variable: Variable) -> str:
        for cls in variable.classes:
            if all(self._is_subclass(cls, other) for other in variable.classes):
                return cls
        return variable.classes[0]


def _without_existence(formula: Formula) -> Formula:
    """Returns the formula simplified for a scene in which all elements exist permanently."""

    def literal(atom: Atom, state: bool) -> Formula:
        if atom.predicate == IN_SCENE:
            return TRUE if state else FALSE
        return literal_formula(atom, state)

    return rewrite(formula, literal)


def _losses(term: str, predicates: Iterable[Predicate]) -> list[Effect]:
    """Returns the effects of the removal of an element on its facts."""
    found: dict[Effect, None] = {}
    for predicate in predicates:
        if predicate.kind is Kind.RELATION:
            for terms in ((term, "?other"), ("?other", term)):
                found[Effect(Atom(predicate, terms), False, (("?other", EVERYTHING),))] = None
        elif predicate.kind in (Kind.VALUE, Kind.HAS, Kind.COMPARES):
            found[Effect(Atom(Predicate(Kind.HAS, predicate.name), (term,)), False)] = None
    return list(found)


def _count_exists(goal: Formula) -> int:
    def total(counts: Iterable[int]) -> int:
        return sum(counts)

    def quantifier(kind: type[ForAll | Exists], variables: Variables, count: int) -> int:
        return count + (len(variables) if kind is Exists else 0)

    return fold(goal, lambda atom, state: 0, total, total, quantifier)
