"""The planning task for a goal, made from the skills and the scene."""

from __future__ import annotations

import operator
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace

from skiros2_task.core.actions import IN_SCENE, Action, condition_predicates, make_actions
from skiros2_task.core.concurrency import needs_concurrency
from skiros2_task.core.effects import FactFamilies
from skiros2_task.core.existence import Existence, without_existence
from skiros2_task.core.formula import (
    FALSE,
    Atom,
    Exists,
    ForAll,
    Formula,
    Kind,
    Not,
    Predicate,
    expand_quantifiers,
    literals,
)
from skiros2_task.core.relevance import Relevant, relevant_part
from skiros2_task.core.task import EVERYTHING, PlanningTask
from skiros2_task.core.world_view import WorldView

_COMPARE: dict[str, Callable[[float, float], bool]] = {
    ">": operator.gt,
    "<": operator.lt,
    ">=": operator.ge,
    "<=": operator.le,
}

#: For each place of a predicate's terms, the objects that some condition, effect or goal may have there.
Places = dict[Predicate, tuple[set[str], ...]]


def make_task(world: WorldView, goal: Formula) -> PlanningTask:
    """The planning task for a goal over a world.

    :param goal: as `GoalReader.read` gives it.

    Objects that stand for what skills may make are added to the world.
    """
    actions, notes = make_actions(world.robots)
    existence = Existence(actions, world.is_subclass)
    spoken = sorted(condition_predicates(world.robots) | {atom.predicate for atom, _ in literals(goal)}, key=str)
    guarded = [existence.guard_action(action, spoken) for action in actions]
    families = FactFamilies((e.atom.predicate for a in guarded for e in a.effects), world.is_subproperty)
    part = relevant_part(guarded, existence.guard_goal(goal), families)
    part = _settle_existence(part)
    for name, cls in existence.new_objects(part.actions, goal).items():
        world.add_new(name, cls)
    if part.left_out:
        notes.append(f"skills that cannot help with this goal are left out: {', '.join(part.left_out)}")
    actions, unusable = _with_candidates(part.actions, world)
    ground_goal = expand_quantifiers(part.goal, world.quantified)
    notes += [f"the scene has nothing of class {cls}, of which the goal speaks" for cls in _empty_classes(goal, world)]
    members = _members(actions, ground_goal, world)
    places = _places(actions, ground_goal, members)
    used = set(members[EVERYTHING])
    unused = Counter(e.type for name, e in world.objects.items() if name not in used)
    if unused:
        listed = ", ".join(f"{count} {cls}" for cls, count in sorted(unused.items()))
        notes.append(f"elements that no skill takes that can help, nor the goal names, are left out: {listed}")
    task = PlanningTask(
        actions=tuple(actions),
        objects={name: world.objects[name].type for name in members[EVERYTHING]},
        members=members,
        predicates=tuple(p for p in part.predicates if p in places),
        init=frozenset(_facts(places, actions, families, world)),
        goal=ground_goal,
        notes=(*notes, *unusable),
    )
    return replace(task, concurrent=needs_concurrency(task, guarded, families))


def _empty_classes(goal: Formula, world: WorldView) -> list[str]:
    """The classes of the goal's quantifiers that nothing in the scene is of."""
    if isinstance(goal, Atom):
        return []
    if isinstance(goal, ForAll | Exists):
        classes = [cls for _, cls in goal.variables if not world.quantified(cls)] + _empty_classes(goal.body, world)
    else:
        parts = (goal.part,) if isinstance(goal, Not) else goal.parts
        classes = [cls for part in parts for cls in _empty_classes(part, world)]
    return list(dict.fromkeys(classes))


def _settle_existence(part: Relevant) -> Relevant:
    """Without the question of what is in the scene, where no skill that matters changes the answer."""
    if any(e.atom.predicate == IN_SCENE for a in part.actions for e in a.effects):
        return part
    return replace(
        part,
        actions=tuple(replace(a, precondition=without_existence(a.precondition)) for a in part.actions),
        goal=without_existence(part.goal),
        predicates=tuple(p for p in part.predicates if p != IN_SCENE),
    )


def _with_candidates(actions: Iterable[Action], world: WorldView) -> tuple[list[Action], list[str]]:
    """The actions that have an object for each variable, and in words why the others have not."""
    usable, notes = [], []
    for action in actions:
        if action.precondition == FALSE:
            notes.append(f"skill {action.skill.name} cannot run: its pre-conditions can never hold")
            continue
        empty = [v for v in action.variables if not _all_of(v.classes, world)]
        if empty:
            wanted = ", ".join(f"{v.key or v.name} ({' and '.join(v.classes)})" for v in empty)
            notes.append(f"skill {action.skill.name} cannot run: the scene has nothing for {wanted}")
        else:
            usable.append(action)
    return usable, notes


def _all_of(classes: Sequence[str], world: WorldView) -> set[str]:
    return set.intersection(*(set(world.members(cls)) for cls in classes))


def _members(actions: Sequence[Action], goal: Formula, world: WorldView) -> dict[str, tuple[str, ...]]:
    """The objects of each class that a variable names; under `EVERYTHING`, all objects of the task."""
    classes = dict.fromkeys(cls for a in actions for v in a.variables for cls in v.classes)
    members = {cls: world.members(cls) for cls in classes}
    named: set[str] = {term for atom, _ in literals(goal) for term in atom.terms}
    for action in actions:
        own = {v.name for v in action.variables}
        for variable in action.variables:
            named |= _all_of(variable.classes, world)
        atoms = [*(atom for atom, _ in literals(action.precondition)), *(e.atom for e in action.effects)]
        bound = own | {name for e in action.effects for name, _ in e.each}
        named |= {term for atom in atoms for term in atom.terms if term not in bound and term in world.objects}
    everything = tuple(name for name in world.objects if name in named)
    inside = set(everything)
    return {
        **{cls: tuple(name for name in names if name in inside) for cls, names in members.items()},
        EVERYTHING: everything,
    }


def _places(actions: Sequence[Action], goal: Formula, members: dict[str, tuple[str, ...]]) -> Places:
    places: Places = {}

    def note(atom: Atom, possible: dict[str, set[str]]) -> None:
        there = places.setdefault(atom.predicate, tuple(set() for _ in atom.terms))
        for place, term in zip(there, atom.terms, strict=True):
            if term in possible:
                place |= possible[term]
            else:
                place.add(term)

    for atom, _ in literals(goal):
        note(atom, {})
    for action in actions:
        possible = {v.name: set.intersection(*(set(members[cls]) for cls in v.classes)) for v in action.variables}
        for atom, _ in literals(action.precondition):
            note(atom, possible)
        for effect in action.effects:
            note(effect.atom, {**possible, **{name: set(members[cls]) for name, cls in effect.each}})
    return places


def _facts(places: Places, actions: Sequence[Action], families: FactFamilies, world: WorldView) -> Iterator[Atom]:
    """The facts that hold now, of predicates and objects that something asks for."""
    written = world.written_relations()
    for predicate, place in places.items():
        kind, name = predicate.kind, predicate.name
        if kind is Kind.RELATION:
            if world.computed(name):  # what the scene says of it does not count
                for pair in world.computed_pairs(name, sorted(place[0]), sorted(place[1])):
                    yield Atom(predicate, pair)
                continue
            tracked = families.tracked(name)
            for relation in written:
                if relation == name or (relation not in tracked and world.is_subproperty(relation, name)):
                    for pair in world.pairs(relation):
                        if pair[0] in place[0] and pair[1] in place[1]:
                            yield Atom(predicate, pair)
        elif kind is Kind.ALLOWED:
            yield from (Atom(predicate, pair) for pair in world.allowed_pairs(name, place[0], place[1]))
        elif kind is Kind.CAN:
            robots = {robot for a in actions if a.name == name for robot, _ in a.managers}
            yield from (Atom(predicate, (robot,)) for robot in robots & place[0])
        else:
            yield from (Atom(predicate, (obj,)) for obj in place[0] if _is_true(predicate, obj, world))


def _is_true(predicate: Predicate, name: str, world: WorldView) -> bool:
    element = world.objects[name]
    if predicate.kind is Kind.IN_SCENE:
        return name not in world.to_be_made
    if predicate.kind is Kind.IS_A:
        return world.is_a(name, predicate.name)
    if predicate.kind is Kind.HAS:
        return element.hasProperty(predicate.name, not_none=True)
    if predicate.kind is Kind.VALUE or predicate.operator == "=":
        return element.hasProperty(predicate.name, predicate.value)
    try:
        return _COMPARE[predicate.operator](float(element.value_of(predicate.name)), float(predicate.value or 0.0))
    except (TypeError, ValueError):
        return False  # missing, or no number
