"""The port to the cell: its robots, its world model, and goals that run in it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

from skiros2_gateway.core.edits import EditPreview, Edits
from skiros2_gateway.core.goal_form import GoalEdit
from skiros2_gateway.core.problems import Problem
from skiros2_live.core.cell import CellDocument

#: Outcome of a goal whose result is unknown.
LOST = "lost"
#: Outcome of a goal that the task manager has never had.
UNKNOWN = "unknown"
#: The outcome of a goal that a person has ended.
CANCELLED = "cancelled"
#: Outcomes of goals that hold at their end.
REACHED = ("succeeded", "nothing_to_do")


@dataclass(frozen=True)
class Goal:
    """A goal for the cell.

    :param id: of the job, and of the goal in messages.
    :param text: as of the task manager.
    :param quality: wanted plan quality; "": the task manager's default.
    :param robots: node names of the allowed robots; empty: all.
    :param on_restart: what happens to it when the task manager was restarted; "": the task manager's default.
    :param plan: the steps that are executed, as `Cell.plan` returns them; None: the task manager plans.
    """

    id: str
    text: str
    priority: int = 0
    quality: str = ""
    robots: tuple[str, ...] = ()
    plan: tuple[dict[str, Any], ...] | None = None
    on_restart: str = ""


@dataclass(frozen=True)
class Progress:
    """The feedback of a running goal; see the action Achieve."""

    phase: str
    message: str
    plan: list[dict[str, Any]] = field(default_factory=list)
    steps: list[dict[str, Any]] = field(default_factory=list)


@dataclass(frozen=True)
class Ending:
    """The end of a goal.

    :param outcome: as `state` of the result of Achieve, or `LOST` or `UNKNOWN`.
    :param steps: the steps that were started, each with robot, state and message.
    """

    outcome: str
    message: str
    steps: list[dict[str, Any]] = field(default_factory=list)
    explanations: list[dict[str, Any]] = field(default_factory=list)


@dataclass(frozen=True)
class Collected:
    """The data read from the world model after a goal.

    :param changes: for each changed element a dict with `id`, `author`, `time`, `lines` (one change per line).
    :param quality: values by `parameter.property`.
    :param notes: what could not be read, and why.
    """

    changes: list[dict[str, Any]] = field(default_factory=list)
    quality: dict[str, Any] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)


class GoalListener(Protocol):
    """Receives what happens to goals. Called in the thread of the gateway's loop."""

    def cell_changed(self) -> None:
        """`is_ready` or `capacity` may have changed."""

    def goal_accepted(self, goal_id: str) -> None: ...

    def goal_progress(self, goal_id: str, progress: Progress) -> None: ...

    def goal_suspended(self, goal_id: str, reason: str) -> None:
        """A stop of a robot, or another client, interrupts the goal; reason "": it runs again."""

    def goal_ended(self, goal_id: str, ending: Ending) -> None: ...


class Cell(Protocol):
    """A cell. Its methods are called in the thread of the gateway's loop.

    Coroutines raise `SkirosError` if the cell refuses or does not answer in time.
    """

    @property
    def document(self) -> CellDocument:
        """The robots, tasks, goals and elements of the cell."""

    @property
    def is_ready(self) -> bool:
        """Whether a goal would reach the task manager."""

    @property
    def revision(self) -> int:
        """The number of the world model's last change; 0: unknown."""

    @property
    def capacity(self) -> int:
        """How many goals can run at once."""

    @property
    def interrupt_priority(self) -> int:
        """Goals from this priority on interrupt others, so they need no capacity."""

    async def problems(
        self, goal: str, elements: Mapping[str, tuple[str, str]], robots: Sequence[str]
    ) -> list[Problem]:
        """Returns what is wrong with the names of a goal.

        :param elements: (element, class) by the field that names the element; class "": any.
        """

    def start(self, goal: Goal) -> None:
        """Sends a goal. A goal with an id that the task manager knows is not run again."""

    def follow(self, goal: Goal) -> None:
        """Follows a goal that was sent before a restart of the gateway.

        Its progress is reported again, or its end: `UNKNOWN` if it has not arrived, `LOST` if it may have.
        """

    def stop(self, goal_id: str) -> None:
        """Cancels a goal; its end is reported."""

    def pause(self, goal_id: str) -> None:
        """Pauses the tasks of a goal, also those that start later."""

    def resume(self, goal_id: str) -> None:
        """Resumes the tasks of a goal."""

    async def collect(
        self, robots: Sequence[str], start: float, end: float, quality: Mapping[str, tuple[str, str]]
    ) -> Collected:
        """Reads what robots have changed, and quality data.

        :param start, end: numbers of changes (int); of jobs of earlier versions times (float, s since the epoch).
        :param quality: (element, property) by the key of the result.
        """

    def state(self) -> dict[str, Any]:
        """Returns `robots` (a list), `ready` and `capacity` as JSON data, see `skiros2_gateway.http.app`."""

    async def world(self) -> dict[str, Any]:
        """Returns the world model as JSON data, see `skiros2_gateway.http.app`."""

    async def query(self, text: str, user: str) -> dict[str, Any]:
        """Returns `columns` and `rows` of a SPARQL query; it uses the budget of the user.

        :raises Rejected: the query cannot be answered, or is not allowed.
        :raises TooMany: the user's budget is used up.
        """

    async def skills(self) -> dict[str, list[dict[str, Any]]]:
        """Returns the skills of each robot as JSON data."""

    async def check_start(self, robot: str, skill: str, parameters: Mapping[str, Any]) -> dict[str, Any]:
        """Returns whether a skill would start now; nothing moves.

        :returns: {ok, implementation, elements, values, changes, why}: `values` of all parameters, elements by
            their ids; `changes`: what is expected to change, a line each.
        """

    async def run_skill(self, robot: str, skill: str, parameters: Mapping[str, Any], values: Mapping[str, Any]) -> int:
        """Starts a skill. Returns the number of its task.

        :param parameters: that were given, as `skill_run` returns them.
        :param values: of all parameters, with which it starts; see `check_start`.
        :raises Refused: it does not start.
        """

    async def skill_run(self, robot: str, task: int) -> dict[str, Any]:
        """Returns a task that `run_skill` has started: {skill, parameters, state, message, explanations}.

        The state is running, succeeded or failed.

        :raises UnknownName: no such task was started, or newer ones have replaced it.
        """

    async def stop_task(self, robot: str, task: int) -> None:
        """Preempts a task of a robot.

        :raises SkirosError: there is no such task, or it has ended.
        """

    async def preview_edits(self, edits: Edits) -> EditPreview:
        """Checks edits of the world model, and returns what they would change.

        :raises Rejected: with the problems of all edits.
        """

    async def apply_edits(self, edits: Edits, preview: EditPreview) -> None:
        """Applies previewed edits as a whole.

        :raises SkirosError: the world model refuses them, for example because an edited element has changed since.
        """

    async def goal_form(self, edit: GoalEdit) -> dict[str, Any]:
        """Returns the form of a goal, see `goal_form`."""

    async def plan(self, goal: str, quality: str = "") -> dict[str, Any]:
        """Returns the fields of the result of the action MakePlan, decoded."""

    async def command_robots(self, action: str, robots: Sequence[str], user: str = "") -> dict[str, Any]:
        """Preempts, pauses or resumes (`stop`, `pause`, `resume`) all tasks of robots; none named: of all robots.

        :param user: named in the robots' logs.
        :returns: the number of tasks by robot.
        """
