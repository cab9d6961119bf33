"""The goal line without its widgets: completion, mistakes, planning, and having the goal achieved."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any

from skiros2_gui.app.events import ConnectionChanged, GoalFeedback, WorldChanged
from skiros2_gui.app.problems import error_text
from skiros2_gui.app.throttle import Throttle
from skiros2_gui.app.window import Window
from skiros2_gui.goal.completion import Completions, Vocabulary, complete
from skiros2_gui.goal.execution import GoalExecution
from skiros2_gui.goal.plan import Diagnostic, GoalChecker, GoalPlan, GoalPlanner, check_syntax

_QUEUE = "goal: look"

#: So many goals are remembered.
MAX_HISTORY = 50

_CANCELLING = "Cancelling…"
_COULD_NOT_BE_READ = "the task manager told something that cannot be read"


class GoalPresenter:
    """In the window's thread. `on_goal` is called when there is something to show anew, `on_vocabulary` when other
    words may be suggested.

    :param planner: makes the plans; closed by `close`.
    """

    def __init__(self, window: Window, planner: GoalPlanner | None = None) -> None:
        self._window = window
        self._planner = planner or GoalPlanner()
        self.on_goal: Callable[[], None] = _nothing
        self.on_vocabulary: Callable[[], None] = _nothing
        self.text = ""
        self.diagnostic: Diagnostic | None = None
        self.plan: GoalPlan | None = None
        self.execution: GoalExecution | None = None
        #: What is being done, in words; "" when nothing is.
        self.activity = ""
        #: The goals that were planned or achieved, the last one first.
        self.history: list[str] = []
        self._checker: GoalChecker | None = None
        self._vocabulary = Vocabulary()
        self._is_stale = True  # the words may be other by now
        self._is_unchecked = False  # the text has changed since it was looked at
        self._is_refreshing = False
        self._throttle = Throttle()
        self._cancelled: threading.Event | None = None
        window.subscribe(WorldChanged, lambda _: self._invalidate())
        window.subscribe(ConnectionChanged, lambda _: self._connection_changed())
        window.subscribe(GoalFeedback, self._on_feedback)

    # -- writing -----------------------------------------------------------------------------------------------

    def write(self, text: str) -> None:
        """Takes the goal as it is typed."""
        if text == self.text:
            return
        self.text = text
        self.diagnostic = check_syntax(text) if text.strip() else None
        self._is_unchecked = True
        self.on_goal()
        self.refresh()

    @property
    def is_complete(self) -> bool:
        """Whether there is a goal and no diagnostic is known in it."""
        return bool(self.text.strip()) and self.diagnostic is None

    def completions(self, cursor: int) -> Completions:
        """What may be written at the cursor: so many signs are before it."""
        return complete(self.text, cursor, self._vocabulary)

    def _invalidate(self) -> None:
        self._is_stale = True

    def _connection_changed(self) -> None:
        self._is_stale = True
        self.on_goal()

    def refresh_if_ready(self) -> None:
        """As `look`, for the view to call now and then while the goal line is used: a large scene takes its time."""
        if self._throttle.is_ready:
            self.refresh()

    def refresh(self) -> None:
        """Finds out which words there are and whether the goal can be read, where that may be other than it was."""
        world = self._window.system.world
        if self._is_refreshing or world is None or not (self._is_stale or self._is_unchecked):
            return
        text = self.text if self.diagnostic is None else ""
        is_due = self._is_stale and (self._checker is None or self._throttle.is_ready)
        checker = None if is_due else self._checker
        self._is_stale = self._is_stale and not is_due
        self._is_unchecked = False
        self._is_refreshing = True
        if is_due:
            self._throttle.begin()
        self._window.jobs.run(
            lambda: _checked_in_worker(checker, world, text),
            lambda found: self._refreshed(text, *found),
            self._not_refreshed,
            queue=_QUEUE,
        )

    def _refreshed(self, text: str, checker: GoalChecker, diagnostic: Diagnostic | None) -> None:
        self._is_refreshing = False
        if checker is not self._checker:
            self._throttle.end()
            self._checker, self._vocabulary = checker, checker.vocabulary
            self.on_vocabulary()
        if text and text == self.text:
            self.diagnostic = diagnostic
            self.on_goal()
        if self._is_unchecked:
            self.refresh()

    def _not_refreshed(self, error: Exception) -> None:
        self._is_refreshing = False
        self._throttle.end()
        self._checker = None
        self._window.problems.report("reading the words of goals", error)

    # -- planning ----------------------------------------------------------------------------------------------

    @property
    def is_busy(self) -> bool:
        """Whether a goal is being planned or achieved."""
        return bool(self.activity)

    @property
    def is_cancelling(self) -> bool:
        """Whether what is under way was told to end."""
        return self.activity == _CANCELLING

    @property
    def can_plan(self) -> bool:
        """Whether there is a goal that can be read, and a world model to plan with."""
        return self.is_complete and not self.is_busy and self._window.system.world is not None

    @property
    def has_task_manager(self) -> bool:
        """Whether there is somebody to have goals achieved by."""
        return self._window.system.planner is not None

    @property
    def can_achieve(self) -> bool:
        """Likewise, and a task manager."""
        return self.can_plan and self.has_task_manager

    def make_plan(self) -> None:
        """Looks for a plan, and tries it out on a copy of the scene. Nothing moves."""
        world = self._window.system.world
        if not self.can_plan or world is None:
            return
        goal = self.text
        self._add_to_history(goal)
        self.execution, self.plan = None, None
        self.activity = "Looking for a plan…"
        cancelled = self._cancelled = threading.Event()
        self.on_goal()
        self._window.jobs.run(
            lambda: self._planner.plan(goal, world, cancelled, _log),
            self._planned,
            lambda error: self._planned(GoalPlan(goal, "failed", error_text(error), works=False)),
            activity="planning",
            queue="goal: plan",
        )

    def _planned(self, plan: GoalPlan) -> None:
        self.activity, self._cancelled = "", None
        self.plan = plan
        self.on_goal()

    # -- achieving ---------------------------------------------------------------------------------------------

    def achieve(self) -> None:
        """Has the robots reach the goal."""
        planner = self._window.system.planner
        if not self.can_achieve or planner is None:
            return
        goal = self.text
        self._add_to_history(goal)
        self.plan, self.execution = None, GoalExecution(goal, self._name)
        self.activity = "The robots work at the goal."
        self.on_goal()
        post = self._window.post
        self._window.jobs.run(
            lambda: planner.achieve(goal, lambda feedback: post(GoalFeedback(goal, feedback))),
            self._achieved,
            self._not_achieved,
            activity="achieving a goal",
        )

    def _name(self, eid: str) -> str:
        """The label of an element, or its id."""
        scene = self._window.system.scene
        element = scene.find(eid, "scene") if scene is not None else None
        return f'"{element.label}"' if element is not None and element.label else eid

    def cancel(self) -> None:
        """Ends what is being planned or achieved."""
        if self._cancelled is not None:
            self._cancelled.set()
            self.activity = _CANCELLING
            self.on_goal()
        elif self.execution is not None and not self.execution.is_finished:
            planner = self._window.system.planner
            if planner is None:
                self._window.problems.report("cancelling the goal", "the task manager is not there")
                return
            self.activity = _CANCELLING
            self.on_goal()
            self._window.jobs.run(planner.cancel, activity="cancelling the goal", urgent=True)

    def _on_feedback(self, event: GoalFeedback) -> None:
        if self.execution is not None and event.goal == self.execution.goal and not self.execution.is_finished:
            self._update(lambda execution: execution.after_feedback(event.feedback))

    def _achieved(self, result: Any) -> None:
        self.activity = ""
        if self.execution is not None:
            self._update(lambda execution: execution.after_result(result))
            if not self.execution.is_finished:
                self.execution = self.execution.after_error(_COULD_NOT_BE_READ)
                self.on_goal()

    def _not_achieved(self, error: Exception) -> None:
        self.activity = ""
        if self.execution is not None:
            self.execution = self.execution.after_error(error_text(error))
        self._window.problems.report("achieving a goal", error)
        self.on_goal()

    def _update(self, change: Callable[[GoalExecution], GoalExecution]) -> None:
        assert self.execution is not None
        try:
            self.execution = change(self.execution)
        except ValueError as error:
            self._window.problems.report("following a goal", f"{_COULD_NOT_BE_READ}: {error}")
        self.on_goal()

    # -- settings ----------------------------------------------------------------------------------------------

    def settings(self) -> dict[str, Any]:
        """What is to be kept, as JSON has it."""
        return {"goal": self.text, "goals": self.history}

    def restore(self, settings: Any) -> None:
        """Takes what `settings` gave; what is not as expected is left out."""
        goals, text = settings.get("goals"), settings.get("goal")
        if isinstance(goals, list):
            self.history = [goal for goal in goals if isinstance(goal, str) and goal.strip()][:MAX_HISTORY]
        if isinstance(text, str):
            self.write(text)
        self.on_goal()

    def close(self) -> None:
        """Ends the planning engines. At once, and not in a thread: the process may end next, and would leave them."""
        if self._cancelled is not None:
            self._cancelled.set()
        self._planner.close()

    def _add_to_history(self, goal: str) -> None:
        self.history = [goal, *(known for known in self.history if known != goal)][:MAX_HISTORY]


def _checked_in_worker(checker: GoalChecker | None, world: Any, text: str) -> tuple[GoalChecker, Diagnostic | None]:
    """The words of the world and what is wrong with a goal; in a worker."""
    checker = checker or GoalChecker(world)
    return checker, checker.check(text) if text.strip() else None


def _log(_: str) -> None:
    """What planning is at takes too little time to be shown."""


def _nothing() -> None:
    """Nobody looks."""
