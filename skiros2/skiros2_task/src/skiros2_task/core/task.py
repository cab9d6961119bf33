"""The planning task: domain and problem, over names of the ontology and ids of elements."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import product

from skiros2_task.core.actions import Action, Effect
from skiros2_task.core.formula import Atom, Formula, Predicate, bind, expand_quantifiers, holds

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
    :param concurrent: messages about needed facts that hold only while a skill runs, see `concurrency`.
    """

    actions: tuple[Action, ...]
    objects: Mapping[str, str]
    members: Mapping[str, tuple[str, ...]]
    predicates: tuple[Predicate, ...]
    init: frozenset[Atom]
    goal: Formula
    notes: tuple[str, ...] = ()
    concurrent: tuple[str, ...] = ()
    _by_name: dict[str, Action] = field(init=False, compare=False, repr=False, default_factory=dict)

    def __post_init__(self) -> None:
        self._by_name.update({a.name: a for a in self.actions})

    @property
    def satisfied(self) -> bool:
        """Whether the goal holds initially."""
        return holds(self.goal, self.init)

    def action(self, name: str) -> Action:
        """Returns an action.

        :raises KeyError: there is no action of that name.
        """
        return self._by_name[name]

    def candidates(self, classes: Sequence[str]) -> list[str]:
        """Returns the objects that are instances of all these classes."""
        first, *others = (self.members[cls] for cls in classes)
        inside = [set(other) for other in others]
        return [name for name in first if all(name in other for other in inside)]


@dataclass(frozen=True)
class PlanStep:
    """An action with an object for each of its variables."""

    action: str
    arguments: tuple[str, ...]

    def __str__(self) -> str:
        return f"({' '.join((self.action, *self.arguments))})"


def effects_of(task: PlanningTask, step: PlanStep) -> Iterator[tuple[Atom, bool]]:
    """Yields the effects of a step."""
    return _ground(task, step, task.action(step.action).effects)


def during_of(task: PlanningTask, step: PlanStep) -> Iterator[tuple[Atom, bool]]:
    """Yields the effects of a step that last only while it runs."""
    return _ground(task, step, task.action(step.action).during)


def precondition_of(task: PlanningTask, step: PlanStep) -> Formula:
    """Returns the formula that must hold when a step starts and until it ends."""
    action = task.action(step.action)
    return expand_quantifiers(bind(action.precondition, _values(action, step)), task.members.__getitem__)


def robot_of(task: PlanningTask, step: PlanStep) -> str:
    """Returns the robot that executes a step."""
    action = task.action(step.action)
    return _values(action, step)[action.robot]


def _ground(task: PlanningTask, step: PlanStep, effects: Iterable[Effect]) -> Iterator[tuple[Atom, bool]]:
    values = _values(task.action(step.action), step)
    for effect in effects:
        for choice in product(*(task.members[cls] for _, cls in effect.each)):
            chosen = {**values, **{name: obj for (name, _), obj in zip(effect.each, choice, strict=True)}}
            yield Atom(effect.atom.predicate, tuple(chosen.get(t, t) for t in effect.atom.terms)), effect.state


def _values(action: Action, step: PlanStep) -> dict[str, str]:
    return {v.name: argument for v, argument in zip(action.variables, step.arguments, strict=True)}
