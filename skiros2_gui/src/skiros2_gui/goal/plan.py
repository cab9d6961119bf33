"""Reads the plans and the progress of the task manager."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any

from skiros2_common.core.explanation import Explanation
from skiros2_gui.goal.readable import change_lines, why_lines
from skiros2_task.core.explain_plan import WhyPlan
from skiros2_task.core.goal_sentence import NameOf
from skiros2_task.core.preview import Preview

#: The result states without failure.
_REACHED = {"succeeded": "The goal is reached.", "nothing_to_do": "The goal holds already."}


@dataclass(frozen=True)
class StepRow:
    """:param state: `waiting`, `running`, `succeeded`, `failed`, `stopped` or `dropped`."""

    number: int
    start: float
    end: float
    robot: str
    skill: str
    after: tuple[int, ...]
    parameters: str
    state: str = "waiting"
    message: str = ""


@dataclass(frozen=True)
class GoalExecution:
    """:param name_of: returns the displayed name of an element.
    :param phase: `planning`, `running`, `stopping`, or `ended`.
    :param text: the last message.
    :param rows: the steps of all plans so far.
    :param why: why the goal was not reached, in lines.
    :param reached: whether the goal holds at the end.
    """

    goal: str
    name_of: NameOf = str
    phase: str = "planning"
    text: str = "Asking the task manager…"
    rows: tuple[StepRow, ...] = ()
    why: tuple[str, ...] = ()
    reached: bool = False

    @property
    def is_finished(self) -> bool:
        return self.phase == "ended"

    @property
    def progress_text(self) -> str:
        """The progress in one line."""
        running = [row for row in self.rows if row.state == "running"]
        if self.is_finished or self.phase != "running" or not running:
            return self.text
        steps = ", ".join(f"step {row.number} {row.skill} of {row.robot.lstrip('/')}" for row in running[:3])
        more = f" and {len(running) - 3} more" if len(running) > 3 else ""
        done = sum(row.state == "succeeded" for row in self.rows)
        return f"{done} of {len(self.rows)} steps are done; now {steps}{more}"

    def after_feedback(self, feedback: Any) -> GoalExecution:
        """Returns the state after an `AchieveFeedback`.

        :raises ValueError: it cannot be read.
        """
        if self.is_finished:
            return self  # the result came first
        rows = _with_states(_with_plan(self.rows, _read(feedback.plan), self.name_of), _read(feedback.steps))
        return replace(self, phase=feedback.phase, text=feedback.message or feedback.phase, rows=rows)

    def after_result(self, result: Any) -> GoalExecution:
        """Returns the state after an `AchieveResult`.

        :raises ValueError: it cannot be read.
        """
        done = _read(result.done)
        rows = _with_states(_with_plan(self.rows, done, self.name_of), done)
        text = _REACHED.get(result.state) or result.message or result.state
        whys = _read(result.explanations)
        try:
            lines = tuple(Explanation.from_dict(whys[-1]).lines()) if whys else ()
        except (TypeError, LookupError) as error:
            raise ValueError(f"the explanation cannot be read: {error}") from None
        head, _, rest = text.partition("\n")
        return replace(
            self,
            phase="ended",
            text=head,
            rows=rows,
            why=(*rest.splitlines(), *lines),
            reached=result.state in _REACHED,
        )

    def after_error(self, text: str) -> GoalExecution:
        """Returns the state after an error."""
        return replace(self, phase="ended", text=text)


def _read(text: str) -> list[dict[str, Any]]:
    data = json.loads(text or "[]")
    if not isinstance(data, list) or not all(isinstance(item, dict) for item in data):
        raise ValueError(f"expected a list of objects, got {text[:80]!r}")
    return data


def read_steps(plan: str, name_of: NameOf) -> tuple[StepRow, ...]:
    """Returns the steps of a plan, as the task manager sends it.

    :param plan: a JSON list.
    :param name_of: returns the displayed name of an element.
    :raises ValueError: it cannot be read.
    """
    return _with_plan((), _read(plan), name_of)


def _with_plan(rows: Iterable[StepRow], plan: Iterable[dict[str, Any]], name_of: NameOf) -> tuple[StepRow, ...]:
    """Returns the rows with the steps of a plan added or updated."""
    known = {row.number: row for row in rows}
    for step in plan:
        try:
            arguments = {k: v for k, v in step.get("arguments", {}).items() if k != "Robot"}
            row = StepRow(
                int(step["number"]),
                float(step["start"]),
                float(step["end"]),
                str(step["robot"]),
                str(step.get("label") or step.get("skill", "")),
                tuple(int(n) for n in step.get("after", ())),
                ", ".join(f"{k}: {name_of(str(v))}" for k, v in arguments.items()),
            )
        except (TypeError, AttributeError, LookupError) as error:
            raise ValueError(f"a step cannot be read: {error!r}") from None
        old = known.get(row.number)
        known[row.number] = replace(row, state=old.state, message=old.message) if old is not None else row
    return tuple(sorted(known.values(), key=lambda row: row.number))


def _with_states(rows: Iterable[StepRow], steps: Iterable[dict[str, Any]]) -> tuple[StepRow, ...]:
    states = {step.get("number"): step for step in steps}
    return tuple(
        replace(row, state=str(new.get("state", row.state)), message=str(new.get("message", "")))
        if (new := states.get(row.number)) is not None
        else row
        for row in rows
    )


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
    steps = {row.number: f"{row.skill} of {row.robot.lstrip('/')}" for row in rows}
    return GoalPlan(
        goal,
        result.state,
        result.message,
        tuple(rows),
        tuple(change_lines(simulation, steps, name_of)),
        tuple(why_lines(why, steps, name_of)),
        simulation.works,
    )
