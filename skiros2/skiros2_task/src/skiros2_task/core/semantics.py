"""What steps do to facts: applies effects and validates plans, independently of the planner."""

from __future__ import annotations

from collections.abc import Iterable

from skiros2_task.core.formula import Atom, conjuncts, holds
from skiros2_task.core.task import PlanningTask, PlanStep, effects_of, precondition_of

Facts = frozenset[Atom]


def apply_effects(facts: Facts, effects: Iterable[tuple[Atom, bool]]) -> Facts:
    """Returns the facts after some effects. An atom that is made both true and false is true, as in PDDL."""
    effects = list(effects)
    return (facts - {atom for atom, value in effects if not value}) | {atom for atom, value in effects if value}


def apply_step(task: PlanningTask, facts: Facts, step: PlanStep) -> Facts:
    """Returns the facts after a step."""
    return apply_effects(facts, effects_of(task, step))


def validate(task: PlanningTask, plan: Iterable[PlanStep]) -> str:
    """Returns why a plan does not lead from the task's initial facts to its goal; "" if it does."""
    facts = task.init
    for number, step in enumerate(plan, 1):
        try:
            action = task.action(step.action)
        except KeyError:
            return f"step {number}: there is no action {step.action!r}"
        if len(step.arguments) != len(action.variables):
            return f"step {number} {step}: expected {len(action.variables)} arguments"
        for variable, argument in zip(action.variables, step.arguments, strict=True):
            if not all(argument in task.members[cls] for cls in variable.classes):
                return f"step {number} {step}: {argument} is no {' and '.join(variable.classes)}"
        missing = [str(part) for part in conjuncts(precondition_of(task, step)) if not holds(part, facts)]
        if missing:
            return f"step {number} {step}: {_first_three(missing)} does not hold"
        facts = apply_step(task, facts, step)
    missing = [str(part) for part in conjuncts(task.goal) if not holds(part, facts)]
    return f"at the end {_first_three(missing)} does not hold" if missing else ""


def _first_three(texts: list[str]) -> str:
    return f"{', '.join(texts[:3])} and {len(texts) - 3} more" if len(texts) > 3 else ", ".join(texts)
