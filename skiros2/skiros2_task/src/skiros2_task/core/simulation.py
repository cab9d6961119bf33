"""Plans carried out on a task's facts, to check them before anything moves."""

from __future__ import annotations

from collections.abc import Iterable

from skiros2_task.core.formula import Atom, conjuncts, holds
from skiros2_task.core.task import PlanningTask, PlanStep, effects_of, precondition_of


def after(task: PlanningTask, state: frozenset[Atom], step: PlanStep) -> frozenset[Atom]:
    """The facts after a step. A fact made both true and false is true."""
    changes = list(effects_of(task, step))
    removed = {atom for atom, value in changes if not value}
    return (state - removed) | {atom for atom, value in changes if value}


def flaw(task: PlanningTask, plan: Iterable[PlanStep]) -> str:
    """Why a plan does not lead from the task's start to its goal; "" when it does."""
    state = task.init
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
        missing = [str(part) for part in conjuncts(precondition_of(task, step)) if not holds(part, state)]
        if missing:
            return f"step {number} {step}: {_some(missing)} does not hold"
        state = after(task, state, step)
    missing = [str(part) for part in conjuncts(task.goal) if not holds(part, state)]
    return f"at the end {_some(missing)} does not hold" if missing else ""


def _some(texts: list[str]) -> str:
    return f"{', '.join(texts[:3])} and {len(texts) - 3} more" if len(texts) > 3 else ", ".join(texts)
