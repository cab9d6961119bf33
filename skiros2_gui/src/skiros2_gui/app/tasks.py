"""The tasks of all managers since the window was opened, with their commands and the reasons of failures."""

from __future__ import annotations

import weakref
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from typing import Any

import numpy as np

from skiros2_common.core.errors import WrongValue
from skiros2_common.core.forward_clock import now
from skiros2_gui.app.context import WindowContext
from skiros2_gui.app.events import (
    FailureExplained,
    ManagersChanged,
    RunRecorded,
    StopRequested,
    StopTarget,
    TasksChanged,
)
from skiros2_gui.app.names import Names
from skiros2_live.core.cell import CellDocument, GoalChanged, RunsLost
from skiros2_live.core.patch import Connection, GoalProgress, ManagerConnection, SafetyChanged, TaskProgress
from skiros2_runs.core.goal_runs import GOALS
from skiros2_runs.core.states import RUNNING, TaskState
from skiros2_runs.core.task_run import KEEP_ALIVE, Recorded, TaskRun
from skiros2_skill.client.description import Why
from skiros2_skill.core.runtime.history import one_line

#: The commands for a task.
PAUSE, RESUME, STEP, STOP = "pause", "start", "tick_once", "preempt"
_ACTIVITIES = {PAUSE: "pausing", RESUME: "resuming", STEP: "ticking", STOP: "stopping"}

#: The states of ended tasks with a cause.
_UNSUCCESSFUL = (TaskState.FAILED, TaskState.PREEMPTED)

#: The id of all tasks in a command.
_ALL = -1

#: Without a message for this time (s) a task is checked.
_TIMEOUT = 3 * KEEP_ALIVE

#: Without a message for this time a running task counts as silent (s).
SILENCE_TIMEOUT = 5 * KEEP_ALIVE


class TaskList:
    """The one list of tasks, shown by several tabs. A goal is a task of `GOALS`. Used in the window's thread.

    Publishes `TasksChanged`, `RunRecorded` and `FailureExplained`.

    :param clock: returns the time (s since the epoch).
    :ivar cell: the running cell, as the system has reported it.
    :ivar why_of: the task that `why` (in lines) explains.
    """

    def __init__(self, window: WindowContext, clock: Callable[[], float] = now) -> None:
        self._window = window
        self._clock = clock
        self._published: weakref.WeakKeyDictionary[TaskRun, TaskState] = weakref.WeakKeyDictionary()
        self._started: dict[str, int] = {}  # the task started last in this window, by manager
        self._names = Names(window.system)
        self.cell = CellDocument(self._names.of, clock=clock)
        self.runs = self.cell.runs
        self._goals = self.cell.goal_runs
        self.why_of: TaskRun | None = None
        self.why: tuple[str, ...] = ()
        self._whys: weakref.WeakKeyDictionary[TaskRun, Why] = weakref.WeakKeyDictionary()
        self.cell.subscribe(Recorded, self._publish)
        self.cell.subscribe(RunsLost, lambda _: window.publish(TasksChanged()))
        self.cell.subscribe(GoalChanged, self._on_goal)
        window.subscribe(Connection, self.cell.apply)
        window.subscribe(ManagerConnection, self.cell.apply)
        window.subscribe(SafetyChanged, self.cell.apply)
        window.subscribe(TaskProgress, self.cell.apply)
        window.subscribe(GoalProgress, self._apply_goal)
        window.subscribe(ManagersChanged, lambda _: window.publish(TasksChanged()))
        window.subscribe(StopRequested, self._stop_all)

    # -- tasks -------------------------------------------------------------------------------------------------

    @property
    def shown(self) -> list[TaskRun]:
        """The tasks that lists show: goals instead of the tasks of their steps; oldest first."""
        return self.cell.shown

    @property
    def rows(self) -> list[TaskRun]:
        """The shown tasks in the order of lists."""
        return in_order(self.shown)

    def goal_of(self, run: TaskRun) -> TaskRun | None:
        """Returns the goal of a step's task; None for other tasks."""
        return self._goals.goal_of(run)

    def origin(self, run: TaskRun, node: int) -> tuple[TaskRun, int] | None:
        """Returns the task and the id of a node, also of a goal's tree; None if it is in no task."""
        return self._goals.origin(run, node)

    def robot_of(self, run: TaskRun, node: int) -> str:
        """Returns the manager of a node, also of a goal's tree; "" for the root of a goal."""
        return self._goals.robot_of(run, node)

    def tasks_of(self, run: TaskRun) -> list[TaskRun]:
        """Returns the tasks of a goal's steps, in order; of another task itself."""
        return list(self._goals.tasks(run)) if run.robot == GOALS else [run]

    def find(self, robot: str, task_id: int) -> TaskRun | None:
        """Returns the latest task with that id."""
        return self.cell.find(robot, task_id)

    def newest(self) -> TaskRun | None:
        """Returns the newest running task, or else the newest task."""
        known = self.shown
        chosen = [run for run in known if not run.is_finished] or known
        return chosen[-1] if chosen else None

    def last_started(self, robot: str) -> TaskRun | None:
        """Returns the task of a manager that was started last in this window; None if there is none."""
        return self.find(robot, self._started[robot]) if robot in self._started else None

    def started(self, robot: str, task_id: int, nodes: Sequence[Any], stamp: float) -> None:
        """Adds a task that was started in this window.

        :param nodes: the manager's answer; empty if the task has ended already.
        :param stamp: when the manager was asked (s since the epoch).
        """
        self._started[robot] = task_id
        self._record_all(robot, [nodes], stamp)

    def clear_ended(self) -> None:
        """Removes the tasks that have ended."""
        self.runs.clear_ended()
        self._window.publish(TasksChanged())

    def check(self, now: float) -> None:
        """Checks tasks and goals without recent progress, in case the message of their end was lost. To be called
        periodically.

        :param now: s since the epoch.
        """
        silent = [run for run in self.runs if not run.is_finished and now - run.latest.time > _TIMEOUT]
        for robot in {run.robot for run in silent} & self._window.system.managers.keys():
            manager = self._window.system.managers[robot]
            done = partial(self._mark_missing, [run for run in silent if run.robot == robot], now)
            self._window.jobs.run(manager.read_tasks, done, lambda error: None, queue=robot)
        planner, goals = self._window.system.planner, [run for run in silent if run.robot == GOALS]
        if goals and planner is not None:
            active = planner.active_goals
            self._mark_lost([run for run in goals if self._goals.id_of(run) not in active])

    # -- commands ----------------------------------------------------------------------------------------------

    def command(self, action: str, robot: str, task_id: int) -> None:
        """Sends a command for a task; for a goal: `STOP` cancels it, others are for its running tasks.

        :param action: `PAUSE`, `RESUME`, `STEP` (one tick) or `STOP`.
        """
        if robot == GOALS:
            self._command_goal(action, task_id)
            return
        manager = self._window.system.managers.get(robot)
        activity = f"{_ACTIVITIES[action]} {f'task {task_id}' if task_id >= 0 else 'all tasks'} of {robot}"
        if manager is None:
            self._window.problems.report(activity, f"{robot} is not running")
            return

        def send() -> tuple[list[Sequence[Any]], float]:
            manager.command(action, task_id)
            stamp = self._clock()
            # A paused task publishes no progress.
            return (manager.read_tasks(task_id) if action in (PAUSE, STEP) else []), stamp

        # Not in the queue of the inspections: stopping does not wait, other commands wait for each other only.
        self._window.jobs.run(
            send,
            lambda answer: self._record_all(robot, *answer),
            activity=activity,
            queue="" if action == STOP else f"{robot}: commands",
        )

    def _command_goal(self, action: str, number: int) -> None:
        run, planner = self.find(GOALS, number), self._window.system.planner
        if run is None:
            return
        if action != STOP:
            for task in self._goals.tasks(run):
                if not task.is_finished:
                    self.command(action, task.robot, task.task_id)
        elif planner is None:
            self._window.problems.report("cancelling the goal", "the task manager is not running")
        else:
            goal_id = self._goals.id_of(run)
            self._window.jobs.run(lambda: planner.cancel_goal(goal_id), activity="cancelling the goal")

    def toggle(self, run: TaskRun) -> None:
        """Pauses a task, or resumes a paused one."""
        self.command(RESUME if run.state is TaskState.PAUSED else PAUSE, run.robot, run.task_id)

    def _stop_all(self, request: StopRequested) -> None:
        """Preempts all tasks of all managers, also those that this window does not know yet."""
        for run in in_order(self.runs):
            if not run.is_finished and run.robot != GOALS:
                name = f"{skills_text(run)} of {run.robot.lstrip('/')}"
                request.targets.append(StopTarget(name, partial(_is_finished, run)))
        for robot in self._window.system.managers:
            self.command(STOP, robot, _ALL)

    def ask_why(self, run: TaskRun | None) -> None:
        """Reads why a task failed into `why`."""
        self.why_of, self.why = run, ()
        if run is not None and run.robot == GOALS and run.state is TaskState.FAILED:
            failed = [self._whys[task] for task in self._goals.tasks(run) if task in self._whys]
            self.why = (*run.latest.message(0).splitlines(), *(failure_lines(failed[-1]) if failed else ()))
            self.why = tuple(map(self._names.readable, self.why))
        self._window.publish(FailureExplained())
        if run is not None:
            self._read_why(run)

    def _read_why(self, run: TaskRun) -> None:
        manager = self._window.system.managers.get(run.robot)
        if manager is None or run.state not in _UNSUCCESSFUL:
            return
        self._window.jobs.run(
            lambda: manager.why(run.task_id),
            lambda why: self._explain(run, why),
            activity=f"asking why task {run.task_id} of {run.robot} failed",
            queue=run.robot,
        )

    def _explain(self, run: TaskRun, why: Why) -> None:
        self._whys[run] = why
        if run is self.why_of:
            self.why = tuple(map(self._names.readable, failure_lines(why)))
        self._window.publish(FailureExplained())
        self._window.publish(TasksChanged())

    def cause(self, run: TaskRun) -> str:
        """Returns why a task failed or was preempted, in one sentence; "" if that is not known."""
        why = self._whys.get(run)
        return why.explanations[-1].sentence if why is not None and why.explanations else ""

    def message(self, run: TaskRun) -> str:
        """Returns why a task failed, or else its message."""
        return self.cause(run) or message_text(run)

    # -- progress ----------------------------------------------------------------------------------------------

    def _apply_goal(self, event: GoalProgress) -> None:
        try:
            self.cell.apply(event)
        except WrongValue as error:
            self._window.problems.report("following a goal", str(error))

    def _on_goal(self, change: GoalChanged) -> None:
        if change.new_steps:
            self._window.publish(TasksChanged())

    def _publish(self, recorded: Recorded) -> None:
        run = recorded.run
        if self._published.get(run) != run.state:
            self._published[run] = run.state
            self._window.publish(TasksChanged())
            self._read_why(run)
        self._window.publish(RunRecorded(run, recorded.is_new_shape))

    def _record_all(self, robot: str, tasks: Sequence[Sequence[Any]], stamp: float) -> None:
        for nodes in tasks:
            self.cell.apply(TaskProgress(robot, nodes, stamp))

    def _mark_missing(self, silent: list[TaskRun], asked: float, tasks: list[Any]) -> None:
        alive = {nodes[0].id for nodes in tasks if nodes}
        self._mark_lost([run for run in silent if run.task_id not in alive and run.latest.time < asked])

    def _mark_lost(self, runs: Iterable[TaskRun]) -> None:
        for run in runs:
            if not run.is_finished:
                run.is_lost = True
                self._window.publish(TasksChanged())


def in_order(runs: Iterable[TaskRun]) -> list[TaskRun]:
    """Returns the running tasks, then the ended ones; the newest first."""
    return sorted(runs, key=lambda run: (run.is_finished, -run.start, run.robot, run.task_id))


def skills_text(run: TaskRun) -> str:
    """Returns the names of a task's skills."""
    return run.latest.shape.skills_text(most=3) or run.latest.shape.name(0)


def _is_finished(run: TaskRun) -> bool:
    return run.is_finished


def is_silent(run: TaskRun, now: float) -> bool:
    """Returns whether a running task has published nothing for `SILENCE_TIMEOUT`.

    :param now: s since the epoch.
    """
    return run.robot != GOALS and run.state is TaskState.RUNNING and now - run.latest.time > SILENCE_TIMEOUT


def message_text(run: TaskRun) -> str:
    """Returns the message of the root of a paused or ended task, else that of the deepest running node; one line."""
    frame = run.latest
    text = frame.message(0)
    if run.state is TaskState.LOST:
        text = "the task manager no longer reports it" if run.robot == GOALS else "the robot has disconnected"
    running = np.flatnonzero(frame.rows["state"] == RUNNING)
    if run.state is TaskState.RUNNING and len(running) and running[-1]:
        index = int(running[-1])
        name = frame.shape.name(index)
        text = f"{name}: {frame.message(index)}" if frame.message(index) else name
    return one_line(text)


def failure_lines(why: Why) -> tuple[str, ...]:
    """Returns why a task failed, in lines: the sentence, then the details of all failures, the decisive one first."""
    if not why.explanations:
        return tuple(why.text.splitlines())
    details = (line for explanation in reversed(why.explanations) for line in explanation.details())
    return (why.explanations[-1].sentence, *details)
