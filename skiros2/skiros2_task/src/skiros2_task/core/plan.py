"""Plans: steps with their skill calls, order, robots and times. Computed once for each plan."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

from skiros2_common.core.errors import WrongValue
from skiros2_common.core.names import local_name
from skiros2_common.core.wording import label_text
from skiros2_common.core.world_element import Element
from skiros2_task.core.actions import ROBOT_KEY
from skiros2_task.core.formula import Formula
from skiros2_task.core.no_plan_sentence import Clauses
from skiros2_task.core.partial_order import PartialOrder, deorder
from skiros2_task.core.reduction import reduced
from skiros2_task.core.schedule import Schedule, schedule
from skiros2_task.core.semantics import Facts, GroundStep, unsatisfied
from skiros2_task.core.skills import Skill, SkillParameter
from skiros2_task.core.store import Durations
from skiros2_task.core.task import PlanningTask, PlanStep, validate


@dataclass(frozen=True)
class SkillCall:
    """A skill to run, with the elements of its parameters.

    :param manager: the node name of the skill manager, such as `/test_robot`.
    :param type: the skill's class.
    :param label: the implementation.
    :param arguments: (parameter, element) pairs. An abstract element stands for any element of its class and label.
    :param parameters: the skill's element parameters.
    """

    manager: str
    type: str
    label: str
    arguments: tuple[tuple[str, Element], ...]
    parameters: tuple[SkillParameter, ...] = ()

    def __str__(self) -> str:
        shown = ", ".join(f"{key}={e.id or e.label or e.type}" for key, e in self.arguments)
        return f"{self.type} ({self.label}) by {self.manager}: {shown}"


@dataclass(frozen=True)
class Step:
    """A step of a plan.

    :param number: unique among all steps of a goal. The steps of a plan are numbered from 1.
    :param ground: what it needs and changes.
    :param after: numbers of the steps that must end before this one starts.
    :param start, end: scheduled times (s after the plan's start).
    """

    number: int
    call: SkillCall
    skill: Skill
    ground: GroundStep
    after: frozenset[int] = frozenset()
    start: float = 0.0
    end: float = 0.0

    @property
    def name(self) -> str:
        """Number, skill and robot: "step 2, pick by arm"."""
        call = self.call
        return f"step {self.number}, {label_text(call.label) or local_name(call.type)} by {call.manager.strip('/')}"

    def __str__(self) -> str:
        named = ((key, label_text(e.label) or e.id or e.type) for key, e in self.call.arguments if key != ROBOT_KEY)
        given = ", ".join(f"{key}={name}" for key, name in named)
        return f"{self.name}: {given}" if given else self.name

    @cached_property
    def precondition(self) -> Formula:
        """The condition that must hold from the start of the step to its end."""
        return self.ground.precondition

    @cached_property
    def uses(self) -> frozenset[str]:
        """The resources of the step: the manager of its robot, and the devices that it locks."""
        return frozenset({self.call.manager, *(atom.terms[0] for atom in self.ground.during)})

    def apply(self, facts: Facts) -> Facts:
        """Returns the facts after this step."""
        return self.ground.apply(facts)

    def interferes(self, other: Step) -> bool:
        """Whether the steps share a resource, or one changes a fact that the other needs or changes."""
        mine, others = self.ground, other.ground
        changed, others_changed = mine.effects.keys(), others.effects.keys()
        return bool(
            self.uses & other.uses
            or changed & others_changed
            or changed & others.needed_atoms
            or others_changed & mine.needed_atoms
        )

    def to_dict(self) -> dict[str, object]:
        """Returns the step as JSON data, as in the feedback of `Achieve`."""
        return {
            "number": self.number,
            "skill": self.call.type,
            "label": self.call.label,
            "robot": self.call.manager,
            "arguments": {key: element.id or element.label or element.type for key, element in self.call.arguments},
            "labels": {key: element.label for key, element in self.call.arguments if element.label},
            "start": self.start,
            "end": self.end,
            "after": sorted(self.after),
        }


@dataclass(frozen=True)
class Plan:
    """A valid plan.

    :param task: the planning task that it solves.
    :param schedule: the order and the times of the steps.
    :param steps: in an executable order.
    """

    task: PlanningTask
    schedule: Schedule
    steps: tuple[Step, ...]

    @property
    def order(self) -> PartialOrder:
        """The partial order of the steps, with the reason of each ordering."""
        return self.schedule.order

    @property
    def makespan(self) -> float:
        """The time from the first start to the last end (s)."""
        return self.schedule.makespan

    @property
    def calls(self) -> tuple[SkillCall, ...]:
        """The skills to run, in order."""
        return tuple(step.call for step in self.steps)

    @property
    def missing(self) -> tuple[str, ...]:
        """The parameters for which planning has assumed values, as SKILL.PARAMETER; see `assume_values`."""
        keys = (f"{local_name(s.skill.type)}.{p.key}" for s in self.steps for p in s.skill.parameters if p.assumed)
        return tuple(dict.fromkeys(keys))

    @property
    def summary(self) -> str:
        """The numbers of steps and robots, the makespan and its lower bound if it is lower, as text."""
        robots, count = len({call.manager for call in self.calls}), len(self.steps)
        steps = f"{count} step{'s' * (count > 1)}"
        bound = self.schedule.bound
        least = f" (at least {bound:.1f} s)" if self.makespan - bound > 0.05 and bound else ""
        return f"{steps} of {robots} robot{'s' * (robots > 1)}, {self.makespan:.1f} s{least}"

    def numbered_from(self, first: int) -> tuple[Step, ...]:
        """Returns the steps with other numbers.

        :param first: the number of the first step.
        """
        added = first - 1
        return tuple(
            replace(step, number=step.number + added, after=frozenset(i + added for i in step.after))
            for step in self.steps
        )


def make_plan(
    task: PlanningTask, steps: Sequence[PlanStep], durations: Durations, objects: Mapping[str, Element]
) -> Plan:
    """Validates, reduces, orders and schedules steps.

    :param durations: of the skills.
    :param objects: the elements of the task's objects. An element without id and label, which a skill has yet to
        create, is not an argument: the skill infers it when it starts.
    :raises WrongValue: the steps do not lead to the goal.
    """
    reason = validate(task, steps)
    if reason:
        raise WrongValue(reason)
    return plan_of(task, schedule(task, deorder(task, reduced(task, steps)), durations), objects)


def plan_of(task: PlanningTask, scheduled: Schedule, objects: Mapping[str, Element]) -> Plan:
    """Returns a scheduled plan.

    :param objects: see `make_plan`.
    """
    before = scheduled.order.predecessors()
    return Plan(
        task,
        scheduled,
        tuple(
            Step(
                number=timed.step + 1,
                call=_call(task, step, objects),
                skill=task.action(step.action).skill,
                ground=task.ground(step),
                after=frozenset(i + 1 for i in before[timed.step]),
                start=timed.start,
                end=timed.end,
            )
            for step, timed in zip(scheduled.order.steps, scheduled.steps, strict=True)
        ),
    )


def plan_problem(running: Iterable[Step], waiting: Iterable[Step], facts: Facts, goal: Formula) -> str:
    """Returns why running and waiting steps do not lead from the facts to the goal, as a sentence with the ids of
    elements; "" if they do.

    :param waiting: in an executable order.
    """
    clause = Clauses(None).fact
    for step in running:
        facts = step.apply(facts)
    for step in waiting:
        missing = unsatisfied(step.precondition, facts, text_of=clause)
        if missing:
            return f"{step.name}, needs that {missing}"
        facts = step.apply(facts)
    missing = unsatisfied(goal, facts, text_of=clause)
    return f"the plan would not lead to the goal: {missing}" if missing else ""


def _call(task: PlanningTask, step: PlanStep, objects: Mapping[str, Element]) -> SkillCall:
    action = task.action(step.action)
    values = {v.name: name for v, name in zip(action.variables, step.arguments, strict=True)}
    arguments = tuple(
        (v.key, objects[values[v.name]])
        for v in action.variables
        if v.key and (objects[values[v.name]].id or objects[values[v.name]].label)
    )
    parameters = tuple(p for p in action.skill.parameters if p.element_class is not None)
    manager = action.manager_of(values[action.robot])
    return SkillCall(manager, action.skill.type, action.skill.label, arguments, parameters)
