"""The running cell, or a recorded one, as a document: connections, robots, runs of trees, goals, elements, frames,
bodies, signals.

Adapters over ROS and bags report patches (`skiros2_live.core.patch`); views (the window, the page, interfaces) read
the document and subscribe to what has changed.
"""

from __future__ import annotations

import weakref
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any, TypeVar, get_args

from skiros2_common.core.errors import WrongValue
from skiros2_common.core.forward_clock import now
from skiros2_common.core.names import local_name
from skiros2_common.core.wording import label_text
from skiros2_live.core.patch import (
    TASK_MANAGER,
    Connection,
    EntriesChanged,
    GoalProgress,
    ManagerConnection,
    Patch,
    SafetyChanged,
    Table,
    TaskProgress,
)
from skiros2_live.core.robots import Robot, Totals
from skiros2_runs.core.goal_progress import goal_after, new_goal
from skiros2_runs.core.goal_runs import GOALS, GoalRuns
from skiros2_runs.core.progress import has_ended
from skiros2_runs.core.runs import Runs
from skiros2_runs.core.task_run import Recorded, TaskRun
from skiros2_task.core.goal_sentence import NameOf, goal_sentence


@dataclass(frozen=True)
class RunsLost:
    """Running tasks were marked as lost: their manager, or the task manager of goals, has disconnected."""

    runs: tuple[TaskRun, ...]


@dataclass(frozen=True)
class GoalChanged:
    """A goal has changed.

    :param data: as in `CellDocument.goals`; None: it is no longer kept.
    :param new_steps: tasks that have turned out to be steps of goals.
    """

    goal_id: str
    data: Mapping[str, Any] | None
    new_steps: tuple[TaskRun, ...] = ()


@dataclass(frozen=True)
class RobotChanged:
    """A robot has connected or disconnected, or its state or the counts of its tasks have changed."""

    robot: Robot


#: What subscribers receive.
CellChange = Connection | Recorded | RunsLost | GoalChanged | RobotChanged | EntriesChanged

C = TypeVar("C", bound=CellChange)


class CellDocument:
    """Used in one thread.

    :param name_of: names an element for people, in the titles of goals; None: by the labels in `tables`.
    :param runs: gets the tasks; by default of limited size.
    :ivar clock: returns the time (s since the epoch), which must not go back.
    :param max_goals: the most goals kept.
    :ivar connections: the last one of each part, by its name.
    :ivar robots: by the node names of their managers. A robot whose manager has ended stays, disconnected.
    :ivar runs: the tasks of all managers; goals are tasks of `GOALS`.
    :ivar goals: by id, the newest last: as of `skiros2_runs.core.goal_progress`, with a `title` for people.
    :ivar tables: JSON data by key: `elements` as of `SceneView.element`, `frames` of tf as of `frames_data`, `bodies`
        (the visuals of each robot) as of `SceneView.robot`, and `signals`: {name, unit, robot, value, low, high, time,
        problem}.
    """

    def __init__(
        self,
        name_of: NameOf | None = None,
        runs: Runs | None = None,
        clock: Callable[[], float] = now,
        max_goals: int = 100,
    ) -> None:
        self._name_of = name_of or self._label
        self.clock = clock
        self._max_goals = max_goals
        self._earlier: Mapping[str, Totals] = {}
        self._handlers: defaultdict[type, list[Callable[[Any], None]]] = defaultdict(list)
        self._steps: weakref.WeakSet[TaskRun] = weakref.WeakSet()  # the known tasks of goals' steps
        self.connections: dict[str, Connection] = {}
        self.robots: dict[str, Robot] = {}
        self.runs = Runs() if runs is None else runs
        self.goal_runs = GoalRuns(self.runs)
        self.goals: dict[str, dict[str, Any]] = {}
        self.tables: dict[Table, dict[str, Any]] = {table: {} for table in get_args(Table)}

    def continue_counters(self, earlier: Mapping[str, Totals]) -> None:
        """Sets what the counters of robots begin with, by name. To be called before the first patch."""
        self._earlier = earlier

    def sentence(self, goal: str) -> str:
        """Returns a goal for people."""
        return goal_sentence(" ".join(goal.split()), self._name_of) or "goal"

    def subscribe(self, kind: type[C], handler: Callable[[C], None]) -> None:
        """Has `handler` called with each change of a kind, once the document has it."""
        self._handlers[kind].append(handler)

    def apply(self, patch: Patch) -> None:
        """Applies a patch, and notifies the subscribers.

        :raises WrongValue: a message of the task manager cannot be read; the document is unchanged.
        """
        match patch:
            case Connection():
                self.connections[patch.name] = patch
                if patch.name == TASK_MANAGER and not patch.is_up:
                    self.mark_lost(GOALS)
                self._publish(patch)
            case TaskProgress():
                self._record(patch)
            case GoalProgress():
                self._update_goal(patch)
            case ManagerConnection():
                self._connect(patch)
            case SafetyChanged():
                robot = self._robot(patch.manager)
                robot.safety = patch
                self._update(robot)
            case EntriesChanged():
                self._replace_entries(patch)

    def find(self, robot: str, task_id: int) -> TaskRun | None:
        """Returns the latest task of a manager with that id."""
        return next((r for r in reversed(list(self.runs)) if (r.robot, r.task_id) == (robot, task_id)), None)

    def robots_data(self) -> list[dict[str, Any]]:
        """Returns the robots as JSON data, ordered by name; see `Robot.to_dict`."""
        return [robot.to_dict() for _, robot in sorted(self.robots.items())]

    @property
    def shown(self) -> list[TaskRun]:
        """The tasks that lists show: goals instead of the tasks of their steps; oldest first."""
        return [run for run in self.runs if self.goal_runs.goal_of(run) is None]

    def running(self, robot: str) -> Iterator[TaskRun]:
        """Yields the tasks of a manager that have not ended."""
        return (run for run in self.runs if run.robot == robot and not run.is_finished)

    def mark_lost(self, robot: str) -> None:
        """Marks the running tasks of a manager as lost; of `GOALS`: of the task manager."""
        lost = tuple(self.running(robot))
        self.runs.mark_lost(robot, may_return=robot == GOALS)
        if lost:
            self._publish(RunsLost(lost))

    # -- tasks -------------------------------------------------------------------------------------------------

    def _record(self, patch: TaskProgress) -> None:
        """Skips a message that is older than the last of its task, unless the task has ended."""
        known = self.find(patch.manager, patch.task) if patch.nodes else None
        if patch.is_past:
            ended = known.end_of(patch.nodes, patch.stamp) if known is not None else None
            if ended is None:
                return
            patch = replace(patch, stamp=ended)
        if known is not None and patch.stamp < known.latest.time and not has_ended(patch.nodes):
            return
        was_lost = known is not None and known.is_lost
        recorded = self.runs.record(patch.manager, patch.nodes, patch.stamp)
        if recorded is None:
            return
        robot = self._robot(patch.manager)
        has_returned = was_lost and recorded.run is known and patch.nodes[0].id not in robot.tasks
        robot.failed -= has_returned  # the robot was only silent
        has_counted = robot.follow(patch.nodes, is_new=has_returned or recorded.run is not known) or has_returned
        self._publish(recorded)
        if (goal := self.goal_runs.step_recorded(recorded.run, patch.stamp)) is not None:
            self._steps.add(recorded.run)
            self._publish(goal)
        self._update(robot, has_counted)

    def _update_goal(self, patch: GoalProgress) -> None:
        known, sent = self.goals.get(patch.goal_id, {}), getattr(patch.message, "goal", None)
        if sent is not None and not sent.goals.strip():
            return  # a client asks for its goal
        try:
            if sent is not None:
                data = {**(known or new_goal("", patch.stamp)), "goal": sent.goals}  # its feedback may come first
            else:
                data = goal_after(known, patch.message, patch.stamp)
        except (ValueError, TypeError, LookupError) as error:
            raise WrongValue(f"the message of the task manager cannot be read: {error}") from error
        data["title"] = self.sentence(data["goal"])
        self.goals.pop(patch.goal_id, None)
        self.goals[patch.goal_id] = data
        recorded = self.goal_runs.update(patch.goal_id, data["title"], data, patch.stamp)
        new = tuple(task for task in self.goal_runs.tasks(recorded.run) if task not in self._steps)
        self._steps.update(new)
        self._publish(recorded)
        self._publish(GoalChanged(patch.goal_id, data, new))
        for old in list(self.goals)[: -self._max_goals]:
            del self.goals[old]
            self._publish(GoalChanged(old, None))

    def _label(self, eid: str) -> str:
        label = str(self.tables["elements"].get(eid, {}).get("label", ""))
        return label_text(label or local_name(eid))

    # -- robots ------------------------------------------------------------------------------------------------

    def _robot(self, manager: str) -> Robot:
        if manager not in self.robots:
            self.robots[manager] = robot = Robot(manager, self.clock)
            robot.add(self._earlier.get(manager, Totals()))
            self._publish(RobotChanged(self.robots[manager]))
        return self.robots[manager]

    def count_task(self, manager: str, *, is_success: bool) -> None:
        """Counts a task that has ended unseen."""
        robot = self._robot(manager)
        robot.succeeded += is_success
        robot.failed += not is_success
        self._update(robot, has_counted=True)

    def _connect(self, patch: ManagerConnection) -> None:
        robot = self._robot(patch.manager)
        robot.connect(patch.is_connected)
        self.mark_lost(patch.manager)  # also when it connects: its progress may have come first, and continues then
        self._update(robot)

    def _update(self, robot: Robot, has_counted: bool = False) -> None:
        if robot.update() or has_counted:
            self._publish(RobotChanged(robot))

    # -- tables ------------------------------------------------------------------------------------------------

    def _replace_entries(self, patch: EntriesChanged) -> None:
        table = self.tables[patch.table]
        if patch.is_whole:
            table.clear()
        for key, value in patch.entries.items():
            if value is None:
                table.pop(key, None)
            else:
                table[key] = value
        self._publish(patch)

    def _publish(self, change: CellChange) -> None:
        for handler in self._handlers[type(change)]:
            handler(change)
