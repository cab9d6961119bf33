"""Why a plan is as it is: which step serves which part of the goal, or which condition of a later step.

It is read off the causal links of the plan (see `partial_order`).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

from skiros2_common.core.json_data import JsonData
from skiros2_task.core.formula import Not, conjuncts, holds
from skiros2_task.core.partial_order import GOAL, INIT, CausalLink, PartialOrder
from skiros2_task.core.plan import SkillCall
from skiros2_task.core.task import PlanningTask
from skiros2_task.core.why import said

#: Stands for the goal among the numbers of the steps, and for what holds at the start.
OUTSIDE = 0


@dataclass
class Link:
    """A fact that a step makes and another one needs.

    :param fact: as goals are written.
    :param step: the number of the other step; `OUTSIDE`: the goal needs it, or it holds at the start.
    """

    fact: str
    step: int


@dataclass
class WhyStep:
    """Why a step is part of a plan.

    :param number: from 1 on.
    :param call: the skill, its manager and its parameters, in words.
    :param needs: what has to be so when it starts and may change, each with the step that makes it.
    :param serves: what it makes, each with the step that needs it.
    :param goals: the parts of the goal that all this is for in the end.
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
            yield "     nothing needs what it makes"
        reached = [goal for goal in self.goals if Link(goal, OUTSIDE) not in self.serves]
        if reached:
            yield f"     in the end for {', '.join(reached)}"
        for link in self.needs:
            yield f"     needs {link.fact} {f'of step {link.step}' if link.step else 'as it is at the start'}"


@dataclass
class WhyPlan(JsonData):
    """Why a plan is as it is.

    :param held: the parts of the goal that hold already.
    """

    steps: list[WhyStep]
    held: list[str] = field(default_factory=list)
    _data_name = "why this plan"

    def __str__(self) -> str:
        return "\n".join(self.lines())

    def lines(self) -> Iterator[str]:
        """The text for people."""
        for step in self.steps:
            yield from step.lines()
        for goal in self.held:
            yield f"{goal} holds already"


def why_plan(task: PlanningTask, order: PartialOrder, calls: Sequence[SkillCall]) -> WhyPlan:
    """Why a plan is as it is.

    :param calls: one for each of the order's steps.
    """
    changing = {effect.atom.predicate for action in task.actions for effect in action.effects}
    steps = [WhyStep(number, str(call)) for number, call in enumerate(calls, 1)]
    for link in order.links:
        if link.consumer != GOAL and (link.producer != INIT or link.atom.predicate in changing):
            steps[link.consumer].needs.append(
                Link(_fact(link), link.producer + 1 if link.producer != INIT else OUTSIDE)
            )
        if link.producer != INIT:
            needed_by = link.consumer + 1 if link.consumer != GOAL else OUTSIDE
            steps[link.producer].serves.append(Link(_fact(link), needed_by))
    # The consumers of a step come after it.
    for step in reversed(steps):
        found: dict[str, None] = {}
        for served in step.serves:
            found.update(dict.fromkeys([served.fact] if served.step == OUTSIDE else steps[served.step - 1].goals))
        step.goals = list(found)
    held = [said(part) for part in conjuncts(task.goal) if holds(part, task.init)]
    return WhyPlan(steps, held)


def _fact(link: CausalLink) -> str:
    return said(link.atom if link.state else Not(link.atom))
