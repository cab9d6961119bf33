"""The planning task: domain and problem, over names of the ontology and ids of elements."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property

from skiros2_task.core.actions import Action
from skiros2_task.core.conditions import IN_SCENE
from skiros2_task.core.formula import Atom, Formula, Kind, Predicate, holds
from skiros2_task.core.semantics import Grounder, GroundStep, unsatisfied

#: The class of all objects of a task.
EVERYTHING = "*"


@dataclass(frozen=True)
class PlanningTask:
    """A domain and a problem.

    :param objects: the class of each object, by name (an element's id, a template's name, or a generated name).
    :param members: the objects of each class that a variable has.
    :param predicates: all predicates that occur.
    :param init: the initial facts; all other atoms are false.
    :param goal: without variables.
    :param notes: messages about what was excluded, and why.
    :param empty_classes: the classes of the goal that have no instance in the scene.
    """

    actions: tuple[Action, ...]
    objects: Mapping[str, str]
    members: Mapping[str, tuple[str, ...]]
    predicates: tuple[Predicate, ...]
    init: frozenset[Atom]
    goal: Formula
    notes: tuple[str, ...] = ()
    empty_classes: tuple[str, ...] = ()

    @property
    def satisfied(self) -> bool:
        """Whether the goal holds initially."""
        return holds(self.goal, self.init)

    def action(self, name: str) -> Action:
        """Returns an action.

        :raises KeyError: there is no action of that name.
        """
        return self._actions_by_name[name]

    @cached_property
    def _actions_by_name(self) -> dict[str, Action]:
        return {action.name: action for action in self.actions}

    @cached_property
    def _grounders(self) -> dict[str, Grounder]:
        return {}

    def __getstate__(self) -> dict[str, object]:
        return {f.name: getattr(self, f.name) for f in fields(self)}  # without cached values

    def grounder(self, action: str) -> Grounder:
        """Returns the grounder of an action.

        :raises KeyError: there is no action of that name.
        """
        if action not in self._grounders:
            self._grounders[action] = Grounder(self.action(action), self.members)
        return self._grounders[action]

    def ground(self, step: PlanStep) -> GroundStep:
        """Returns what a step needs and changes.

        :raises KeyError: there is no such action.
        """
        return self.grounder(step.action).ground(step.arguments)

    @cached_property
    def changed(self) -> frozenset[Predicate]:
        """The predicates that some action changes, also only while its skill runs."""
        return frozenset(e.atom.predicate for a in self.actions for e in (*a.effects, *a.during))

    def candidates(self, classes: Sequence[str]) -> list[str]:
        """Returns the objects that are instances of all these classes."""
        first, *others = (self.members[cls] for cls in classes)
        inside = [set(other) for other in others]
        return [name for name in first if all(name in other for other in inside)]

    @property
    def objects_to_create(self) -> frozenset[str]:
        """The objects that skills have yet to create."""
        return frozenset(self.objects) - objects_in_scene(self.init) if IN_SCENE in self.predicates else frozenset()

    def after(self, facts: frozenset[Atom]) -> PlanningTask:
        """Returns the task that starts with these facts, as far as it knows their predicates and objects."""
        known = (a for a in facts if a.predicate in self.predicates and all(t in self.objects for t in a.terms))
        return replace(self, init=frozenset(known))

    def without_skills(self, avoided: Iterable[tuple[str, str]]) -> PlanningTask:
        """Returns the task without some skills of some robots.

        :param avoided: (manager, skill label) pairs; the label "" means all skills of the manager.
        """
        removed = set(avoided)
        facts = {
            Atom(Predicate(Kind.CAN, action.name), (robot,))
            for action in self.actions
            for robot, manager in action.managers
            if removed & {(manager, action.skill.label), (manager, "")}
        }
        return replace(self, init=self.init - facts)


def objects_in_scene(facts: Iterable[Atom]) -> frozenset[str]:
    """Returns the objects in the scene, of those that skills create or remove."""
    return frozenset(atom.terms[0] for atom in facts if atom.predicate == IN_SCENE)


@dataclass(frozen=True)
class PlanStep:
    """An action with an object for each of its variables."""

    action: str
    arguments: tuple[str, ...]

    def __str__(self) -> str:
        return f"({' '.join((self.action, *self.arguments))})"


def validate(task: PlanningTask, plan: Iterable[PlanStep]) -> str:
    """Returns why a plan does not lead from the task's initial facts to its goal; "" if it does."""
    facts = set(task.init)
    for number, step in enumerate(plan, 1):
        reason = _why_impossible(task, step)
        if reason:
            return f"step {number}{reason}"
        grounded = task.ground(step)
        if not grounded.can_start(facts):
            return f"step {number} {step}: {unsatisfied(grounded.precondition, facts, 3)} does not hold"
        for atom, state in grounded.effects.items():
            (facts.add if state else facts.discard)(atom)
    missing = unsatisfied(task.goal, facts, 3)
    return f"at the end {missing} does not hold" if missing else ""


def _why_impossible(task: PlanningTask, step: PlanStep) -> str:
    """Returns why the task has no such step; "" if it has."""
    try:
        variables = task.action(step.action).variables
    except KeyError:
        return f": there is no action {step.action!r}"
    if len(step.arguments) != len(variables):
        return f" {step}: expected {len(variables)} arguments"
    for variable, argument, objects in zip(variables, step.arguments, task.grounder(step.action).objects, strict=True):
        if argument not in objects:
            return f" {step}: {argument} is not a {' and '.join(variable.classes)}"
    return ""
