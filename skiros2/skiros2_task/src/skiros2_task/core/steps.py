"""The steps of a plan as the goal executor runs them, independent of the planning task."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

from skiros2_task.core.actions import IN_SCENE
from skiros2_task.core.formula import Atom, Formula, Kind, Predicate, conjuncts, holds, literals
from skiros2_task.core.plan import SkillCall
from skiros2_task.core.schedule import Schedule
from skiros2_task.core.semantics import Facts, apply_effects
from skiros2_task.core.skills import Skill
from skiros2_task.core.task import PlanningTask, during_of, effects_of, precondition_of


@dataclass(frozen=True)
class Step:
    """A step of a plan.

    :param number: unique among all steps of a goal.
    :param precondition: must hold when the step starts.
    :param effects: (fact, value) pairs.
    :param after: numbers of the steps that must end before this one starts.
    :param uses: the resources of the step: the manager of its robot, and the devices that it locks.
    :param start, end: scheduled times (s after the plan's start).
    """

    number: int
    call: SkillCall
    skill: Skill
    precondition: Formula
    effects: tuple[tuple[Atom, bool], ...]
    after: frozenset[int] = frozenset()
    uses: frozenset[str] = frozenset()
    start: float = 0.0
    end: float = 0.0

    def __str__(self) -> str:
        return f"step {self.number}, {self.call}"

    def apply(self, facts: Facts) -> Facts:
        """Returns the facts after this step."""
        return apply_effects(facts, self.effects)

    def interferes(self, other: Step) -> bool:
        """Whether the steps share a resource, or one changes a fact that the other needs or changes."""
        changed, needed = self._facts()
        others_changed, others_needed = other._facts()
        return bool(
            self.uses & other.uses or changed & others_changed or changed & others_needed or others_changed & needed
        )

    def _facts(self) -> tuple[set[Atom], set[Atom]]:
        """Returns the facts that the step changes and those that it needs."""
        return {atom for atom, _ in self.effects}, {atom for atom, _ in literals(self.precondition)}


def make_steps(task: PlanningTask, plan: Schedule, calls: Sequence[SkillCall], first: int) -> tuple[Step, ...]:
    """Returns the steps of a plan in an executable order.

    :param calls: one for each step of the plan.
    :param first: the number of the first step.
    """
    before = plan.order.predecessors()
    return tuple(
        Step(
            number=first + scheduled.step,
            call=call,
            skill=task.action(step.action).skill,
            precondition=precondition_of(task, step),
            effects=tuple(effects_of(task, step)),
            after=frozenset(first + i for i in before[scheduled.step]),
            uses=frozenset({call.manager, *(atom.terms[0] for atom, _ in during_of(task, step))}),
            start=scheduled.start,
            end=scheduled.end,
        )
        for step, call, scheduled in zip(plan.order.steps, calls, plan.steps, strict=True)
    )


def format_unsatisfied(formula: Formula, facts: Facts) -> str:
    """Returns the parts of a formula that do not hold, as text; "" if the formula holds."""
    return ", ".join(str(part) for part in conjuncts(formula) if not holds(part, facts))


def objects_in_scene(facts: Facts) -> frozenset[str]:
    """Returns the objects in the scene, of those that skills create or remove."""
    return frozenset(atom.terms[0] for atom in facts if atom.predicate == IN_SCENE)


def objects_to_create(task: PlanningTask) -> frozenset[str]:
    """Returns the objects of a task that skills have yet to create."""
    return frozenset(task.objects) - objects_in_scene(task.init) if IN_SCENE in task.predicates else frozenset()


def with_steps_done(task: PlanningTask, steps: Iterable[Step]) -> PlanningTask:
    """Returns the task as it will be when these steps have succeeded."""
    facts = task.init
    for step in steps:
        facts = step.apply(facts)
    known = frozenset(a for a in facts if a.predicate in task.predicates and all(t in task.objects for t in a.terms))
    return replace(task, init=known)


def without_skills(task: PlanningTask, avoided: Iterable[tuple[str, str]]) -> PlanningTask:
    """Returns the task without some skills of some robots.

    :param avoided: (manager, skill label) pairs; the label "" means all skills of the manager.
    """
    removed = set(avoided)
    facts = {
        Atom(Predicate(Kind.CAN, action.name), (robot,))
        for action in task.actions
        for robot, manager in action.managers
        if removed & {(manager, action.skill.label), (manager, "")}
    }
    return replace(task, init=task.init - facts)
