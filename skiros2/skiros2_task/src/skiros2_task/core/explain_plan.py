"""Explains the purpose of each step of a plan by its causal links (see `partial_order`)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

from skiros2_common.core.json_data import JsonData
from skiros2_task.core.explain_no_plan import format_formula
from skiros2_task.core.formula import conjuncts, holds, literal_formula
from skiros2_task.core.partial_order import GOAL, INIT, CausalLink
from skiros2_task.core.plan import Plan

#: The step number of the goal and of the initial state.
OUTSIDE = 0


@dataclass
class Link:
    """A causal link of a step.

    :param fact: in goal syntax.
    :param step: the number of the other step, or `OUTSIDE`.
    """

    fact: str
    step: int


@dataclass
class WhyStep:
    """The purpose of a step.

    :param number: counts from 1.
    :param call: the skill, its manager and its parameters, as text.
    :param needs: the facts that it needs, each with the producer.
    :param serves: the facts that it produces, each with the consumer.
    :param goals: the parts of the goal that it serves, directly or indirectly.
    """

    number: int
    call: str
    needs: list[Link] = field(default_factory=list)
    serves: list[Link] = field(default_factory=list)
    goals: list[str] = field(default_factory=list)

    def lines(self) -> Iterator[str]:
        yield f"{self.number}. {self.call}"
        for fact in dict.fromkeys(link.fact for link in self.serves):
            users = [f"step {link.step}" if link.step else "the goal" for link in self.serves if link.fact == fact]
            yield f"     makes {fact} for {', '.join(users)}"
        if not self.serves:
            yield "     no step needs its effects"
        reached = [goal for goal in self.goals if Link(goal, OUTSIDE) not in self.serves]
        if reached:
            yield f"     in the end for {', '.join(reached)}"
        for link in self.needs:
            yield f"     needs {link.fact} {f'of step {link.step}' if link.step else 'of the initial state'}"


@dataclass
class WhyPlan(JsonData):
    """The purpose of each step of a plan.

    :param held: the parts of the goal that hold already.
    """

    steps: list[WhyStep]
    held: list[str] = field(default_factory=list)
    _data_name = "why this plan"

    def __str__(self) -> str:
        return "\n".join(self.lines())

    def lines(self) -> Iterator[str]:
        """Yields the text."""
        for step in self.steps:
            yield from step.lines()
        for goal in self.held:
            yield f"{goal} holds already"


def explain_plan(plan: Plan) -> WhyPlan:
    """Returns the purpose of each step of a plan."""
    task = plan.task
    steps = [WhyStep(step.number, str(step.call)) for step in plan.steps]
    for link in plan.order.links:
        if link.consumer != GOAL and (link.producer != INIT or link.atom.predicate in task.changed):
            steps[link.consumer].needs.append(
                Link(_fact(link), link.producer + 1 if link.producer != INIT else OUTSIDE)
            )
        if link.producer != INIT:
            needed_by = link.consumer + 1 if link.consumer != GOAL else OUTSIDE
            steps[link.producer].serves.append(Link(_fact(link), needed_by))
    # Consumers come after their producers.
    for step in reversed(steps):
        found: dict[str, None] = {}
        for served in step.serves:
            found.update(dict.fromkeys([served.fact] if served.step == OUTSIDE else steps[served.step - 1].goals))
        step.goals = list(found)
    held = [format_formula(part) for part in conjuncts(task.goal) if holds(part, task.init)]
    return WhyPlan(steps, held)


def _fact(link: CausalLink) -> str:
    return format_formula(literal_formula(link.atom, link.state))
