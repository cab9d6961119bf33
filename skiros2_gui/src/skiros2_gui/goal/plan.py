"""Checks goals, and reads the plans of the task manager."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from skiros2_gui.goal.completion import Vocabulary, read_vocabulary
from skiros2_gui.goal.execution import NameOf, StepRow, read_steps
from skiros2_task.core.actions import condition_predicates
from skiros2_task.core.explain_plan import WhyPlan
from skiros2_task.core.goal_reader import GoalReader
from skiros2_task.core.goal_text import GoalError, parse_goals
from skiros2_task.core.preview import Preview
from skiros2_task.core.world import WorldView


@dataclass(frozen=True)
class Diagnostic:
    """Why a goal cannot be read.

    :param line, column: the position, from 1.
    """

    line: int
    column: int
    reason: str

    def position(self, text: str) -> int:
        """Returns the position as an offset in the text."""
        before = text.split("\n")[: self.line - 1]
        return min(sum(len(line) + 1 for line in before) + self.column - 1, len(text))


def check_syntax(text: str) -> Diagnostic | None:
    """Returns the first syntax error of a goal, or None. Does not block."""
    try:
        parse_goals(text)
    except GoalError as error:
        return Diagnostic(error.line, error.column, error.reason)
    return None


class GoalChecker:
    """Checks goals against a snapshot of the world. For one worker at a time.

    :raises WmException: the world model does not answer.
    """

    def __init__(self, wm: Any) -> None:
        world = WorldView(wm)
        self.vocabulary: Vocabulary = read_vocabulary(world)
        self._reader = GoalReader(world, condition_predicates(world.robots))

    def check(self, text: str) -> Diagnostic | None:
        """Returns the first error of a goal, unknown names included, or None."""
        try:
            self._reader.read(text)
        except GoalError as error:
            return Diagnostic(error.line, error.column, error.reason)
        return None


@dataclass(frozen=True)
class GoalPlan:
    """The result of planning.

    :param state: of a `MakePlanResult`, such as `planned`.
    :param head: one line.
    :param rows: the steps in the order of their starts.
    :param changes: the effects of each step, in lines.
    :param why: the purpose of each step, or why there is no plan, in lines.
    :param works: whether the plan works in its simulation.
    """

    goal: str
    state: str
    head: str
    rows: tuple[StepRow, ...] = ()
    changes: tuple[str, ...] = ()
    why: tuple[str, ...] = ()
    works: bool = True


def read_plan(goal: str, result: Any, name_of: NameOf) -> GoalPlan:
    """Returns the plan of a `MakePlanResult`.

    :param name_of: returns the displayed name of an element.
    :raises ValueError: it cannot be read.
    """
    rows = sorted(read_steps(result.plan, name_of), key=lambda row: (row.start, row.number))
    if not rows:
        head, _, rest = result.message.partition("\n")
        notes = ["What planning could not use:", *(f"  {note}" for note in result.notes)] if result.notes else []
        return GoalPlan(goal, result.state, head, why=(*rest.splitlines(), *notes))
    simulation, why = Preview.from_json(result.preview), WhyPlan.from_json(result.why)
    return GoalPlan(
        goal,
        result.state,
        result.message,
        tuple(rows),
        tuple(simulation.lines()),
        tuple(why.lines()),
        simulation.works,
    )
