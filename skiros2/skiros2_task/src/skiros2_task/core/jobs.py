"""The steps of a plan with all that their execution goes by, beyond the task that they were planned with."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

from skiros2_task.core.actions import IN_SCENE
from skiros2_task.core.formula import Atom, Formula, Kind, Predicate, conjuncts, holds, literals
from skiros2_task.core.plan import SkillCall
from skiros2_task.core.schedule import Schedule
from skiros2_task.core.skill_model import Skill
from skiros2_task.core.task import PlanningTask, during_of, effects_of, precondition_of

Facts = frozenset[Atom]


@dataclass(frozen=True)
class Job:
    """A step of a plan.

    :param number: tells it from all other jobs of a goal.
    :param needs: what has to hold when it starts.
    :param makes: the facts that it makes true or false.
    :param after: the numbers of the jobs that have to end before it starts.
    :param uses: the manager of its robot, and the devices that it locks.
    :param start, end: when it is scheduled (s after the plan's start).
    """

    number: int
    call: SkillCall
    skill: Skill
    needs: Formula
    makes: tuple[tuple[Atom, bool], ...]
    after: frozenset[int] = frozenset()
    uses: frozenset[str] = frozenset()
    start: float = 0.0
    end: float = 0.0

    def __str__(self) -> str:
        return f"step {self.number}, {self.call}"

    def disturbs(self, other: Job) -> bool:
        """Whether one may have to wait for the other: they use the same, or one changes what the other speaks of."""
        makes, others = {atom for atom, _ in self.makes}, {atom for atom, _ in other.makes}
        return bool(
            self.uses & other.uses
            or makes & others
            or makes & {atom for atom, _ in literals(other.needs)}
            or others & {atom for atom, _ in literals(self.needs)}
        )


def make_jobs(task: PlanningTask, plan: Schedule, calls: Sequence[SkillCall], first: int) -> tuple[Job, ...]:
    """The jobs of a plan, in an order that works.

    :param calls: one for each of the plan's steps.
    :param first: the number of the first one.
    """
    before = plan.order.predecessors()
    return tuple(
        Job(
            number=first + when.step,
            call=call,
            skill=task.action(step.action).skill,
            needs=precondition_of(task, step),
            makes=tuple(effects_of(task, step)),
            after=frozenset(first + i for i in before[when.step]),
            uses=frozenset({call.manager, *(atom.terms[0] for atom, _ in during_of(task, step))}),
            start=when.start,
            end=when.end,
        )
        for step, call, when in zip(plan.order.steps, calls, plan.steps, strict=True)
    )


def carried_out(facts: Facts, job: Job) -> Facts:
    """The facts after a job. A fact made both true and false is true."""
    return (facts - {atom for atom, value in job.makes if not value}) | {atom for atom, value in job.makes if value}


def unmet(formula: Formula, facts: Facts) -> str:
    """The parts of a formula that do not hold, in words; "" when it holds."""
    return ", ".join(str(part) for part in conjuncts(formula) if not holds(part, facts))


def in_scene(facts: Facts) -> frozenset[str]:
    """Of the objects that skills make or remove, those that are there."""
    return frozenset(atom.terms[0] for atom in facts if atom.predicate == IN_SCENE)


def to_be_made(task: PlanningTask) -> frozenset[str]:
    """The objects of a task that are not there yet."""
    return frozenset(task.objects) - in_scene(task.init) if IN_SCENE in task.predicates else frozenset()


def with_jobs_done(task: PlanningTask, jobs: Iterable[Job]) -> PlanningTask:
    """The task as it will be when these jobs have ended well."""
    facts = task.init
    for job in jobs:
        facts = carried_out(facts, job)
    known = frozenset(a for a in facts if a.predicate in task.predicates and all(t in task.objects for t in a.terms))
    return replace(task, init=known)


def without_skills(task: PlanningTask, avoided: Iterable[tuple[str, str]]) -> PlanningTask:
    """The task in which some robots have not got some of their skills.

    :param avoided: (manager, label of the skill) pairs; the label "" means all skills.
    """
    gone = set(avoided)
    barred = {
        Atom(Predicate(Kind.CAN, action.name), (robot,))
        for action in task.actions
        for robot, manager in action.managers
        if gone & {(manager, action.skill.label), (manager, "")}
    }
    return replace(task, init=task.init - barred)
