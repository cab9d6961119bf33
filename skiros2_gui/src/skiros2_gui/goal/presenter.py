"""The presenter of goals: editing as text and as lines, diagnostics, planning, execution."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

from skiros2_common.core.world_model_port import WorldModelPort
from skiros2_gui.app.events import ConnectionChanged, GoalFeedback, StopRequested, StopTarget, WorldChanged
from skiros2_gui.app.jobs import Throttle
from skiros2_gui.app.names import Names
from skiros2_gui.app.problems import error_text
from skiros2_gui.app.window import Window
from skiros2_gui.goal.plan import GoalExecution, GoalPlan, read_plan
from skiros2_task.core.goal_checker import Diagnostic, GoalChecker, check_syntax
from skiros2_task.core.goal_choices import GoalChoices
from skiros2_task.core.goal_completion import Completions, GoalVocabulary, complete
from skiros2_task.core.goal_lines import Line, read_lines, write_lines
from skiros2_task.core.goal_sentence import goal_sentence, lines_sentence
from skiros2_world_model.core.vocabulary import Vocabulary

_QUEUE = "goal: check"

#: The most goals kept.
MAX_HISTORY = 50

_CANCELLING = "Cancelling…"
_UNREADABLE = "the response of the task manager cannot be read"


class GoalPresenter:
    """Used in the window's thread. The view sets `on_goal`, called when the state has changed, and `on_vocabulary`,
    called when the completions have.
    """

    def __init__(self, window: Window) -> None:
        self._window = window
        self.names = Names(window.system)
        self.on_goal: Callable[[], None] = _nothing
        self.on_vocabulary: Callable[[], None] = _nothing
        self.text = ""
        #: The goal as lines, incomplete ones included; None if the text does not parse.
        self.lines: tuple[Line, ...] | None = ()
        self.diagnostic: Diagnostic | None = None
        self.plan: GoalPlan | None = None
        self.execution: GoalExecution | None = None
        #: The running activity; "" for none.
        self.activity = ""
        #: The goals planned or executed, the last one first.
        self.history: list[str] = []
        self._checker: GoalChecker | None = None
        #: The names that goals may use.
        self.vocabulary = GoalVocabulary()
        #: The choices for the lines; None before the world was read.
        self.choices: GoalChoices | None = None
        self._ontology: Vocabulary | None = None
        self._is_stale = True  # the vocabulary may be out of date
        self._is_unchecked = False  # the text has not been checked
        self._is_refreshing = False
        self._throttle = Throttle()
        self._is_planning = False
        window.subscribe(WorldChanged, self._invalidate)
        window.subscribe(ConnectionChanged, lambda _: self._connection_changed())
        window.subscribe(GoalFeedback, self._on_feedback)
        window.subscribe(StopRequested, self._on_stop)

    # -- editing -----------------------------------------------------------------------------------------------

    def write(self, text: str) -> None:
        """Sets the text of the goal."""
        if text == self.text:
            return
        self.text = text
        self.diagnostic = check_syntax(text) if text.strip() else None
        if self.diagnostic is not None:
            self.lines = None
        elif self.lines is None or text != write_lines(self.lines):
            self.lines = read_lines(text) if text.strip() else ()
        self._is_unchecked = True
        self.on_goal()
        self.refresh()

    def edit_lines(self, lines: Iterable[Line]) -> None:
        """Sets the lines of the goal; its text follows from the complete ones."""
        self.lines = tuple(lines)
        text = write_lines(self.lines)
        if text == self.text:
            self.on_goal()
        else:
            self.write(text)

    @property
    def sentence(self) -> str:
        """The goal for people, such as "Tray B contains Product A"; its text if it does not parse."""
        text = self.text if self.lines is None else lines_sentence(self.lines, self.names.of)
        return self.names.in_text(text)

    def sentence_of(self, goal: str) -> str:
        """Returns another goal for people."""
        return self.names.in_text(goal_sentence(" ".join(goal.split()), self.names.of))

    @property
    def is_complete(self) -> bool:
        """Whether there is a goal without known error."""
        return bool(self.text.strip()) and self.diagnostic is None

    def completions(self, cursor: int) -> Completions:
        """Returns the completions at a cursor (an offset)."""
        return complete(self.text, cursor, self.vocabulary)

    def _invalidate(self, event: WorldChanged) -> None:
        self._is_stale = True
        if event.ontology:
            self._ontology = None

    def _connection_changed(self) -> None:
        self._is_stale, self._ontology = True, None
        self.on_goal()

    def refresh_if_ready(self) -> None:
        """Refreshes unless the throttle is active; to be called periodically while the goal line is used."""
        if self._throttle.is_ready:
            self.refresh()

    def refresh(self) -> None:
        """Reads the vocabulary and checks the goal, if they may have changed."""
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
        ontology = self._ontology
        self._window.jobs.run(
            lambda: _check(checker, world, ontology, text),
            lambda found: self._refreshed(text, *found),
            self._not_refreshed,
            queue=_QUEUE,
        )

    def _refreshed(self, text: str, checker: GoalChecker, diagnostic: Diagnostic | None) -> None:
        self._is_refreshing = False
        if checker is not self._checker:
            self._throttle.end()
            self._checker, self.vocabulary, self.choices = checker, checker.vocabulary, checker.choices
            if not self._is_stale:
                self._ontology = checker.ontology
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
        self._window.problems.report("reading the vocabulary", error)

    # -- planning ----------------------------------------------------------------------------------------------

    @property
    def is_busy(self) -> bool:
        """Whether a goal is being planned or executed."""
        return bool(self.activity)

    @property
    def is_cancelling(self) -> bool:
        """Whether planning or execution is being cancelled."""
        return self.activity == _CANCELLING

    @property
    def can_plan(self) -> bool:
        """Whether there is a valid goal, and a task manager to plan it."""
        return self.is_complete and not self.is_busy and self.has_task_manager

    @property
    def has_task_manager(self) -> bool:
        """Whether the task manager is up."""
        return self._window.system.planner is not None

    def make_plan(self) -> None:
        """Lets the task manager plan the goal and simulate the plan."""
        planner = self._window.system.planner
        if not self.can_plan or planner is None:
            return
        goal = self.text
        self._add_to_history(goal)
        self.execution, self.plan = None, None
        self.activity = "Looking for a plan…"
        self._is_planning = True
        self.on_goal()
        self._window.jobs.run(
            lambda: planner.plan(goal),
            lambda result: self._planned(self._plan_of(goal, result)),
            lambda error: self._planned(GoalPlan(goal, "failed", error_text(error), works=False)),
            activity="planning",
            queue="goal: plan",
        )

    def _plan_of(self, goal: str, result: Any) -> GoalPlan:
        try:
            return read_plan(goal, result, self.names.of)
        except ValueError as error:
            return GoalPlan(goal, "failed", f"{_UNREADABLE}: {error}", works=False)

    def _planned(self, plan: GoalPlan) -> None:
        self.activity, self._is_planning = "", False
        self.plan = plan
        self.on_goal()

    # -- execution ---------------------------------------------------------------------------------------------

    def achieve(self) -> None:
        """Lets the task manager execute the goal."""
        planner = self._window.system.planner
        if not self.can_plan or planner is None:
            return
        goal = self.text
        self._add_to_history(goal)
        self.plan, self.execution = None, GoalExecution(goal, self.names.of)
        self.activity = "The robots are executing the plan."
        self.on_goal()
        post = self._window.post
        self._window.jobs.run(
            lambda: planner.achieve(goal, lambda feedback: post(GoalFeedback(goal, feedback))),
            self._achieved,
            self._not_achieved,
            activity="achieving a goal",
        )

    def _on_stop(self, request: StopRequested) -> None:
        if self.is_busy:
            request.targets.append(StopTarget("the goal", lambda: not self.is_busy))
        self.cancel()

    def cancel(self) -> None:
        """Cancels planning or execution."""
        if self._is_planning or (self.execution is not None and not self.execution.is_finished):
            planner = self._window.system.planner
            if planner is None:
                self._window.problems.report("cancelling the goal", "the task manager is not running")
                return
            self.activity = _CANCELLING
            self.on_goal()
            self._window.jobs.run(planner.cancel, activity="cancelling the goal")

    def _on_feedback(self, event: GoalFeedback) -> None:
        if self.execution is not None and event.goal == self.execution.goal and not self.execution.is_finished:
            self._update(lambda execution: execution.after_feedback(event.feedback))

    def _achieved(self, result: Any) -> None:
        self.activity = ""
        if self.execution is not None:
            self._update(lambda execution: execution.after_result(result))
            if not self.execution.is_finished:
                self.execution = self.execution.after_error(_UNREADABLE)
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
            self._window.problems.report("following a goal", f"{_UNREADABLE}: {error}")
        self.on_goal()

    # -- settings ----------------------------------------------------------------------------------------------

    def settings(self) -> dict[str, Any]:
        """Returns the settings to store, as JSON values."""
        return {"goal": self.text, "goals": self.history}

    def restore(self, settings: Any) -> None:
        """Restores settings; invalid values are skipped."""
        goals, text = settings.get("goals"), settings.get("goal")
        if isinstance(goals, list):
            self.history = [goal for goal in goals if isinstance(goal, str) and goal.strip()][:MAX_HISTORY]
        if isinstance(text, str):
            self.write(text)
        self.on_goal()

    def _add_to_history(self, goal: str) -> None:
        self.history = [goal, *(known for known in self.history if known != goal)][:MAX_HISTORY]


def _check(
    checker: GoalChecker | None, world: WorldModelPort, ontology: Vocabulary | None, text: str
) -> tuple[GoalChecker, Diagnostic | None]:
    """Returns the checker and the diagnostic of a goal; in a worker."""
    checker = checker or GoalChecker(world, ontology)
    return checker, checker.check(text) if text.strip() else None


def _nothing() -> None:
    """The default callback."""
