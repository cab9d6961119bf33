"""The goal line without its widgets: completion, mistakes, planning, and having the goal achieved."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any

from skiros2_gui.core.events import AchieveTold, ConnectionChanged, WorldChanged
from skiros2_gui.core.goal_course import Course
from skiros2_gui.core.goal_plan import GoalBook, GoalPlan, GoalPlanner, Mistake, syntax_mistake
from skiros2_gui.core.goal_words import Suggestions, Vocabulary, suggest
from skiros2_gui.core.pace import Pace
from skiros2_gui.core.problems import in_words
from skiros2_gui.core.window import Window

_LANE = "goal: look"

#: So many goals are remembered.
MOST_REMEMBERED = 50

_CANCELLING = "Cancelling…"
_COULD_NOT_BE_READ = "the task manager told something that cannot be read"


class GoalPresenter:
    """In the window's thread. `on_goal` is called when there is something to show anew, `on_words` when other words
    may be suggested.

    :param planner: makes the plans; closed by `close`.
    """

    def __init__(self, window: Window, planner: GoalPlanner | None = None) -> None:
        self._window = window
        self._planner = planner or GoalPlanner()
        self.on_goal: Callable[[], None] = _nothing
        self.on_words: Callable[[], None] = _nothing
        self.text = ""
        self.mistake: Mistake | None = None
        self.plan: GoalPlan | None = None
        self.course: Course | None = None
        #: What is being done, in words; "" when nothing is.
        self.doing = ""
        #: The goals that were planned or achieved, the last one first.
        self.remembered: list[str] = []
        self._book: GoalBook | None = None
        self._vocabulary = Vocabulary()
        self._is_stale = True  # the words may be other by now
        self._is_unread = False  # the text has changed since it was looked at
        self._is_looking = False
        self._pace = Pace()
        self._cancelled: threading.Event | None = None
        window.subscribe(WorldChanged, lambda _: self._outdate())
        window.subscribe(ConnectionChanged, lambda _: self._connection_changed())
        window.subscribe(AchieveTold, self._told)

    # -- writing -----------------------------------------------------------------------------------------------

    def write(self, text: str) -> None:
        """Takes the goal as it is typed."""
        if text == self.text:
            return
        self.text = text
        self.mistake = syntax_mistake(text) if text.strip() else None
        self._is_unread = True
        self.on_goal()
        self.look()

    @property
    def is_complete(self) -> bool:
        """Whether there is a goal and no mistake is known in it."""
        return bool(self.text.strip()) and self.mistake is None

    def suggestions(self, cursor: int) -> Suggestions:
        """What may be written at the cursor: so many signs are before it."""
        return suggest(self.text, cursor, self._vocabulary)

    def _outdate(self) -> None:
        self._is_stale = True

    def _connection_changed(self) -> None:
        self._is_stale = True
        self.on_goal()

    def look_again(self) -> None:
        """As `look`, for the view to call now and then while the goal line is used: a large scene takes its time."""
        if self._pace.is_rested:
            self.look()

    def look(self) -> None:
        """Finds out which words there are and whether the goal can be read, where that may be other than it was."""
        world = self._window.system.world
        if self._is_looking or world is None or not (self._is_stale or self._is_unread):
            return
        text = self.text if self.mistake is None else ""
        is_due = self._is_stale and (self._book is None or self._pace.is_rested)
        book = None if is_due else self._book
        self._is_stale = self._is_stale and not is_due
        self._is_unread = False
        self._is_looking = True
        if is_due:
            self._pace.begin()
        self._window.jobs.run(
            lambda: _looked_up(book, world, text),
            lambda found: self._looked(text, *found),
            self._not_looked,
            lane=_LANE,
        )

    def _looked(self, text: str, book: GoalBook, mistake: Mistake | None) -> None:
        self._is_looking = False
        if book is not self._book:
            self._pace.end()
            self._book, self._vocabulary = book, book.vocabulary
            self.on_words()
        if text and text == self.text:
            self.mistake = mistake
            self.on_goal()
        if self._is_unread:
            self.look()

    def _not_looked(self, error: Exception) -> None:
        self._is_looking = False
        self._pace.end()
        self._book = None
        self._window.problems.tell("reading the words of goals", error)

    # -- planning ----------------------------------------------------------------------------------------------

    @property
    def is_busy(self) -> bool:
        """Whether a goal is being planned or achieved."""
        return bool(self.doing)

    @property
    def is_cancelling(self) -> bool:
        """Whether what is under way was told to end."""
        return self.doing == _CANCELLING

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
        self._remember(goal)
        self.course, self.plan = None, None
        self.doing = "Looking for a plan…"
        cancelled = self._cancelled = threading.Event()
        self.on_goal()
        self._window.jobs.run(
            lambda: self._planner.plan(goal, world, cancelled, _log),
            self._planned,
            lambda error: self._planned(GoalPlan(goal, "failed", in_words(error), works=False)),
            what="planning",
            lane="goal: plan",
        )

    def _planned(self, plan: GoalPlan) -> None:
        self.doing, self._cancelled = "", None
        self.plan = plan
        self.on_goal()

    # -- achieving ---------------------------------------------------------------------------------------------

    def achieve(self) -> None:
        """Has the robots reach the goal."""
        planner = self._window.system.planner
        if not self.can_achieve or planner is None:
            return
        goal = self.text
        self._remember(goal)
        self.plan, self.course = None, Course(goal, self._name)
        self.doing = "The robots work at the goal."
        self.on_goal()
        post = self._window.post
        self._window.jobs.run(
            lambda: planner.achieve(goal, lambda feedback: post(AchieveTold(goal, feedback))),
            self._achieved,
            self._not_achieved,
            what="achieving a goal",
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
            self.doing = _CANCELLING
            self.on_goal()
        elif self.course is not None and not self.course.is_over:
            planner = self._window.system.planner
            if planner is None:
                self._window.problems.tell("cancelling the goal", "the task manager is not there")
                return
            self.doing = _CANCELLING
            self.on_goal()
            self._window.jobs.run(planner.cancel, what="cancelling the goal", urgent=True)

    def _told(self, event: AchieveTold) -> None:
        if self.course is not None and event.goal == self.course.goal and not self.course.is_over:
            self._take(lambda course: course.after_feedback(event.feedback))

    def _achieved(self, result: Any) -> None:
        self.doing = ""
        if self.course is not None:
            self._take(lambda course: course.after_result(result))
            if not self.course.is_over:
                self.course = self.course.after_error(_COULD_NOT_BE_READ)
                self.on_goal()

    def _not_achieved(self, error: Exception) -> None:
        self.doing = ""
        if self.course is not None:
            self.course = self.course.after_error(in_words(error))
        self._window.problems.tell("achieving a goal", error)
        self.on_goal()

    def _take(self, change: Callable[[Course], Course]) -> None:
        assert self.course is not None
        try:
            self.course = change(self.course)
        except ValueError as error:
            self._window.problems.tell("following a goal", f"{_COULD_NOT_BE_READ}: {error}")
        self.on_goal()

    # -- settings ----------------------------------------------------------------------------------------------

    def settings(self) -> dict[str, Any]:
        """What is to be kept, as JSON has it."""
        return {"goal": self.text, "goals": self.remembered}

    def restore(self, settings: Any) -> None:
        """Takes what `settings` gave; what is not as expected is left out."""
        goals, text = settings.get("goals"), settings.get("goal")
        if isinstance(goals, list):
            self.remembered = [goal for goal in goals if isinstance(goal, str) and goal.strip()][:MOST_REMEMBERED]
        if isinstance(text, str):
            self.write(text)
        self.on_goal()

    def close(self) -> None:
        """Ends the planning engines. At once, and not in a thread: the process may end next, and would leave them."""
        if self._cancelled is not None:
            self._cancelled.set()
        self._planner.close()

    def _remember(self, goal: str) -> None:
        self.remembered = [goal, *(known for known in self.remembered if known != goal)][:MOST_REMEMBERED]


def _looked_up(book: GoalBook | None, world: Any, text: str) -> tuple[GoalBook, Mistake | None]:
    """The words of the world and what is wrong with a goal; in a worker."""
    book = book or GoalBook(world)
    return book, book.mistake(text) if text.strip() else None


def _log(_: str) -> None:
    """What planning is at takes too little time to be shown."""


def _nothing() -> None:
    """Nobody looks."""
