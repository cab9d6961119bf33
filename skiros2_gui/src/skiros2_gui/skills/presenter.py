"""The presenter of the tab "Skills": the offered skills, the start form, starting."""

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

#: The job queue of previews.
_QUEUE = "skills: preview"

_MAX_USES = 1_000_000


@dataclass(frozen=True)
class Refused:
    """A refused start.

    :param text: the manager's message.
    :param explanation: the reason, if known.
    """

    text: str
    explanation: Explanation | None = None


class SkillsPresenter:
    """Used in the window's thread.

    The view sets `on_rows`, `on_form` and `on_preview`, which are called when the tree of skills, the form, and the
    preview of a start have changed.
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
        self._stop_when_started = False  # the pending start
        self._offered: dict[str, list[Skill]] = {}
        self._offers: dict[tuple[str, str, str], Offer] = {}
        self._forms: dict[tuple[str, str, str], Form] = {}
        self._is_stale = False  # the preview may be out of date
        self._is_edited = False  # the form has changed
        self._is_refreshing = False
        self._throttle = Throttle()
        window.subscribe(ManagersChanged, lambda _: self.load())
        window.subscribe(WorldChanged, self._world_changed)
        self.load()

    # -- offered skills ---------------------------------------------------------------------------------------

    @property
    def rows(self) -> tuple[RobotRow, ...]:
        """The tree, filtered by the search."""
        return rows_of(self._offered, self.uses, self.search)

    def load(self) -> None:
        """Reads the skills of all managers. Those of disconnected managers are removed at once."""
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
        """Sets the search words."""
        if text != self.search:
            self.search = text
            self.on_rows()

    # -- the chosen skill --------------------------------------------------------------------------------------

    @property
    def is_offered(self) -> bool:
        """Whether a running robot offers the chosen skill."""
        return self.form is not None and self._find(self.form.offer.key) is not None

    def choose(self, key: tuple[str, str, str] | None) -> None:
        """Shows the form of a skill, with the values of its last use."""
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
        """Sets the text of a field."""
        self._edit(key, lambda field: field.write(text))

    def choose_value(self, key: str, value: Any) -> None:
        """Sets an element, by its id, or a boolean."""
        self._edit(key, lambda field: field.choose(value))

    def set_mode(self, key: str, mode: ValueMode) -> None:
        """Sets how a parameter gets its value."""
        self._edit(key, lambda field: field.set_mode(mode))

    def reset(self) -> None:
        """Restores all defaults."""
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

    # -- preview of a start -----------------------------------------------------------------------------------

    def _world_changed(self, _: WorldChanged) -> None:
        self._is_stale = True  # the preview stays until the next refresh

    def _invalidate(self) -> None:
        self._is_stale = self._is_edited = True
        self.on_preview()

    def refresh_if_ready(self) -> None:
        """Refreshes the preview unless the throttle is active; to be called periodically."""
        if self._throttle.is_ready:
            self.refresh()

    def refresh(self) -> None:
        """Refreshes the preview if the scene or the form has changed."""
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
        """Whether a world model was found."""
        return self._window.system.world is not None

    @property
    def can_start(self) -> bool:
        """Whether the form can be sent, even if the preview expects a refusal."""
        return self.form is not None and not self.form.errors and self.is_offered and not self.is_starting

    def start(self, ticks_once: bool = False) -> None:
        """Starts the chosen skill as a task.

        :param ticks_once: ticks it once and pauses it.
        """
        form = self.form
        if form is None or not self.can_start:
            return
        offer = form.offer
        manager = self._window.system.managers[offer.manager]
        step = form.step()
        action = "tick_once" if ticks_once else "start"
        self.is_starting, self._stop_when_started, self.refused = True, False, None
        since = self.tasks.now()
        self.on_preview()
        self._window.jobs.run(
            lambda: _start(manager, action, step),
            lambda task: self._started(form, task, since),
            lambda error: self._started(form, Refused(error_text(error)), since),
            activity=f"starting {offer.name} of {offer.manager}",
        )

    def _started(self, form: Form, result: int | Refused, since: float) -> None:
        self.is_starting = False
        offer = form.offer
        if isinstance(result, int):
            self.uses[offer.use] = min(self.uses.get(offer.use, 0) + 1, _MAX_USES)
            self.tasks.started(offer.manager, result, offer.name, since)
            self._window.publish(TaskStarted(offer.manager, result))
            if self._stop_when_started:
                self.tasks.stop((offer.manager, result))
        elif form is self.form:
            self.refused = result
        else:
            self._window.problems.report(f"starting {offer.name} of {offer.manager}", result.text)
        self.on_preview()

    def toggle(self) -> None:
        """Stops the last task of the chosen skill's robot if it is running; else starts the chosen skill. A pending
        start is stopped once the task id is known.
        """
        if self.is_starting:
            self._stop_when_started = True
            return
        manager = self.form.offer.manager if self.form is not None else ""
        last = self.tasks.last_of(manager)
        if last is not None and not last.is_finished:
            self.tasks.stop(last.key)
        else:
            self.start()

    # -- settings ----------------------------------------------------------------------------------------------

    def settings(self) -> dict[str, Any]:
        """Returns the settings to store, as JSON values."""
        return {"uses": self.uses}

    def restore(self, settings: Mapping[str, Any]) -> None:
        """Restores settings; invalid values are skipped."""
        uses = settings.get("uses")
        if isinstance(uses, Mapping):
            counts = {k: n for k, n in uses.items() if isinstance(k, str) and type(n) is int and 0 < n <= _MAX_USES}
            self.uses = counts
        self.on_rows()


def _start(manager: Any, action: str, step: Any) -> int | Refused:
    """Sends a skill; in a worker. Returns the task id, or the refusal."""
    try:
        return int(manager.command(action, -1, [step]))
    except SkirosError as error:
        return Refused(str(error), _why_refused(manager, str(error)))


def _why_refused(manager: Any, text: str) -> Explanation | None:
    """Returns the manager's explanation of the refused start; None if its last one is about another start."""
    try:
        explanations = json.loads(manager.why(-1).json or "[]")
        explanation = Explanation.from_dict(explanations[-1]) if explanations else None
    except (SkirosError, ValueError):
        return None
    return explanation if explanation is not None and explanation.message in text else None


def _nothing() -> None:
    """The default callback."""
