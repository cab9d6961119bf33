"""The tab "Skills" without its widgets: which skills there are, the chosen one and its parameters, starting it."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from skiros2_common.core.errors import SkirosError
from skiros2_common.core.explanation import Explanation
from skiros2_gui.app.events import ManagersChanged, TaskStarted, WorldChanged
from skiros2_gui.app.problems import error_text
from skiros2_gui.app.throttle import Throttle
from skiros2_gui.app.window import Window
from skiros2_gui.skills.catalogue import Offer, RobotRow, offers_of, rows_of
from skiros2_gui.skills.fields import Field, ValueMode
from skiros2_gui.skills.form import Form
from skiros2_gui.skills.start_preview import StartPreview, preview_start
from skiros2_gui.skills.task_presenter import TaskListPresenter
from skiros2_skill.command_line.description import Skill

#: What the jobs that look how a start would go have to themselves.
_QUEUE = "skills: look"

_MAX_USES = 1_000_000


@dataclass(frozen=True)
class Refused:
    """A start that did not come off.

    :param text: what the manager said.
    :param explanation: why, where it tells.
    """

    text: str
    explanation: Explanation | None = None


class SkillsPresenter:
    """Holds what the tab shows. In the window's thread.

    `on_rows`, `on_form`, `on_preview` are called when the tree of skills, the form, and what would come of a start are
    other than before; the view sets them.
    """

    def __init__(self, window: Window) -> None:
        self._window = window
        self.tasks = TaskListPresenter(window)
        self.on_rows: Callable[[], None] = _nothing
        self.on_form: Callable[[], None] = _nothing
        self.on_preview: Callable[[], None] = _nothing
        self.search = ""
        self.uses: dict[str, int] = {}
        self.form: Form | None = None
        self.preview: StartPreview | None = None
        self.refused: Refused | None = None
        self.is_starting = False
        self._stops = False  # what is being started is to be stopped
        self._offered: dict[str, list[Skill]] = {}
        self._offers: dict[tuple[str, str, str], Offer] = {}
        self._forms: dict[tuple[str, str, str], Form] = {}
        self._is_stale = False  # what would come of a start may be other by now
        self._is_edited = False  # so that it has to be looked at once
        self._is_refreshing = False
        self._throttle = Throttle()
        window.subscribe(ManagersChanged, lambda _: self.load())
        window.subscribe(WorldChanged, self._world_changed)
        self.load()

    # -- which skills there are --------------------------------------------------------------------------------

    @property
    def rows(self) -> tuple[RobotRow, ...]:
        """The tree, as the search leaves it."""
        return rows_of(self._offered, self.uses, self.search)

    def load(self) -> None:
        """Asks all managers for their skills. Those that are gone are left out at once."""
        managers = self._window.system.managers
        self._offered = {name: skills for name, skills in self._offered.items() if name in managers}
        for name, manager in managers.items():
            self._window.jobs.run(
                manager.skills,
                lambda skills, name=name: self._take(name, skills),  # type: ignore[misc]
                activity=f"reading the skills of {name}",
                queue=name,
            )
        self._show_rows()

    def _take(self, name: str, skills: list[Skill]) -> None:
        if name in self._window.system.managers:
            self._offered[name] = skills
            self._show_rows()

    def _show_rows(self) -> None:
        self._offers = {offer.key: offer for offer in offers_of(rows_of(self._offered, {}))}
        self.on_rows()
        chosen = self.form.offer if self.form is not None else None
        if chosen is None:
            return
        known = self._find(chosen.key)
        if known is not None and known != chosen:
            self.choose(known.key)
        elif known is None:
            self._invalidate()

    def search_for(self, text: str) -> None:
        """Leaves in the tree what has these words."""
        if text != self.search:
            self.search = text
            self.on_rows()

    # -- the chosen skill --------------------------------------------------------------------------------------

    @property
    def is_offered(self) -> bool:
        """Whether the robot of the chosen skill is there and offers it."""
        return self.form is not None and self._find(self.form.offer.key) is not None

    def choose(self, key: tuple[str, str, str] | None) -> None:
        """Shows the parameters of a skill, with what was filled in when it was shown last."""
        offer = self._find(key) if key is not None else None
        if offer is None:
            self.form = None
        elif self.form is None or self.form.offer != offer:
            before = self._forms.get(offer.key)
            self.form = self._forms[offer.key] = Form(offer)
            if before is not None:
                self.form.adopt(before)
        else:
            return
        self.preview, self.refused = None, None
        self.on_form()
        self._invalidate()
        self.refresh()

    def _find(self, key: tuple[str, str, str]) -> Offer | None:
        return self._offers.get(key)

    def write(self, key: str, text: str) -> None:
        """Something was typed into an editor."""
        self._edit(key, lambda field: field.write(text))

    def choose_value(self, key: str, value: Any) -> None:
        """An element, by its id, or yes or no was chosen."""
        self._edit(key, lambda field: field.choose(value))

    def set_mode(self, key: str, mode: ValueMode) -> None:
        """The parameter is to be inferred, or unset, or given."""
        self._edit(key, lambda field: field.set_mode(mode))

    def reset(self) -> None:
        """All parameters as the skill declares them."""
        if self.form is not None:
            self.form.reset()
            self.refused = None
            self.on_form()
            self._invalidate()
            self.refresh()

    def _edit(self, key: str, change: Callable[[Field], None]) -> None:
        field = self.form.fields.get(key) if self.form is not None else None
        if field is not None:
            change(field)
            self.refused = None
            self._invalidate()
            self.refresh()

    # -- what would come of a start ----------------------------------------------------------------------------

    def _world_changed(self, _: WorldChanged) -> None:
        self._is_stale = True  # what is shown stays until it was looked anew

    def _invalidate(self) -> None:
        self._is_stale = self._is_edited = True
        self.on_preview()

    def refresh_if_ready(self) -> None:
        """As `look`, for the view to call now and then: a scene that always changes is not looked at each time."""
        if self._throttle.is_ready:
            self.refresh()

    def refresh(self) -> None:
        """Finds out what would come of a start, where that may be other than it was."""
        form, world = self.form, self._window.system.world
        if not self._is_stale or self._is_refreshing or form is None or world is None:
            return
        self._is_stale = self._is_edited = False
        given = form.given()
        self._is_refreshing = True
        self._throttle.begin()
        self._window.jobs.run(
            lambda: preview_start(form.offer, given, form.classes, world),
            lambda preview: self._refreshed(form, preview),
            lambda error: self._refreshed(form, StartPreview(problem=error_text(error))),
            queue=_QUEUE,
        )

    def _refreshed(self, form: Form, preview: StartPreview) -> None:
        self._is_refreshing = False
        self._throttle.end()
        if form is self.form:
            self.preview = preview
            self.on_preview()
        if self._is_edited:
            self.refresh()

    # -- starting ----------------------------------------------------------------------------------------------

    @property
    def has_world(self) -> bool:
        """Whether there was a world model yet."""
        return self._window.system.world is not None

    @property
    def can_start(self) -> bool:
        """Whether there is something to be sent; what would be refused may be sent too."""
        return self.form is not None and not self.form.errors and self.is_offered and not self.is_starting

    def start(self, ticks_once: bool = False) -> None:
        """Starts the chosen skill as a task of its own.

        :param ticks_once: it is ticked once and paused.
        """
        form = self.form
        if form is None or not self.can_start:
            return
        offer = form.offer
        manager = self._window.system.managers[offer.manager]
        step = form.step()
        action = "tick_once" if ticks_once else "start"
        self.is_starting, self._stops, self.refused = True, False, None
        since = self.tasks.now()
        self.on_preview()
        self._window.jobs.run(
            lambda: _start(manager, action, step),
            lambda came: self._started(form, came, since),
            lambda error: self._started(form, Refused(error_text(error)), since),
            activity=f"starting {offer.name} of {offer.manager}",
        )

    def _started(self, form: Form, came: int | Refused, since: float) -> None:
        self.is_starting = False
        offer = form.offer
        if isinstance(came, int):
            self.uses[offer.use] = min(self.uses.get(offer.use, 0) + 1, _MAX_USES)
            self.tasks.started(offer.manager, came, offer.name, since)
            self._window.publish(TaskStarted(offer.manager, came))
            if self._stops:
                self.tasks.stop((offer.manager, came))
        elif form is self.form:
            self.refused = came
        else:
            self._window.problems.report(f"starting {offer.name} of {offer.manager}", came.text)
        self.on_preview()

    def toggle(self) -> None:
        """Stops what was started last, of the chosen skill's robot; when that has ended, starts the chosen skill. A
        start that is under mode is stopped when the task's id is known."""
        if self.is_starting:
            self._stops = True
            return
        manager = self.form.offer.manager if self.form is not None else ""
        last = self.tasks.last_of(manager)
        if last is not None and not last.is_finished:
            self.tasks.stop(last.key)
        else:
            self.start()

    # -- settings ----------------------------------------------------------------------------------------------

    def settings(self) -> dict[str, Any]:
        """What is to be kept, as JSON has it."""
        return {"uses": self.uses}

    def restore(self, settings: Mapping[str, Any]) -> None:
        """Takes what `settings` gave; what is not as expected is left out."""
        uses = settings.get("uses")
        if isinstance(uses, Mapping):
            counts = {k: n for k, n in uses.items() if isinstance(k, str) and type(n) is int and 0 < n <= _MAX_USES}
            self.uses = counts
        self.on_rows()


def _start(manager: Any, action: str, step: Any) -> int | Refused:
    """Sends a skill; in a worker. What the manager says against it is an answer too."""
    try:
        return int(manager.command(action, -1, [step]))
    except SkirosError as error:
        return Refused(str(error), _why_refused(manager, str(error)))


def _why_refused(manager: Any, text: str) -> Explanation | None:
    """What the manager tells of the start that it has just refused; None when it tells of something else."""
    try:
        told = json.loads(manager.why(-1).json or "[]")
        explanation = Explanation.from_dict(told[-1]) if told else None
    except (SkirosError, ValueError):
        return None
    return explanation if explanation is not None and explanation.message in text else None


def _nothing() -> None:
    """Nobody looks."""
