"""A goal in execution, and the port to the robots that run its steps."""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Protocol
from uuid import uuid4

from skiros2_common.core.explanation import Explanation
from skiros2_task.core.commands import End
from skiros2_task.core.engines import Limits
from skiros2_task.core.execution import ExecutionStateMachine
from skiros2_task.core.execution_log import ExecutionLog
from skiros2_task.core.given_plan import GivenPlan
from skiros2_task.core.plan import Step
from skiros2_task.core.planners import Planner
from skiros2_task.core.step_record import StepRecord
from skiros2_task.core.undeclared import UndeclaredChanges

#: Reports the end of a step: whether it succeeded, a message and why it failed. Called by any thread.
Ended = Callable[[bool, str, Sequence[Explanation]], None]

#: Reports the number of a step's task, before its end. Called by any thread.
Began = Callable[[int], None]


class StepRunner(Protocol):
    """Runs steps on robots."""

    def start(
        self, step: Step, ended: Ended, run: str = "", began: Began | None = None, goal: str = ""
    ) -> Callable[[], None]:
        """Starts a step without blocking. Returns a function that stops it.

        :param ended: called once, also after a stop.
        :param run: the id of the run, for `attach`; "": any.
        :param began: called at most once.
        :param goal: stands for the goal, the same for all its steps and for no other goal; "": unknown.
        """

    def attach(
        self, step: Step, run: str, known: Callable[[bool], None], ended: Ended, began: Began | None = None
    ) -> Callable[[], None]:
        """Follows a step that an earlier process has started, without blocking. Returns a function that stops it.

        :param known: called once; False: the robot does not know the run, and `ended` is not called.
        """


@dataclass(frozen=True)
class Goal:
    """A goal to achieve.

    :param text: see `goal_text`.
    :param priority: of goals that need the same robot, the one with the highest priority gets it first.
    :param interrupts: whether it stops the steps of goals with a lower priority that use the robots of its plan.
    :param limits, planner: for each planning; None: those of the `TaskPlanner`.
    :param max_replans: how often a broken plan is replaced at most; 0 for a given plan.
    :param id: in the executor's store; "": the goal is not stored.
    :param replans_after_limit: whether a plan is made even after a step that exceeded a limit.
    """

    text: str
    priority: int = 0
    limits: Limits | None = None
    planner: Planner | GivenPlan | None = None
    max_replans: int = 5
    interrupts: bool = False
    id: str = ""
    replans_after_limit: bool = False


@dataclass
class GoalExecution:
    """A goal in execution. `machine` belongs to the executor's thread, which calls the callbacks.

    :param on_change: called after each change of a step or of the phase.
    :param on_end: called once, last.
    """

    name: str
    goal: Goal
    on_change: OnChange
    on_end: OnEnd
    machine: ExecutionStateMachine
    undeclared: UndeclaredChanges
    cancelled: threading.Event = field(default_factory=threading.Event)
    stops: dict[int, Callable[[], None]] = field(default_factory=dict)  # stop functions of running steps, by number
    work: queue.SimpleQueue[Callable[[], None] | None] = field(default_factory=queue.SimpleQueue)
    world_changed: bool = False  # since the last read
    reading: bool = False
    next_read: float = 0.0
    log: ExecutionLog | None = None
    #: Stands for the goal on skill managers: no other goal has it, and it is kept over a restart if the goal is stored.
    key: str = ""

    def __post_init__(self) -> None:
        self.key = self.key or self.goal.id or uuid4().hex

    @property
    def started(self) -> list[StepRecord]:
        """The started steps, in the order of their starts."""
        records = [r for r in self.machine.records.values() if r.started is not None]
        return sorted(records, key=lambda record: (record.started, record.step.number))


#: Called after each change of a step or of the phase, and once at the end; in the executor's thread.
OnChange = Callable[[GoalExecution], None]
OnEnd = Callable[[GoalExecution, End], None]
