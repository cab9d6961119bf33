"""The planning task: all that a planner is told, over the ontology's names and the ids of elements."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import product

from skiros2_task.core.actions import Action, Effect
from skiros2_task.core.formula import Atom, Formula, Predicate, bind, expand_quantifiers, holds

#: Stands for the class of all objects of a task.
EVERYTHING = "*"


@dataclass(frozen=True)
class PlanningTask:
    """A domain and a problem.

    :param actions: what may be done.
    :param objects: the class of each object, by its name (an element's id, a template's name, or a name made up).
    :param members: the objects of each class that a variable names.
    :param predicates: all that occur.
    :param init: the facts that hold at the start; all others do not.
    :param goal: what has to hold at the end, without variables.
    :param notes: in words, what was left out and why.
    :param concurrent: in words, what is needed though it holds only while a skill runs: steps one after the other
        cannot have that.
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
        """Whether the goal holds at the start."""
        return holds(self.goal, self.init)

    def action(self, name: str) -> Action:
        """The action of that name.

        :raises KeyError: there is none.
        """
        return self._by_name[name]

    def candidates(self, classes: Sequence[str]) -> list[str]:
        """The objects that are of all these classes."""
        first, *others = (self.members[cls] for cls in classes)
        inside = [set(other) for other in others]
        return [name for name in first if all(name in other for other in inside)]


@dataclass(frozen=True)
class PlanStep:
    """An action with an object for each of its variables, in their order."""

    action: str
    arguments: tuple[str, ...]

    def __str__(self) -> str:
        return f"({' '.join((self.action, *self.arguments))})"


def effects_of(task: PlanningTask, step: PlanStep) -> Iterator[tuple[Atom, bool]]:
    """What a step makes true or false."""
    return _ground(task, step, task.action(step.action).effects)


def during_of(task: PlanningTask, step: PlanStep) -> Iterator[tuple[Atom, bool]]:
    """What a step makes true or false when it starts, and takes back when it ends."""
    return _ground(task, step, task.action(step.action).during)


def precondition_of(task: PlanningTask, step: PlanStep) -> Formula:
    """What has to hold when a step starts, and must not be spoiled while it runs."""
    action = task.action(step.action)
    return expand_quantifiers(bind(action.precondition, _values(action, step)), task.members.__getitem__)


def robot_of(task: PlanningTask, step: PlanStep) -> str:
    """The robot that does a step."""
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
