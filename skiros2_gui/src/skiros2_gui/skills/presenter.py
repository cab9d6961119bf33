"""The presenter of the tab "Skills": the offered skills, the start form, starting."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any

from skiros2_common.core.errors import SkirosError
from skiros2_common.core.explanation import Explanation
from skiros2_common.core.operations import SCENE
from skiros2_common.core.world_element import Element
from skiros2_gui.app.events import ManagersChanged, TaskStarted, WorldChanged
from skiros2_gui.app.jobs import Throttle
from skiros2_gui.app.names import Names
from skiros2_gui.app.problems import error_text
from skiros2_gui.app.system import Manager
from skiros2_gui.app.tasks import STOP
from skiros2_gui.app.window import Window
from skiros2_gui.skills.catalogue import Offer, RobotRow, offers_of, rows_of
from skiros2_gui.skills.form import ElementChoice, Field, Form, ValueMode, element_choices
from skiros2_gui.skills.recent import RecentValues, Values, entered
from skiros2_skill.client.description import Skill, Step
from skiros2_skill.core.start_preview import StartPreview
from skiros2_world_model.core.world_model_client import WorldModelClient

#: The time between attempts to read the skills of a connected manager (s).
RETRY_PERIOD = 10.0
#: The job queue of previews.
_QUEUE = "skills: preview"


@dataclass(frozen=True)
class Started:
    """A started task.

    :param nodes: its `SkillProgress` messages; empty if it has ended already.
    :param stamp: when they were asked for (s since the epoch).
    """

    task_id: int
    nodes: Sequence[Any]
    stamp: float


@dataclass(frozen=True)
class Refused:
    """A refused start.

    :param text: the manager's message.
    :param preview: of a repetition; None if the manager does not answer.
    """

    text: str
    preview: StartPreview | None = None

    @property
    def explanation(self) -> Explanation | None:
        """The reason, if known."""
        return self.preview.refusal if self.preview is not None else None


@dataclass(frozen=True)
class Preview:
    """A preview of a start.

    :param start: the manager's; None if there is none.
    :param choices: the elements of each class that a parameter requires, by class.
    :param problem: why there is no preview; "" if there is one.
    """

    start: StartPreview | None = None
    choices: Mapping[str, Sequence[ElementChoice]] = field(default_factory=dict)
    problem: str = ""

    def element(self, key: str) -> ElementChoice | None:
        """Returns the element that a parameter would get; None if it would not get one."""
        found = self.start.elements.get(key) if self.start is not None else None
        return ElementChoice(found.id, found.label, found.type) if found is not None else None


class SkillsPresenter:
    """Used in the window's thread.

    The view sets `on_rows`, `on_form` and `on_preview`, which are called when the tree of skills, the form, and the
    preview of a start have changed.

    :param clock: monotonic (s).
    """

    def __init__(self, window: Window, clock: Callable[[], float] = time.monotonic) -> None:
        self._window = window
        self._clock = clock
        self.names = Names(window.system)
        self.tasks = window.tasks
        self.on_rows: Callable[[], None] = _nothing
        self.on_form: Callable[[], None] = _nothing
        self.on_preview: Callable[[], None] = _nothing
        self.search = ""
        self.form: Form | None = None
        self.preview: Preview | None = None
        self.recent = RecentValues()
        self.refused: Refused | None = None
        self.is_starting = False
        self._stop_when_started = False  # the pending start
        self._offered: dict[str, list[Skill]] = {}
        self._failed: dict[str, float] = {}  # managers whose skills could not be read, and when
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
        return rows_of(self._offered, self.search)

    def load(self) -> None:
        """Reads the skills of all managers. Those of disconnected managers are removed at once."""
        managers = self._window.system.managers
        self._offered = {name: skills for name, skills in self._offered.items() if name in managers}
        for name in managers:
            self._read(name)
        self._show_rows()

    def _read(self, name: str) -> None:
        self._failed.pop(name, None)
        manager = self._window.system.managers.get(name)
        if manager is not None:
            activity = f"reading the skills of {name}"
            self._window.jobs.run(
                manager.read_skills,
                partial(self._take, name),
                partial(self._not_read, name, activity),
                activity=activity,
                queue=name,
            )

    def _not_read(self, name: str, activity: str, error: Exception) -> None:
        self._failed[name] = self._clock()
        self._window.problems.report(activity, error)

    def _take(self, name: str, skills: list[Skill]) -> None:
        if name in self._window.system.managers:
            self._offered[name] = skills
            self._show_rows()

    def _show_rows(self) -> None:
        self._offers = {offer.key: offer for offer in offers_of(rows_of(self._offered))}
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
    def purpose(self) -> str:
        """The first paragraph of the chosen skill's docstring, as its manager has stored it in the scene."""
        scene = self._window.system.scene
        if self.form is None or scene is None:
            return ""
        known = scene.matching(Element(self.form.offer.type, self.form.offer.label), SCENE)
        return next((str(text) for e in known if (text := e.value_of("rdfs:comment"))), "")

    def recent_values(self, key: str) -> list[str]:
        """Returns the last values of a parameter of the chosen skill: texts, or ids of elements."""
        return self.recent.of(self.form.offer.type, key) if self.form is not None else []

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
        """Refreshes the preview unless the throttle is active, and reads skills again if that failed; to be called
        periodically.
        """
        for name in [name for name, at in self._failed.items() if self._clock() - at > RETRY_PERIOD]:
            self._read(name)
        if self._throttle.is_ready:
            self.refresh()

    def refresh(self) -> None:
        """Refreshes the preview if the scene or the form has changed."""
        form, world = self.form, self._window.system.world
        manager = self._window.system.managers.get(form.offer.manager) if form is not None else None
        if not self._is_stale or self._is_refreshing or form is None or manager is None:
            return
        self._is_stale = self._is_edited = False
        step, classes = form.step(), form.classes
        self._is_refreshing = True
        self._throttle.begin()
        self._window.jobs.run(
            lambda: _preview(manager, step, classes, world),
            lambda preview: self._refreshed(form, preview),
            lambda error: self._refreshed(form, Preview(problem=error_text(error))),
            queue=_QUEUE,
        )

    def _refreshed(self, form: Form, preview: Preview) -> None:
        self._is_refreshing = False
        self._throttle.end()
        if form is self.form:
            self.preview = preview
            self.on_preview()
        if self._is_edited:
            self.refresh()

    # -- starting ----------------------------------------------------------------------------------------------

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
        step, values = form.step(), entered(form)
        action = "tick_once" if ticks_once else "start"
        self.is_starting, self._stop_when_started, self.refused = True, False, None
        self.on_preview()
        self._window.jobs.run(
            lambda: _start(manager, action, step),
            lambda result: self._started(form, result, values),
            lambda error: self._started(form, Refused(error_text(error)), values),
            activity=f"starting {offer.name} of {offer.manager}",
        )

    def _started(self, form: Form, result: Started | Refused, values: Values) -> None:
        self.is_starting = False
        offer = form.offer
        if isinstance(result, Started):
            self.recent.note(offer.type, values)
            self.tasks.started(offer.manager, result.task_id, result.nodes, result.stamp)
            self._window.publish(TaskStarted(offer.manager, result.task_id))
            if self._stop_when_started:
                self.tasks.command(STOP, offer.manager, result.task_id)
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
        last = self.tasks.last_started(manager)
        if last is not None and not last.is_finished:
            self.tasks.command(STOP, manager, last.task_id)
        else:
            self.start()


def _preview(manager: Manager, step: Step, classes: Sequence[str], world: WorldModelClient | None) -> Preview:
    """Previews a start; in a worker.

    :param classes: the classes whose elements are returned as choices; "" for any.
    """
    choices: dict[str, Sequence[ElementChoice]] = {}
    try:
        if world is not None:
            choices.update((cls, element_choices(world.resolve_elements(Element(cls)))) for cls in classes)
        return Preview(manager.preview([step], partial=True), choices)
    except SkirosError as error:
        return Preview(None, choices, str(error))


def _start(manager: Manager, action: str, step: Step) -> Started | Refused:
    """Sends a skill and reads its task; in a worker."""
    try:
        task_id = manager.command(action, -1, [step])
        stamp = time.time()
        return Started(task_id, next(iter(manager.read_tasks(task_id)), ()), stamp)
    except SkirosError as error:
        return Refused(str(error), _preview(manager, step, (), None).start)


def _nothing() -> None:
    """The default callback."""
